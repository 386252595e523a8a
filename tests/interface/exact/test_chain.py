"""Replay of known events: the same path as from event to event, whatever was foreseen."""

from itertools import pairwise

import numpy as np
import pytest
from models import block_system

from receding_fenicsx.interface.exact import chain
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.segments import Segment
from receding_fenicsx.interface.system import ContactState, Leg

LOADS = np.array([[0.0], [1.0], *[[1.0 / 3.0], [1.0]] * 12])


def play(path: EventPath) -> list[Leg]:
    """Follow cycles of the block."""
    n = path.system.n
    now, scale, legs = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, np.int8)), 0.0, []
    for a, b in pairwise(LOADS):
        legs.append(path.trace_leg(now, (a, b), scale, samples=3))
        now, scale = legs[-1].end, legs[-1].force_scale
    return legs


def assert_same(legs: list[Leg], others: list[Leg]) -> None:
    """Assert that two paths have the same events, and the same forces to round-off."""
    force = others[-1].force_scale
    for leg, other in zip(legs, others, strict=True):
        assert [event[1:] for event in leg.events] == [event[1:] for event in other.events]
        pairs = [(leg.end, other.end)]
        pairs += [(a, b) for (_, a), (_, b) in zip(leg.samples, other.samples, strict=True)]
        for a, b in pairs:
            assert np.array_equal(a.state, b.state)
            assert np.abs(a.r - b.r).max() <= 1e-11 * force
        assert leg.dissipation == pytest.approx(other.dissipation, abs=1e-11 * force)
        assert leg.work == pytest.approx(other.work, rel=1e-10)
        assert leg.residual < 1e-11


@pytest.mark.parametrize("check_all", [False, True])
def test_a_replayed_path_is_that_from_event_to_event(
    check_all: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, passed = block_system(40, 10), []
    with monkeypatch.context() as patch:
        patch.setattr(chain, "SHORTEST", 10**6)
        plain = play(EventPath(system, check_all))
    monkeypatch.setattr(chain, "SHORTEST", 2)
    note = chain.Replay._note

    def counting(self: chain.Replay, *args: object) -> None:
        passed.append(len(args[1]))  # type: ignore[arg-type]
        note(self, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(chain.Replay, "_note", counting)
    assert_same(play(EventPath(system, check_all)), plain)
    assert sum(passed) > 0.2 * sum(len(leg.events) for leg in plain)


def test_wrong_foresight_changes_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreseen events are taken at random among those that have followed a segment."""
    system, rng = block_system(40, 10), np.random.default_rng(0)
    with monkeypatch.context() as patch:
        patch.setattr(chain, "SHORTEST", 10**6)
        plain = play(EventPath(system))
    monkeypatch.setattr(chain, "SHORTEST", 2)
    follow, wrong = chain.Replay.follow, [0]

    def misled(
        self: chain.Replay, segment: Segment, s_end: float, course: chain.Course
    ) -> Segment | None:
        for known in self._segments._known.values():
            if known.next and rng.random() < 0.2:
                steps = [step for label, step in known.next.items() if label >= 0]
                chosen = steps[int(rng.integers(len(steps)))] if steps else None
                wrong[0] += chosen is not known.last
                known.last = chosen
        return follow(self, segment, s_end, course)

    monkeypatch.setattr(chain.Replay, "follow", misled)
    assert_same(play(EventPath(system)), plain)
    assert wrong[0] > 10
