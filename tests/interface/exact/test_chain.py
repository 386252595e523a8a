"""Replay of known events: the same path as from event to event, whatever was foreseen."""

from itertools import pairwise

import numpy as np
import pytest
from legs import assert_same, play
from models import block_system

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.replay import events as chain
from receding_fenicsx.interface.exact.segments import Segment
from receding_fenicsx.interface.residual import law_residual, local_stiffness
from receding_fenicsx.interface.system import reactions

LOADS = [[0.0], [1.0], *[[1.0 / 3.0], [1.0]] * 12]


@pytest.mark.parametrize("samples", [0, 3])
def test_a_replayed_path_is_that_from_event_to_event(
    samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, passed = block_system(40, 10), []
    plain = play(EventPath(system, check_all=True), LOADS, samples)
    monkeypatch.setattr(chain, "WORTH_WHILE", 1)
    monkeypatch.setattr(chain, "FEWEST", 1)
    verified = chain.Replay._verified

    def counting(self: chain.Replay, *args: object) -> tuple[Array, Array]:
        found = verified(self, *args)  # type: ignore[arg-type]
        passed.append(len(found[0]))
        return found

    monkeypatch.setattr(chain.Replay, "_verified", counting)
    legs = play(EventPath(system), LOADS, samples)
    assert_same(legs, plain)
    assert sum(passed) > 0.2 * sum(len(leg.events) for leg in plain)
    # the contact law at every event, reactions evaluated afresh
    at_rest, stiffness = np.zeros(system.n), local_stiffness(system)
    for leg, (a, b) in zip(legs, pairwise(np.array(LOADS)), strict=True):
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
        plain = play(EventPath(system), LOADS, 3)
    monkeypatch.setattr(chain, "WORTH_WHILE", 1)
    monkeypatch.setattr(chain, "FEWEST", 1)
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
    assert_same(play(EventPath(system), LOADS, 3), plain)
    assert wrong[0] > 10
