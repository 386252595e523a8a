"""Events in new sets of states passed many at once: the path is that from event to event."""

from collections.abc import Callable

import numpy as np
import pytest
from legs import assert_same, assert_that_of_single_events, play
from models import (
    block_system,
    directed_under_four_loads,
    gapped_under_four_loads,
    tall_under_four_loads,
    under_four_loads,
)

from receding_fenicsx.interface.exact import ahead
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.segments import Following
from receding_fenicsx.interface.system import ContactSystem

CYCLES = [[0.0], [1.0], *[[1.0 / 3.0], [1.0]] * 4]

RandomCase = Callable[[int], tuple[ContactSystem, list[list[float]]]]


@pytest.fixture
def passed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the events passed at once."""
    counts: list[int] = []
    remembered = ahead.Ahead._remembered

    def counting(self: ahead.Ahead, *args: object) -> list[Following]:
        steps = remembered(self, *args)  # type: ignore[arg-type]
        counts.append(len(steps))
        return steps

    monkeypatch.setattr(ahead.Ahead, "_remembered", counting)
    return counts


def test_the_block_is_passed_many_events_at_once(passed: list[int]) -> None:
    system = block_system(80, 20)
    plain = play(EventPath(system, check_all=True), CYCLES)
    assert not passed
    legs = play(EventPath(system), CYCLES)
    assert_same(legs, plain)
    assert sum(passed) > 300


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "case",
    [
        under_four_loads,
        tall_under_four_loads,
        gapped_under_four_loads,
        directed_under_four_loads,
    ],
)
def test_random_loops_are_those_from_event_to_event(
    case: RandomCase, seed: int, passed: list[int]
) -> None:
    system, loop = case(seed)
    loads = [[0.0] * len(loop[0]), *loop, *loop[1:], *loop[1:]]
    assert_that_of_single_events(system, loads)


MISCHIEF = ["row", "state", "length", "rates"]


@pytest.mark.parametrize("what", MISCHIEF)
def test_what_is_found_wrongly_is_not_accepted(
    what: str, monkeypatch: pytest.MonkeyPatch, passed: list[int]
) -> None:
    system, rng = block_system(80, 20), np.random.default_rng(0)
    plain = play(EventPath(system, check_all=True), CYCLES)
    first, new_state, move = ahead.Rows.first, ahead.Rows.new_state, ahead.Rows.move
    spoilt: list[int] = []

    def now() -> bool:
        """Do mischief in one of ten cases."""
        chosen = bool(rng.random() < 0.1)
        spoilt.extend([1] * chosen)
        return chosen

    def other_row(self: ahead.Rows) -> tuple[int, float]:
        k, inverse = first(self)
        if inverse < ahead.VIOLATED and now():
            k = int(np.argsort(self._inverse)[-2])
            inverse = self._inverse.item(k)
        return k, inverse

    def other_state(self: ahead.Rows, k: int) -> int:
        new = new_state(self, k)
        return 1 + new % 4 if now() else new

    def other_length(self: ahead.Rows, h: float) -> None:
        move(self, h * (1.0 + 1e-6) if now() else h)

    def other_rates(self: ahead.Rows, h: float) -> None:
        move(self, h)
        if now():
            self.rate *= 1.0 + 1e-8 * rng.standard_normal(len(self.rate))

    replaced = {"row": other_row, "state": other_state, "length": other_length}
    name = {"row": "first", "state": "new_state"}.get(what, "move")
    monkeypatch.setattr(ahead.Rows, name, replaced.get(what, other_rates))
    assert_same(play(EventPath(system), CYCLES), plain)
    assert len(spoilt) > 5
    assert sum(passed) > 0
