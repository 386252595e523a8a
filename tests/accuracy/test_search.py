"""The search for a mesh on made-up numbers whose errors are known."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from receding_fenicsx.errors import InputError, MeshMisfit, NotConverged
from receding_fenicsx.scene.model import Body, MeshOptions, Scene
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.studies.accuracy import study as module
from receding_fenicsx.studies.accuracy.estimate import Level, Number
from receding_fenicsx.studies.accuracy.meshes import graded_at_ends, is_graded, scaled_mesh
from receding_fenicsx.studies.accuracy.study import Search, search

pytestmark = pytest.mark.one_rank

DEMOS = Path(__file__).parents[2] / "demos"


def scene_of(tolerance: float, *numbers: str, budget: float = 1e6) -> Scene:
    scene = read_scene(DEMOS / "block.toml")
    options = replace(scene.accuracy, tolerance=tolerance, numbers=numbers, budget_seconds=budget)
    return replace(scene, accuracy=options)


def made_up(
    *, seconds: float = 1e-6, **errors: Callable[[int], float]
) -> Callable[[Scene, int], Level]:
    """Return a solver whose numbers are 1 plus an error that depends on the elements."""

    def solve(scene: Scene, elements: int) -> Level:
        assert scene.mesh.contact_elements == elements
        numbers = {name: Number(1.0 + error(elements)) for name, error in errors.items()}
        return Level(elements, 2 * elements + 1, seconds * elements**2, numbers)

    return solve


def sizes(found: Search) -> list[int]:
    return [level.elements for level in found.levels]


@pytest.mark.parametrize("order", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("tolerance", [3e-2, 1e-3])
def test_the_tolerance_is_met_on_a_mesh_hardly_finer_than_needed(
    order: float, tolerance: float
) -> None:
    scale = (0.05, 0.9)[order > 1.0]
    numbers = made_up(centre_pressure=lambda n: scale * (16.0 / n) ** order, a=lambda n: 1e-7 / n)
    found = search(scene_of(tolerance), numbers)
    least = 16.0 * (2.0 * scale / tolerance) ** (1.0 / order)
    if 2.0 * least > module.MOST_NODES:
        finest = "the tolerance needs a mesh finer than the finest of 8000 contact nodes"
        order_of = rf"needs about (\S+) elements, it converges with order {order}"
        told = re.fullmatch(f"{finest}; centre_pressure {order_of}", found.reason)
        assert not found.met and told and float(told[1]) == pytest.approx(least, rel=0.02)
        assert 8000 / 1.4 <= found.levels[-1].nodes <= 8000  # nearly the finest one is tried
        return
    assert found.met and not found.reason
    last = found.way[-1]["centre_pressure"]
    assert 2.0 * last.error <= tolerance and last.order == pytest.approx(order, abs=1e-3)
    # what is added: the aim below the tolerance, and at least three meshes
    assert sizes(found)[-1] <= max(150, 1.7 * least) and len(sizes(found)) > 2
    ratios = [b / a for a, b in zip(sizes(found), sizes(found)[1:], strict=False)]
    assert all(1.55 <= ratio <= 2.9 for ratio in ratios)


def test_the_worst_of_the_asked_numbers_decides() -> None:
    fast, slow = (lambda n: 0.1 * (16.0 / n) ** 2), (lambda n: 0.1 * 16.0 / n)
    solve = made_up(centre_pressure=fast, dissipation_ratio=slow, stick_half_width=slow)
    both = search(scene_of(1e-2), solve)
    assert set(both.way[-1]) == {"centre_pressure", "dissipation_ratio"}
    one = search(scene_of(1e-2, "centre_pressure"), solve)
    assert set(one.way[-1]) == {"centre_pressure"}
    assert sizes(one)[-1] < sizes(both)[-1]


@pytest.mark.parametrize(("first", "power"), [(2.0, 1.0), (0.5, 3.0), (0.01, 3.0), (4.2, 2.0)])
def test_the_next_mesh_is_expected_to_cost_what_the_meshes_before_show(
    first: float, power: float
) -> None:
    """4 s after ``first``: with the power seen, 3 at most, 2 where the finer mesh was no slower."""
    numbers = {"centre_pressure": Number(1.01)}, {"centre_pressure": Number(1.005)}
    levels = Level(32, 65, first, numbers[0]), Level(64, 129, 4.0, numbers[1])
    left, budget = iter(levels), first + 3.9 + 4.0 * 2.5**power
    found = search(scene_of(1e-4, budget=budget), lambda *_: next(left))
    told = re.search(r"a mesh of (\d+) elements needs about (\S+) s", found.reason)
    assert told is not None and found.levels == list(levels), found.reason
    # the seconds of all meshes count
    assert f"the budget of {budget:g} s ends first: {first + 4.0:.3g} s are spent" in found.reason
    assert float(told[2]) == pytest.approx(4.0 * (int(told[1]) / 64) ** power, rel=0.05)


def test_meshes_that_do_not_fit_or_have_no_answer_are_passed_over() -> None:
    plain = made_up(centre_pressure=lambda n: 0.1 * (16.0 / n) ** 2)

    def solve(scene: Scene, elements: int) -> Level:
        if elements % 12:
            raise MeshMisfit("no vertex")
        if elements < 48:
            raise NotConverged("too coarse")
        return plain(scene, elements)

    found = search(scene_of(1e-3), solve)
    assert found.met and all(n % 12 == 0 and n >= 48 for n in sizes(found))
    assert found.shown()["failures"] == [[24, "too coarse"]]

    with pytest.raises(NotConverged, match="no answer"):
        search(scene_of(1e-3), Mock(side_effect=NotConverged("no answer")))
    # once there was one a finer mesh has to have one too
    first = plain(replace(scene_of(1e-3), mesh=MeshOptions(24)), 24)
    with pytest.raises(NotConverged, match="no answer"):
        search(scene_of(1e-3), Mock(side_effect=[first, NotConverged("no answer")]))
    with pytest.raises(InputError, match=r"no mesh that was tried fits the scene; .*: no vertex"):
        search(scene_of(1e-3), Mock(side_effect=MeshMisfit("no vertex")))


def test_a_mesh_file_is_refined_six_times_at_most() -> None:
    scene, seen = scene_of(1e-9), []
    file = replace(scene, body=replace(scene.body, mesh="own.msh"))

    def solve(own: Scene, elements: int) -> Level:
        seen.append((own.mesh.refinements, elements))
        numbers = {"centre_pressure": Number(1.0 + 1.0 / elements), "constant": Number(1.0)}
        return Level(elements, 9, 1e-6, numbers)

    found, most = search(file, solve), "more refinements of the mesh file than there are"
    assert seen == [(k, 2**k * scene.mesh.contact_elements) for k in range(7)]
    needs = r"centre_pressure needs about 2e\+09 elements, it converges with order 1\.0"
    assert re.fullmatch(f"the tolerance needs {most}; {needs}", found.reason)
    # a body beside it gets elements that match
    n, growth = 2 * scene.mesh.contact_elements, 0.5 + 0.5 * scene.mesh.growth
    beside: dict[str, Any] = {"contact_elements": n, "growth": growth}
    for others, more in (((), {}), ((Body("b"),), beside)):
        finer = scaled_mesh(replace(file, others=others), n).mesh
        assert finer == replace(scene.mesh, refinements=1, **more)


def test_a_search_ends_on_four_meshes_without_an_order() -> None:
    for growing, does in ((["a"], "does"), (["a", "b"], "do")):
        errors: dict[str, Any] = dict.fromkeys(growing, lambda n: -math.log(n))
        found = search(scene_of(1e-3), made_up(centre_pressure=lambda n: 1.0 / n, **errors))
        words = "not converge in order (singular, or the mesh is far from resolving it)"
        assert found.reason == f"{', '.join(growing)} {does} {words}; ask for other numbers"
        assert len(found.levels) == 4 and not found.met


def test_a_search_begins_anew_on_graded_meshes_where_corners_are_sharp() -> None:
    def graded(scene: Scene) -> Scene:
        return graded_at_ends(scene, [2.0 / scene.mesh.contact_elements])

    def solve(scene: Scene, elements: int) -> Level:
        tried.append((elements, is_graded(scene)))
        error = 0.3 * (16.0 / elements) ** (1.5 if is_graded(scene) else 0.5)
        return replace(made_up(centre_pressure=lambda _: error)(scene, elements), sharp=True)

    tried: list[tuple[int, bool]] = []
    found = search(scene_of(1e-2), solve, graded=graded)
    assert tried[0] == (24, False) and all(each[1] for each in tried[1:])
    assert found.met and sizes(found) == [elements for elements, _ in tried[1:]]
    assert is_graded(found.scene) and found.shown()["graded"]
    assert not is_graded(search(scene_of(0.3), solve, graded=lambda _: None).scene)
