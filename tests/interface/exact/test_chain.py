"""Replay of known events: the same path as from event to event, whatever was foreseen."""

from itertools import pairwise

import numpy as np
import pytest
from models import block_system

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.replay import events as chain
from receding_fenicsx.interface.exact.segments import Segment
from receding_fenicsx.interface.residual import law_residual, local_stiffness
from receding_fenicsx.interface.system import ContactState, Leg, reactions

LOADS = np.array([[0.0], [1.0], *[[1.0 / 3.0], [1.0]] * 12])


def play(path: EventPath, samples: int = 3) -> list[Leg]:
    """Follow cycles of the block."""
    n = path.system.n
    now, scale, legs = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, np.int8)), 0.0, []
    for a, b in pairwise(LOADS):
        legs.append(path.trace_leg(now, (a, b), scale, samples))
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


@pytest.mark.parametrize("samples", [0, 3])
def test_a_replayed_path_is_that_from_event_to_event(
    samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, passed = block_system(40, 10), []
    plain = play(EventPath(system, check_all=True), samples)
    monkeypatch.setattr(chain, "WORTH_WHILE", 1)
    verified = chain.Replay._verified

    def counting(self: chain.Replay, *args: object) -> tuple[Array, Array]:
        found = verified(self, *args)  # type: ignore[arg-type]
        passed.append(len(found[0]))
        return found

    monkeypatch.setattr(chain.Replay, "_verified", counting)
    legs = play(EventPath(system), samples)
    assert_same(legs, plain)
    assert sum(passed) > 0.2 * sum(len(leg.events) for leg in plain)
    # the contact law at every event, reactions evaluated afresh
    at_rest, stiffness = np.zeros(system.n), local_stiffness(system)
    for leg, (a, b) in zip(legs, pairwise(LOADS), strict=True):
        for s, u in leg.stops:
            r = reactions(system, (1.0 - s) * a + s * b, u)
            residual = law_residual(system, r, u, at_rest, stiffness).max()
            assert residual < 1e-11 * leg.force_scale
        assert not samples or len(leg.stops) > len({event[0] for event in leg.events}) // 2


def test_wrong_foresight_changes_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreseen events are taken at random among those that have followed a segment."""
    system, rng = block_system(40, 10), np.random.default_rng(0)
    with monkeypatch.context() as patch:
        patch.setattr(chain, "WORTH_WHILE", 10**6)
        plain = play(EventPath(system))
    monkeypatch.setattr(chain, "WORTH_WHILE", 1)
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
