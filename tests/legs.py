"""Exact paths played leg by leg, and compared."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.system import Changes, ContactState, Leg
from receding_fenicsx.interface.tolerances import SIMULTANEOUS


def asking(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the loop ask for all rates from now on, as it does where motions are left free."""
    monkeypatch.setattr(Segments, "is_loose", True)


def play(path: EventPath, loads: Sequence[Sequence[float]], samples: int = 0) -> list[Leg]:
    """Follow a polyline of load factors from rest."""
    n = path.system.n
    states = np.where(path.system.g0 > 0.0, SEPARATION, STICK).astype(np.int8)
    now, scale, legs = ContactState(np.zeros(2 * n), np.zeros(2 * n), states), 0.0, []
    for a, b in pairwise(np.array(load) for load in loads):
        legs.append(path.trace_leg(now, (a, b), scale, samples))
        now, scale = legs[-1].end, legs[-1].force_scale
    return legs


def merged(events: Changes) -> list[tuple[float, int, int, int]]:
    """Return changes of state, successive ones of one node at one place as one.

    A stuck node whose forces vanish opens through slip in a direction that round-off decides.
    """
    kept: list[tuple[float, int, int, int]] = []
    for s, i, old, new in events:
        if kept and kept[-1][1] == i and s - kept[-1][0] <= SIMULTANEOUS:
            s, _, old, _ = kept.pop()
        kept.append((s, i, old, new))
    return kept


def assert_same(legs: list[Leg], others: list[Leg]) -> None:
    """Assert that two paths have the same events, and the same forces to round-off."""
    force = others[-1].force_scale
    for leg, other in zip(legs, others, strict=True):
        events, expected = merged(leg.events), merged(other.events)
        assert [event[1:] for event in events] == [event[1:] for event in expected]
        places = [event[0] for event in expected]
        assert [event[0] for event in events] == pytest.approx(places, abs=1e-9)
        pairs = [(leg.end, other.end)]
        pairs += [(a, b) for (_, a), (_, b) in zip(leg.samples, other.samples, strict=True)]
        for a, b in pairs:
            assert np.array_equal(a.state, b.state)
            assert np.abs(a.r - b.r).max() <= 1e-11 * force
        assert leg.dissipation == pytest.approx(other.dissipation, abs=1e-11 * force)
        assert leg.work == pytest.approx(other.work, rel=1e-10, abs=1e-12 * force)
        assert leg.residual < 1e-11
