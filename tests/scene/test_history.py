from pathlib import Path

import numpy as np
import pytest
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.history import History, evenly_spaced, history_from_scene, leg_number
from receding_fenicsx.scene.toml_file import from_toml

pytestmark = pytest.mark.one_rank

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()
BODY = BLOCK[: BLOCK.index("[history]")]
SHEAR = '[[load]]\nname = "shear"\nedge = "top"\ntraction = [1.0, 0.0]\n'


def made(history: str, extra: str = "") -> History:
    return history_from_scene(from_toml(f"{BODY}{extra}[history]\n{history}"))


def test_cyclic_history_runs_maximum_minimum_maximum() -> None:
    history = made('kind = "cyclic"\nmaximum = 2.0\nminimum = -0.5\ncycles = 7')
    assert history.load_names == ("p0",)
    np.testing.assert_array_equal(history.path, [[0.0], [2.0]])
    np.testing.assert_array_equal(history.loop, [[2.0], [-0.5], [2.0]])
    assert (history.cycles, history.until_steady) == (7, False)


def test_monotonic_history_has_no_cycles() -> None:
    history = made('kind = "monotonic"\nmaximum = 3.0')
    np.testing.assert_array_equal(history.path, [[0.0], [3.0]])
    assert history.loop.shape == (0, 1)
    assert history.cycles == 0


def test_table_columns_are_put_in_the_order_of_the_loads() -> None:
    history = made(
        'kind = "table"\ncolumns = ["shear", "p0"]\nrows = [[0.0, 1.0], [0.2, 1.0]]\n'
        "cycle_rows = [[-0.2, 1.0], [0.2, 1.0]]\ncycles = 3",
        SHEAR,
    )
    assert history.load_names == ("p0", "shear")
    np.testing.assert_array_equal(history.path, [[0.0, 0.0], [1.0, 0.0], [1.0, 0.2]])
    np.testing.assert_array_equal(history.loop, [[1.0, 0.2], [1.0, -0.2], [1.0, 0.2]])
    assert history.cycles == 3


def test_table_may_begin_at_zero_and_repeat_the_start_of_the_cycle() -> None:
    history = made(
        'kind = "table"\ncolumns = ["p0"]\nrows = [[0.0], [1.0]]\n'
        "cycle_rows = [[1.0], [0.5], [0.75], [1.0]]\ncycles = 1"
    )
    np.testing.assert_array_equal(history.path, [[0.0], [1.0]])
    np.testing.assert_array_equal(history.loop, [[1.0], [0.5], [0.75], [1.0]])


def test_history_takes_lists_and_refuses_rows_of_unequal_length_and_text() -> None:
    system = small_system(np.eye(4), {"P": [0.0, 0.0, 1.0, 1.0], "Q": [0.1, 0.1, 0.0, 0.0]}, 0.3)
    path, loop = [[0, 0], [1, 0], [1, 1]], [[1, 1], [1, -1], [1, 1]]
    lists = History(["P", "Q"], path, loop, cycles=2)  # type: ignore[arg-type]
    arrays = History(("P", "Q"), np.array(path, float), np.array(loop, float), cycles=2)
    one, two = (rf.evolve(system, history).turning_points for history in (lists, arrays))
    assert np.array_equal(one.v, two.v) and np.array_equal(one.Q, two.Q)
    assert repr(lists) == repr(arrays)
    assert History(("P", "Q"), path, []).loop.shape == (0, 2)  # type: ignore[arg-type]
    for wrong in ([[0, 0], [1]], [[0, 0], ["a", 1]], [[0, 0], [None, {}]]):
        with pytest.raises(InputError, match="history's path: has to be numbers"):
            History(("P", "Q"), wrong, loop)  # type: ignore[arg-type]


def test_legs_have_names_and_numbers() -> None:
    history = made('kind = "cyclic"\ncycles = 2')
    assert leg_number(history, "loading", cycle=0) == 0
    assert leg_number(history, "unloading", cycle=1) == 0
    assert leg_number(history, "loading", cycle=2) == 1
    assert leg_number(history, "1", cycle=1) == 1
    for name, cycle, word in [
        ("unloading", 0, "0 unloading legs"),
        ("2", 1, "legs 0 to 1"),
        ("-1", 1, "legs 0 to 1"),
        ("reloading", 1, "legs 0 to 1"),
        ("loading", 3, "cycles 0 to 2"),
        ("loading", -1, "cycles 0 to 2"),
    ]:
        with pytest.raises(InputError, match=word):
            leg_number(history, name, cycle)


@pytest.mark.parametrize("until", [False, True])
def test_every_kind_of_cycles_may_end_when_steady(until: bool) -> None:
    words = '\nuntil = "steady"' if until else ""
    table = 'kind = "table"\ncolumns = ["p0"]\nrows = [[1.0]]\ncycle_rows = [[0.5], [1.0]]'
    assert made('kind = "cyclic"\ncycles = 2' + words).until_steady == until
    assert made(f"{table}\ncycles = 2{words}").until_steady == until


def test_legs_are_named_by_the_size_of_their_loads() -> None:
    """A load may be negative: from 1 through -0.25 to -2 it falls, then grows."""
    history = made(
        'kind = "table"\ncolumns = ["p0"]\nrows = [[1.0]]\n'
        "cycle_rows = [[-0.25], [-2.0], [1.0]]\ncycles = 1"
    )
    assert leg_number(history, "loading", cycle=1) == 1
    history = made(
        'kind = "table"\ncolumns = ["p0"]\nrows = [[-1.0]]\n'
        "cycle_rows = [[-0.5], [-1.0]]\ncycles = 1"
    )
    assert leg_number(history, "unloading", cycle=1) == 0
    assert leg_number(history, "loading", cycle=1) == 1


def test_leg_name_must_mean_one_leg() -> None:
    history = made(
        'kind = "table"\ncolumns = ["p0"]\nrows = [[1.0]]\n'
        "cycle_rows = [[0.5], [0.8], [0.2], [1.0]]\ncycles = 1"
    )
    with pytest.raises(InputError, match="2 unloading legs"):
        leg_number(history, "unloading", 1)
    assert leg_number(history, "3", 1) == 3


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
        for k in range(3):
            assert np.any((leg == k) & (s == 1.0))
        assert time[(leg == 1) & (s == 1.0)][0] == pytest.approx(way[:2].sum() / way.sum())
    assert np.diff(evenly_spaced(table, 2, 60)[2]).max() < 1.2 / 59
    # at rest nothing is loaded and nothing to be seen
    assert evenly_spaced(table, 0, 5)[2][0] > 0.0
    assert np.all(np.diff(evenly_spaced(table, 0, 5)[2]) > 0.0)
