from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

from mpi4py import MPI

import models
import numpy as np
import pytest
from demo_runs import sheared_block
from images import played as solve
from small import cyclic, table

import receding_fenicsx as rf
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.measures.ends import contact_betas, half_width_estimates
from receding_fenicsx.reference.closed_forms import BLOCK
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy import estimate
from receding_fenicsx.studies.accuracy import study as space_errors
from receding_fenicsx.studies.accuracy.estimate import estimated_error, observed_order
from receding_fenicsx.studies.accuracy.meshes import to_limit

pytestmark = pytest.mark.one_rank

DEMOS = Path(__file__).parents[2] / "demos"


def scene_of(elements: int = 64, *overrides: str) -> rf.Scene:
    wanted = [f"mesh.contact_elements={elements}", "history.cycles=3", *overrides]
    scene = rf.read_scene(DEMOS / "block.toml", wanted)
    return replace(scene, history=replace(scene.history, until=None))


# -- the formula ----------------------------------------------------------------------------------


@pytest.mark.parametrize("factors", [(2.0, 2.5, 4.0), (2.5, 4.0), (2.0, 4.0, 8.0), (1.6, 5.0)])
@pytest.mark.parametrize("order", [0.5, 1.0, 1.3, 1.6])
def test_an_error_in_order_is_estimated_exactly(factors: tuple[float, ...], order: float) -> None:
    limit, slope = 3.0, -0.07
    values = [(r, limit + slope * r**order) for r in (1.0, *factors)]
    assert observed_order(values) == pytest.approx(order, rel=1e-6)
    assert estimated_error(values, observed_order(values)) == pytest.approx(abs(slope), rel=1e-6)
    # out of order: pairs of meshes tell 0, 1/2 and 1/3, the largest counts
    for last, most in ((7.0, 8.0), (6.0, -2.0)):
        values = [(1.0, 7.0), (2.0, last), (4.0, 6.0)]
        assert estimated_error(values, 1.0) == 0.5 + (last < 7.0) / 2
        assert observed_order(values) == most


def test_where_a_zone_is_not_resolved_no_order_above_one_is_assumed() -> None:
    values = [(r, 3.0 + 0.01 * r**1.5) for r in (1.0, 2.0, 4.0)]
    levels = [rf.Level(round(64 / r), 0, 0.0, {"a": rf.Number(a)}) for r, a in values]
    assert rf.estimates_of(levels)["a"].error == pytest.approx(0.01)
    # two meshes tell no order, and one that lacks the number nothing
    without = replace(levels[1], numbers={})
    assert np.isnan(rf.estimates_of([levels[0], without])["a"].error)
    assert rf.estimates_of(levels[:2])["a"].error == pytest.approx(0.01 * (2.0**1.5 - 1.0))
    levels[0] = replace(levels[0], resolved=False)
    assert rf.estimates_of(levels)["a"].error == pytest.approx(0.01 * (4.0**1.5 - 2.0**1.5) / 2.0)


@pytest.mark.parametrize(
    ("values", "singular"),
    [
        ([5.0 + n**0.5 for n in (16, 32, 64)], True),
        ([np.log(n) for n in (16, 32, 64)], True),
        ([5.0 + n**-0.5 for n in (16, 32, 64)], False),
        ([4.0, 3.0, 5.0], False),  # it turns
        ([500.0, 500.4, 500.8], False),  # it hardly moves
    ],
)
def test_a_number_that_moves_on_without_end_is_called_singular(
    values: list[float], singular: bool
) -> None:
    # a fourth mesh hardly coarser than the finest shows noise, which counts for nothing
    sizes = dict(zip((16, 32, 64), values, strict=True)) | {60: 1.0001 * values[-1]}
    for more in (sizes, {n: -a for n, a in sizes.items()}):
        levels = [rf.Level(n, 0, 0.0, {"a": rf.Number(a)}) for n, a in more.items()]
        assert np.isinf(rf.estimates_of(levels)["a"].error) == singular


# -- coarser meshes -------------------------------------------------------------------------------


def test_all_sizes_of_a_coarser_mesh_are_enlarged_alike() -> None:
    coarse = rf.scaled_mesh(scene_of(64, "mesh.growth=1.3"), 32).mesh
    # dx + (growth - 1) y
    assert (coarse.contact_elements, coarse.growth) == (32, pytest.approx(1.6))
    assert rf.scaled_mesh(scene_of(64, "mesh.growth=1.0"), 16).mesh.growth == 1.0
    # gmsh's geometry ends at 3
    assert rf.scaled_mesh(scene_of(64, "mesh.growth=2.5"), 16).mesh.growth == 3.0


def test_meshes_that_do_not_fit_the_scene_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Records are made up: their only number has an error of the first order in the mesh size."""
    monkeypatch.setattr(space_errors, "level_of", lambda a, n: rf.Level(n, 0, 0.0, a))
    tried = []

    def solve_some(scene: rf.Scene) -> Any:
        tried.append(scene.mesh.contact_elements)
        if tried[-1] in (32, 16):
            raise MeshMisfit("no vertex")
        if tried[-1] == 14:
            raise rf.NotConverged("too coarse")  # is no reason to know nothing
        return {"a": rf.Number(1.0 + 1.0 / tried[-1])}

    own: Any = {"a": rf.Number(1.0 + 1.0 / 64.0)}
    found = space_errors.space_errors(scene_of(64), own, solve_some)
    assert tried == [32, 30, 24, 16, 14] and list(found) == ["a"]
    assert (found["a"].value, found["a"].error) == (1.0 + 1.0 / 64.0, pytest.approx(1.0 / 64.0))


# -- true errors ----------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("degree", [1, 2])
def test_errors_of_the_frictionless_block_are_within_twice_the_estimate(
    cell: str, degree: int
) -> None:
    # the limit is known without finite elements
    scene = scene_of(
        128 // degree,
        f'mesh.cell="{cell}"',
        f"mesh.degree={degree}",
        "contact.friction=0.0",
        f"load.p0.span=[{-BLOCK.load}, {BLOCK.load}]",
    )
    record = solve(scene)
    found = space_errors.space_errors(scene, record, solve)
    known = {"centre_pressure": BLOCK.p[0], "contact_half_width": BLOCK.half_width}
    for name, limit in known.items():
        true = abs(found[name].value - limit)
        floor = 0.5 * np.diff(record.x).max() if name == "contact_half_width" else 0.0
        assert true <= 2.0 * found[name].error + floor
        assert found[name].error <= 0.25 * limit
    assert "dissipation_first_cycle" not in found


SHEARED_D = 1.629e-3
"""Dissipation of ``sheared_polygon.toml``: 480 triangles or quadrilaterals of order 2 along the
contact give 1.6285e-3 and 1.6287e-3 (growth 1.1), 400 quadrilaterals 1.6298e-3."""


@pytest.mark.parametrize(("cell", "elements"), [("quadrilateral", 112), ("triangle", 128)])
def test_the_estimate_holds_where_the_dissipation_converges_in_stairs(
    cell: str, elements: int
) -> None:
    # a corner sticks on one node of all these meshes: D stands still over them, 2 % off
    wanted = [f"mesh.contact_elements={elements}", f'mesh.cell="{cell}"', "history.cycles=1"]
    scene = rf.read_scene(DEMOS / "sheared_polygon.toml", wanted)
    scene = replace(scene, history=replace(scene.history, until=None))
    record = solve(scene)
    found = space_errors.space_errors(scene, record, solve)["dissipation_first_cycle"]
    true = abs(found.value - SHEARED_D)
    assert 0.01 * SHEARED_D < true <= 2.0 * found.error < 0.1 * SHEARED_D
    assert estimate.narrowest_zone(record) == 1


def test_the_estimate_shows_that_linear_triangles_lock_near_incompressibility() -> None:
    def error(degree: int) -> float:
        scene = scene_of(64 // degree, "material.poisson=0.499", f"mesh.degree={degree}")
        found = space_errors.space_errors(scene, solve(scene), solve)["dissipation_first_cycle"]
        return found.error / found.value

    # with as many nodes; no residual tells that the linear elements' answer is meaningless
    assert error(1) > 0.1
    assert error(2) < 0.05


def test_an_error_is_no_less_than_what_the_number_is_known_to_on_its_own_mesh() -> None:
    scene = scene_of(32)
    record = solve(scene)
    # all meshes give the same numbers: nothing is known of their errors but the widths' intervals
    found = space_errors.space_errors(scene, record, lambda _: record)
    numbers, row = rf.headline(record), int(np.argmax(record.turning_points.cycle > 0)) - 1
    for name, number in numbers.items():
        assert found[name].error == max(number.known_to, 1e-6 * number.size)
    first, ratio = (numbers[f"dissipation_{name}"] for name in ("first_cycle", "ratio"))
    assert ratio.known_to == first.known_to / first.value > 0.0
    # on linear elements the pressure zigzags
    linear = solve(scene_of(32, "mesh.degree=1"))
    p, middle = linear.turning_points.p[0], len(linear.x) // 2
    zigzag = 0.5 * np.abs(np.diff(p[middle - 4 : middle + 5], 2)).max()
    assert rf.headline(linear)["centre_pressure"].known_to == zigzag > 0.0
    # half of the interval, of a fitted end a third of that
    for zone, width in half_width_estimates(record, row, contact_betas(record)).items():
        low, high = width["interval"]
        part = 6.0 if width["fitted"] else 2.0
        known_to = numbers[zone.removesuffix("_estimate")].known_to
        assert known_to == pytest.approx((high - low) / part, rel=1e-12), zone


@pytest.mark.parametrize("turned", [1, -1])
def test_one_edge_with_sharp_corners_makes_a_mesh_sharp(turned: int) -> None:
    """The other one never touches."""
    scene = sheared_block(0.8, "mesh.contact_elements=16")
    edges = *scene.contacts, rf.Contact("left", initial_gap=0.05)
    level = estimate.level_of(solve(replace(scene, contacts=edges[::turned])), 16)
    assert level.sharp and not any("[left]" in name for name in level.numbers)


# -- in a run -------------------------------------------------------------------------------------


def test_a_zone_of_few_nodes_is_named_as_a_reason_for_stairs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = scene_of(32)
    record = solve(scene)
    table = record.turning_points
    monkeypatch.setattr(space_errors, "space_errors", lambda *_: {})
    assert estimate.narrowest_zone(record) > 2
    assert "errors_warning" not in space_errors.errors_of_run(scene, record, solve)
    last = table.cycle.max()
    for k, cycle in enumerate(table.cycle):  # which cycles count
        state = np.full_like(table.state, rf.State.STICK)
        state[k, 10] = rf.State.SEPARATION
        narrow = replace(record, turning_points=replace(table, state=state))
        assert (estimate.narrowest_zone(narrow) == 1) == (cycle in (0, 1, last))
    for width, words in ((1, "is 1 node wide"), (2, "is 2 nodes wide"), (3, "")):
        state = np.full_like(table.state, rf.State.STICK)
        state[-1, 10 : 10 + width] = rf.State.SEPARATION
        narrow = replace(record, turning_points=replace(table, state=state))
        assert estimate.narrowest_zone(narrow) == width
        found = space_errors.errors_of_run(scene, narrow, solve)
        assert words in found.get("errors_warning", "")
        assert ("errors_warning" in found) == bool(words)


def test_cycles_played_until_steady_are_left_for_their_limit() -> None:
    """Only the path's limit, for a history that has the cycles to find it."""
    steady = rf.read_scene(DEMOS / "block.toml", ["mesh.contact_elements=32"])
    limit = to_limit(steady)
    assert limit == replace(steady, history=replace(steady.history, until="limit"))
    own = "history.cycles=20", "solver.steady_tolerance=1e-6", "solver.method=gauss-seidel"
    for override in (*own, "solver.branch=least dissipation"):
        other = rf.read_scene(DEMOS / "block.toml", [override])
        assert to_limit(other) == other
    assert to_limit(scene_of()) == scene_of()
    played, found = (rf.headline(solve(scene))["dissipation_ratio"] for scene in (steady, limit))
    assert played.value == pytest.approx(found.value, rel=1e-6)


@pytest.mark.one_rank(False)
def test_a_run_without_an_answer_on_coarser_meshes_says_so() -> None:
    scene, refuse = scene_of(32), Mock(side_effect=rf.NotConverged("too coarse"))
    found = space_errors.errors_of_run(scene, solve(scene), refuse)
    assert found == {"errors": {}, "errors_failure": "on a coarser mesh: too coarse"}


@pytest.mark.one_rank(False)
def test_a_search_without_an_answer_on_any_mesh_ends_as_its_last_run(shared_tmp_path: Path) -> None:
    scene = scene_of(16, "history.minimum=-0.5", "accuracy.tolerance=0.1")
    with pytest.raises(rf.NoEquilibrium, match="pull the body off"):
        study.run(scene, shared_tmp_path / "run", study.RunOptions(pictures=False), MPI.COMM_WORLD)


def test_ends_of_zones_are_named_by_their_sides_and_are_those_of_a_loaded_contact() -> None:
    system = models.block_system(40, 20, half=False)
    found = estimate.headline(rf.evolve(system, cyclic(1)))
    for zone in ("contact", "stick"):
        left, right = (found[f"{zone}_{side}"].value for side in ("left", "right"))
        assert left == pytest.approx(-right, rel=1e-6) and right > 0.0
    assert found["contact_right"].value > found["stick_right"].value
    # of a first loading that ends without load they are those of the largest force
    there, back = (rf.evolve(system, table(system, path)) for path in ([0, 1], [0, 1, 0]))
    both = [estimate.headline(record) for record in (there, back)]
    for name in ("centre_pressure", "contact_right", "stick_left"):
        assert both[0][name] == both[1][name]
