"""Histories of scenes: paths and loops, harmonic ones as polygons, names of legs, instants."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx.scene.history import History, evenly_spaced, history_from_scene, leg_number

pytestmark = pytest.mark.one_rank

ONE = '[[load]]\nname = "P"\nedge = "top"\npressure = 1.0\n'
BODY = ONE + '[[load]]\nname = "Q 1"\nedge = "top"\ntraction = [1.0, 0.0]\n'
OUT_OF_PHASE = Path(__file__).with_name("out_of_phase.toml").read_text()
CYCLIC, TABLE = 'kind = "cyclic"\n', 'kind = "table"\n'
IN_PHASE = [[1.5, 0.25], [0.5, -0.25], [1.5, 0.25]]
OPPOSITE = [[1.5, -0.25], [0.5, 0.25], [1.5, -0.25]]


def made(history: str, *changes: str, body: str = BODY) -> History:
    scene = rf.from_toml(f"{body}[history]\n{history}", changes)
    assert rf.from_toml(rf.to_toml(scene)) == scene
    found = history_from_scene(scene)
    assert found.load_names == tuple(load.name for load in scene.loads)
    assert found.cycles == (scene.history.cycles if len(found.loop) else 0)
    until = scene.history.until
    assert (found.until_steady, found.until_limit) == (until == "steady", until == "limit")
    return found


@pytest.mark.parametrize(
    ("history", "path", "loop"),
    [
        (f"{CYCLIC}maximum = 2\nminimum = -0.5\ncycles = 7", [[0], [2]], [[2], [-0.5], [2]]),
        (f'{CYCLIC}until = "steady"', [[0], [1]], [[1], [1 / 3], [1]]),
        ('kind = "monotonic"\nmaximum = 3.0', [[0], [3]], []),
        # a table may begin at zero and repeat the start of the cycle
        (
            f'{TABLE}columns = ["P"]\nrows = [[0.0], [1.0]]\nuntil = "limit"\ncycles = 9\n'
            "cycle_rows = [[1.0], [0.5], [0.75], [1.0]]",
            [[0], [1]],
            [[1], [0.5], [0.75], [1]],
        ),
        # columns are put in the order of the loads
        (
            f'{TABLE}columns = ["Q 1", "P"]\nrows = [[0.0, 1.0], [0.2, 1.0]]\n'
            "cycle_rows = [[-0.2, 1.0], [0.2, 1.0]]\ncycles = 3",
            [[0, 0], [1, 0], [1, 0.2]],
            [[1, 0.2], [1, -0.2], [1, 0.2]],
        ),
        # constant loads are applied first and kept
        (
            f"{CYCLIC}minimum = -1\nconstant = {{P = 2}}",
            [[0, 0], [2, 0], [2, 1]],
            [[2, 1], [2, -1], [2, 1]],
        ),
        ('kind = "monotonic"\nconstant = {"Q 1" = -1}', [[0, 0], [0, -1], [1, -1]], []),
        (f"{CYCLIC}constant = {{P = 0}}", [[0, 0], [0, 1]], [[0, 1], [0, 1 / 3], [0, 1]]),
    ],
)
def test_paths_and_loops_of_histories(
    history: str, path: list[list[float]], loop: list[list[float]]
) -> None:
    found = made(history, body=ONE if len(path[0]) == 1 else BODY)
    assert np.array_equal(found.path, path)
    assert np.array_equal(found.loop, np.reshape(loop, (-1, len(path[0]))))


# -- harmonic loads ------------------------------------------------------------------------------


def test_corners_lie_on_the_ellipse_and_hold_the_extremes_of_each_load() -> None:
    for corners in (4, 7, 16, 100):
        history = made(OUT_OF_PHASE, f"history.corners={corners}")
        assert history.loop.shape == (corners + 1, 2)
        P, Q = history.loop.T
        np.testing.assert_allclose(((P - 1.0) / 0.5) ** 2 + (Q / 0.25) ** 2, 1.0, atol=1e-14)
        assert (P.min(), P.max(), Q.min(), Q.max()) == (0.5, 1.5, -0.25, 0.25)
        # once around: the angle from corner to corner has one sign and adds up to a turn
        way = np.diff(np.unwrap(np.arctan2(Q / 0.25, (P - 1.0) / 0.5)))
        assert np.all(way > 0.0)
        np.testing.assert_allclose(way.sum(), 2.0 * np.pi, rtol=1e-14)
        np.testing.assert_array_equal(history.loop[0], history.loop[-1])


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ([], [[0, 0], [1, 0], [1.5, 0]]),
        (["history.harmonic.P={mean=1.0}"], [[0, 0], [1, 0], [1, 0.25]]),
        (
            ["history.harmonic={P={amplitude=0.5}}", "history.constant.Q 1=2"],
            [[0, 0], [0, 2], [0.5, 2]],
        ),
    ],
)
def test_path_leads_over_the_means_to_the_maximum_of_the_first_load(
    changes: list[str], path: list[list[float]]
) -> None:
    assert made(OUT_OF_PHASE, *changes).path.tolist() == path


@pytest.mark.parametrize(
    ("phase", "loop"), [(20, IN_PHASE), (200, OPPOSITE), (380, IN_PHASE), (-160, OPPOSITE)]
)
def test_loads_in_phase_or_opposite_need_two_corners(phase: float, loop: list[list[float]]) -> None:
    changes = f"history.harmonic.Q 1.phase={phase}", "history.corners=64"
    assert made(OUT_OF_PHASE, *changes).loop.tolist() == loop


@pytest.mark.parametrize("phase", [22, 50, 110, 199])
def test_arcs_between_extremes_are_divided_evenly_and_doubled_corners_divide_every_piece(
    phase: float,
) -> None:
    # else the dissipation does not change where an arc between close extremes keeps its piece,
    # and the error estimate is too small
    change = f"history.harmonic.Q 1.phase={phase}"
    for corners in (8, 9, 24, 32):
        coarse, fine = (
            made(OUT_OF_PHASE, change, f"history.corners={n}").loop for n in (corners, 2 * corners)
        )
        np.testing.assert_allclose(fine[::2], coarse, atol=1e-14)
    if phase == 50:
        loop = made(OUT_OF_PHASE, change, "history.corners=24").loop
        angles = np.degrees(np.arccos(np.clip((loop[:13, 0] - 1.0) / 0.5, -1.0, 1.0)))
        np.testing.assert_allclose(angles, 15.0 * np.arange(13), atol=1e-6)


# -- legs and instants ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("corners", "asked"),
    [
        ([1.0, 0.5, 1.0], [("loading", 0, 0), ("unloading", 1, 0), ("loading", 2, 1), ("1", 1, 1)]),
        # by the size of loads, which may be negative: it falls, then grows
        ([1.0, -0.25, -2.0, 1.0], [("loading", 1, 1)]),
        ([-1.0, -0.5, -1.0], [("unloading", 1, 0), ("loading", 1, 1)]),
        ([1.0, 0.5, 0.8, 0.2, 1.0], [("3", 1, 3)]),
        # each over its largest
        ([(0.2, 1.0), (-0.4, 0.7), (-1.0, 0.9), (0.2, 1.0)], [("loading", 1, 1)]),
        ([(100.0, 0.0), (99.0, 0.5), (100.0, 0.0)], [("loading", 1, 0), ("unloading", 1, 1)]),
    ],
)
def test_legs_have_names_that_must_mean_one_and_numbers(
    corners: list[Any], asked: list[tuple[str, int, int]]
) -> None:
    loop = np.array(corners).reshape(len(corners), -1)
    history = History(("P", "Q")[: loop.shape[1]], loop[:1] * [[0.0], [1.0]], loop, 2)
    for name, cycle, answer in asked:
        assert leg_number(history, name, cycle) == answer


def test_history_takes_lists_and_refuses_rows_of_unequal_length_and_text() -> None:
    system = small_system(np.eye(4), {"P": [0.0, 0.0, 1.0, 1.0], "Q": [0.1, 0.1, 0.0, 0.0]}, 0.3)
    path, loop = [[0, 0], [1, 0], [1, 1]], [[1, 1], [1, -1], [1, 1]]
    lists = History(["P", "Q"], path, loop, cycles=2)  # type: ignore[arg-type]
    arrays = History(("P", "Q"), np.array(path, float), np.array(loop, float), cycles=2)
    one, two = (rf.evolve(system, history).turning_points for history in (lists, arrays))
    assert np.array_equal(one.v, two.v) and np.array_equal(one.Q, two.Q)
    assert repr(lists) == repr(arrays)
    words = ["History: 3 corners from rest, 2 cycles of 2 legs", "load P 0 to 1", "load Q -1 to 1"]
    assert [" ".join(line.split()) for line in repr(lists).splitlines()] == words
    for changes, end in (
        ({"until_limit": True}, "2 cycles of 2 legs, until limit\n"),
        ({"until_steady": True}, "2 cycles of 2 legs, until steady\n"),
        ({"cycles": 0, "loop": []}, "0 cycles of 0 legs\n"),
    ):
        assert repr(replace(lists, **changes)).startswith(words[0][:30] + end)
    assert History(("P", "Q"), path, []).loop.shape == (0, 2)  # type: ignore[arg-type]
    for wrong in ([[0, 0], [1]], [[0, 0], ["a", 1]], [[0, 0], [None, {}]]):
        with pytest.raises(rf.InputError, match="history's path: has to be numbers"):
            History(("P", "Q"), wrong, loop)  # type: ignore[arg-type]


def test_instants_spread_over_a_cycle_go_evenly_and_meet_every_turning_point() -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0]])
    loop = np.array([[2.0, 0.0], [2.0, 1.0], [1.0, -1.0], [2.0, 0.0]])
    table = History(("P", "Q"), path, loop, 3)
    way = np.array([1.0, 2.5, 1.5])  # over the largest loads, 2 and 1
    for n in (4, 11, 60):
        leg, s, time = evenly_spaced(table, 2, n)
        assert len(leg) == len(s) == len(time) == n
        assert (leg[0], s[0], time[0], time[-1]) == (0, 0.0, 0.0, 1.0)
        assert np.all(np.diff(time) > 0.0)
        assert {*leg[s == 1.0]} == {0, 1, 2}
        assert time[(leg == 1) & (s == 1.0)][0] == pytest.approx(way[:2].sum() / way.sum())
    assert np.diff(evenly_spaced(table, 2, 60)[2]).max() < 1.2 / 59
    # at rest nothing is loaded and nothing to be seen
    assert evenly_spaced(table, 0, 5)[2][0] > 0.0
    assert np.all(np.diff(evenly_spaced(table, 0, 5)[2]) > 0.0)
    resting = History(("P", "Q"), path[[0, 0, 1]], loop, 3)
    assert evenly_spaced(resting, 0, 5)[2] == pytest.approx([0.0, 0.0, 1 / 3, 2 / 3, 1.0])


def test_parts_are_fitted_before_they_are_bolted_and_loaded() -> None:
    path = Path(__file__).parents[2] / "demos" / "bolted_joint.toml"
    scene = rf.read_scene(path, ["contact.interference=0.01"])
    bolts = tuple(replace(bolt, name=name) for bolt, name in zip(scene.bolts, "ab", strict=True))
    # the contact that is fitted may be any of several
    scene = replace(scene, bolts=bolts, contacts=(rf.Contact("other"), *scene.contacts))
    history = history_from_scene(scene)
    begins = [np.flatnonzero(column)[0] for column in history.path.T if column.any()]
    order = [history.load_names[k] for k in np.argsort(begins, kind="stable")]
    assert order[:3] == ["interference", "a", "b"] and sorted(begins)[:3] == [1, 2, 3]
    assert np.all(history.path[1:, history.load_names.index("interference")] == 1.0)


@pytest.mark.parametrize("way", [(0.0, 1.1), (-1.3, 0.7), (0.9, 0.0)])
def test_a_way_has_as_many_even_pieces_as_steps_are_asked_for(way: tuple[float, float]) -> None:
    for steps in range(1, 200):
        units = rf.Load("p", "top", (-0.1, 0.1), pressure=1.0, travel=way, steps=steps).units
        places = [unit.travel[0] for unit in units]
        assert places == pytest.approx(np.linspace(*way, steps + 1), abs=1e-12)


def test_load_factors_that_are_round_off_are_zero() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.5], [np.sin(np.pi), -1e-9]])
    history = History(("P", "Q"), path, path[[2, 1, 2]] * [[1.0, 1e-9]], 1)
    assert history.path[:, 0].tolist() == [0.0, 1.0, 0.0] == history.loop[[0, 1, 2], 0].tolist()
    assert np.array_equal(history.path[:, 1], path[:, 1])
