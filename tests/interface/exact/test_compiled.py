"""The compiled loop: room, memory, columns left out, ties, and rates that are wrong."""

import numpy as np
import pytest
from legs import asking, assert_same, play
from models import block_system

from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.exact import loop
from receding_fenicsx.interface.exact.loop import Loop
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.tableau import Tableau
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem

pytestmark = pytest.mark.once(False)
CYCLES = [[0.0], [1.0], *[[0.6], [1.0]] * 6]


def loop_of(path: EventPath) -> Loop:
    """Return the compiled loop that a path has used."""
    assert path._loop is not None
    return path._loop


def limited(system: ContactSystem, monkeypatch: pytest.MonkeyPatch) -> EventPath:
    """Return a path whose loop has no room and little memory."""
    monkeypatch.setattr(loop, "FIRST_ENTRIES", 4)
    monkeypatch.setattr(loop, "CACHE_BYTES", 32 * 4 * system.n * 8)
    path = EventPath(system)
    path._loop = Loop(path.segments)
    path._loop.room = 1
    return path


def test_a_loop_without_room_and_memory_asks_for_more(monkeypatch: pytest.MonkeyPatch) -> None:
    system = block_system(32, 16)
    expected = play(EventPath(system), CYCLES, 3)
    path = limited(system, monkeypatch)
    assert_same(play(path, CYCLES, 3), expected)
    assert loop_of(path).memory.used[0] <= 32 and loop_of(path).room > 1


def test_columns_that_are_left_out_come_back() -> None:
    system = block_system(64, 16)
    path, expected = EventPath(system), play(EventPath(system), CYCLES, 3)
    legs = play(path, CYCLES[:6], 3)
    tableau = path.segments.tableau_at_hand(legs[-1].end.state)
    assert tableau.left_out > 0
    # all that sticks is left out, the nodes that are going to slip as well
    state = legs[-1].end.state
    path.segments.leave_out(state, np.flatnonzero(np.tile(state == 1, 2)))
    assert_same(
        [path.trace_leg(legs[-1].end, (np.ones(1), np.full(1, 0.6)), 1.0, 3)], expected[5:6]
    )
    assert tableau.left_out == 0
    # nodes that slip together, of which one is left out
    slips, rate = np.where(state == 1, State.FORWARD_SLIP, state).astype(np.int8), np.ones(1)
    tableau.leave_out(state, np.flatnonzero(state == 1)[5:6])
    tableau.move_to(slips)
    known = Tableau(system, slips).rates(rate)
    assert np.abs(tableau.rates(rate) - known).max() <= 1e-11 * np.abs(known).max()


def test_rates_that_the_loop_asks_for_are_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    system = block_system(32, 16)
    expected = play(EventPath(system), CYCLES, 3)
    asking(monkeypatch)
    assert_same(play(EventPath(system), CYCLES, 3), expected)


@pytest.mark.parametrize("error", [1e-4, 1e-8])
def test_wrong_rates_in_the_memory_do_not_pass_unnoticed(error: float) -> None:
    """Forces that do not belong to the displacements are found at the end of the leg at last."""
    system = block_system(32, 16)
    path = EventPath(system)
    now = play(path, CYCLES[:6])[-1]
    loop_of(path).memory.rates[:, 2 * system.n :] *= 1.0 + error
    with pytest.raises(SolveError, match="lost accuracy"):
        path.trace_leg(now.end, (np.array([1.0]), np.array([0.6])), now.force_scale)
