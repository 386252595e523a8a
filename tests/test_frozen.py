"""Paths on which nodes that keep their state are left out equal those of the whole contact."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from law import random_system
from models import block_system

from receding_fenicsx.interface import events, frozen
from receding_fenicsx.interface.contact import ContactState, ContactSystem, Leg
from receding_fenicsx.interface.events import EventPath
from receding_fenicsx.interface.frozen import widen


def play(path: EventPath, loads: list[list[float]]) -> list[Leg]:
    """Follow a polyline of load factors from rest."""
    n = path.system.n
    now, scale, legs = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, np.int8)), 0.0, []
    for a, b in pairwise(np.array(load) for load in loads):
        legs.append(path.trace_leg(now, (a, b), scale, samples=3))
        now, scale = legs[-1].end, legs[-1].force_scale
    return legs


def whole(system: ContactSystem) -> EventPath:
    """Return a path on which nothing is left out."""
    path = EventPath(system)
    path._walk_reduced = lambda *_: None  # type: ignore[method-assign]
    return path


def assert_equal(legs: list[Leg], others: list[Leg], states: bool = True) -> None:
    """Assert that two paths are the same to round-off.

    On settled cycles events crowd at the end of a leg, where round-off decides of ``states``.
    """
    force = others[-1].force_scale
    for leg, other in zip(legs, others, strict=True):
        for a, b in [(leg.end, other.end), *zip_states(leg, other)]:
            assert not states or np.array_equal(a.state, b.state)
            assert np.abs(a.u - b.u).max() <= 1e-11 * np.abs(others[0].end.u).max()
            assert np.abs(a.r - b.r).max() <= 1e-11 * force
        D = max(other.dissipation.sum(), 1e-6 * force)
        assert np.abs(leg.dissipation - other.dissipation).max() <= 1e-10 * D
        assert leg.work == pytest.approx(other.work, rel=1e-10)
        if states:
            assert [event[1:] for event in leg.events] == [event[1:] for event in other.events]


def zip_states(leg: Leg, other: Leg) -> list[tuple[ContactState, ContactState]]:
    """Return the samples of two legs in pairs."""
    return [(a, b) for (_, a), (_, b) in zip(leg.samples, other.samples, strict=True)]


CYCLES = [[0.0], [1.0], *[[0.6], [1.0]] * 6]


@pytest.mark.parametrize("half", [True, False])
def test_leaving_nodes_out_changes_no_answer(half: bool) -> None:
    system = block_system(64, 16, half=half)
    path = EventPath(system)
    legs = play(path, CYCLES)
    assert path.reduction is not None and len(path.reduction.nodes) < 0.8 * system.n
    assert_equal(legs, play(whole(system), CYCLES))


def test_the_energy_of_a_path_with_nodes_left_out_is_whole() -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    legs = play(path, CYCLES)
    assert path.reduction is not None
    for before, leg in pairwise(legs):
        stored = 0.5 * (leg.end.u - before.end.u) @ system.K @ (leg.end.u + before.end.u)
        assert abs(leg.dissipation.sum() + stored + leg.work) <= 1e-12 * abs(stored)


def test_a_frozen_node_that_reaches_a_limit_is_noticed() -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    play(path, CYCLES[:4])
    # forget what changed: far too few nodes are taken for active now
    for changed in path.changed.values():
        changed[:] = False
    start = play(whole(system), CYCLES[:4])[-1]
    leg = path.trace_leg(start.end, (np.array([1.0]), np.array([0.6])), start.force_scale, 3)
    expected = whole(system).trace_leg(
        start.end, (np.array([1.0]), np.array([0.6])), start.force_scale, 3
    )
    assert_equal([leg], [expected])


def test_without_the_watch_the_answer_would_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    start = play(path, CYCLES[:4])[-1]
    for changed in path.changed.values():
        changed[:] = False
    blind = np.zeros(0, dtype=np.intp)
    monkeypatch.setattr(frozen.Reduction, "leaving", lambda *_: blind)
    monkeypatch.setattr(frozen, "residual_at_rest", lambda *_: 0.0)
    ends = np.array([1.0]), np.array([0.6])
    leg = path.trace_leg(start.end, ends, start.force_scale)
    expected = whole(system).trace_leg(start.end, ends, start.force_scale)
    assert np.abs(leg.end.r - expected.end.r).max() > 1e-3 * start.force_scale


def test_random_systems_with_two_loads_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    # neighbours in number are no neighbours in a random system
    monkeypatch.setattr(events, "widen", lambda changed: changed)
    loop = [[1.0, 0.0], [0.9, 0.1], [0.95, -0.1], [1.0, 0.0]]
    loads = [[0.0, 0.0], *loop[:1], *(loop[1:] * 4)]
    reduced = 0
    for seed in range(15):
        system = random_system(seed, 14, 0.4)
        if seed % 3 == 0:
            system = replace(system, f=np.where(np.arange(14) % 5 == 0, 0.0, system.f))
        path = EventPath(system)
        assert_equal(play(path, loads), play(whole(system), loads), states=False)
        reduced += path.reduction is not None
    assert reduced >= 5


def test_active_ranges_are_widened_on_both_sides() -> None:
    changed = np.zeros(12, dtype=bool)
    changed[[0, 7]] = True
    assert np.flatnonzero(widen(changed)).tolist() == [0, 1, 2, 5, 6, 7, 8, 9]
