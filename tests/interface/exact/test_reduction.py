"""Paths on which nodes that keep their state are left out equal those of the whole contact."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from law import random_system
from legs import play
from models import block_system

from receding_fenicsx.interface.exact import path as exact_path
from receding_fenicsx.interface.exact import reduction
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.reduction import reduce, widen
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg


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
    legs = play(path, CYCLES, 3)
    assert path.reduction is not None and len(path.reduction.nodes) < 0.8 * system.n
    assert_equal(legs, play(whole(system), CYCLES, 3))


def test_the_energy_of_a_path_with_nodes_left_out_is_whole() -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    legs = play(path, CYCLES, 3)
    assert path.reduction is not None
    for before, leg in pairwise(legs):
        stored = 0.5 * (leg.end.u - before.end.u) @ system.K @ (leg.end.u + before.end.u)
        assert abs(leg.dissipation.sum() + stored + leg.work) <= 1e-12 * abs(stored)


def test_a_frozen_node_that_reaches_a_limit_is_noticed() -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    play(path, CYCLES[:4], 3)
    # forget what changed: far too few nodes are taken for active now
    for changed in path.changed.values():
        changed[:] = False
    start = play(whole(system), CYCLES[:4], 3)[-1]
    leg = path.trace_leg(start.end, (np.array([1.0]), np.array([0.6])), start.force_scale, 3)
    expected = whole(system).trace_leg(
        start.end, (np.array([1.0]), np.array([0.6])), start.force_scale, 3
    )
    assert_equal([leg], [expected])


def test_without_the_watch_the_answer_would_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    system = block_system(64, 16)
    path = EventPath(system)
    start = play(path, CYCLES[:4], 3)[-1]
    for changed in path.changed.values():
        changed[:] = False
    blind = np.zeros(0, dtype=np.intp)
    monkeypatch.setattr(reduction.Reduction, "leaving", lambda *_: blind)
    monkeypatch.setattr(reduction, "residual_at_rest", lambda *_: 0.0)
    ends = np.array([1.0]), np.array([0.6])
    leg = path.trace_leg(start.end, ends, start.force_scale)
    expected = whole(system).trace_leg(start.end, ends, start.force_scale)
    assert np.abs(leg.end.r - expected.end.r).max() > 1e-3 * start.force_scale


@pytest.mark.parametrize("seed", range(4))
def test_each_limit_of_a_left_out_node_is_watched(seed: int) -> None:
    """The watch against the law at every left-out node, for many displacements of the others."""
    n, left_out = 14, np.arange(4, 14)
    system = random_system(seed, n, 0.4)
    f = np.where(np.arange(n) % 4 == 3, 0.0, system.f * (0.5 + np.arange(n) / n))
    stuck, smooth = np.arange(n) % 4 < 2, np.arange(n) % 4 == 3
    system = replace(system, f=f, g0=np.where(stuck, 0.0, 0.1 + 0.05 * np.arange(n)))
    held = np.zeros(2 * n, dtype=bool)
    held[11] = True  # tangentially: P alone is limited there
    smooth[11] = True
    system = replace(system, g0=np.where(smooth, 0.0, system.g0), held=held)
    rng = np.random.default_rng(seed)
    state = np.where(stuck | smooth, 1, 2).astype(np.int8)
    # the last smooth node is open
    state[11 if seed % 2 else 7] = 2
    u = np.where(np.tile(state == 2, 2), 0.01, 0.0) * rng.standard_normal(2 * n)
    u[n:] -= np.where(state == 2, 0.0, system.g0)
    start = ContactState(u, np.zeros(2 * n), state)
    reduction = reduce(Segments(system), start, np.arange(n) < 4)
    assert reduction is not None
    seen: set[str] = set()
    for _ in range(400):
        load = np.array([rng.uniform(0.0, 8.0), rng.uniform(-2.0, 2.0)])
        moved = ContactState(0.5 * rng.standard_normal(8), np.zeros(8), state[:4])
        whole = reduction.expand(moved, load)
        Q, P, gap = whole.Q, whole.P, whole.w + system.g0
        open_ = state == 2
        # what is open bears nothing, what sticks stays where it was
        assert np.abs(P[left_out][open_[left_out]]).max() < 1e-12
        assert np.array_equal(whole.u[reduction.constant], u[reduction.constant])
        limits = {
            "P > 0": np.where(smooth & ~open_, P, 1.0),
            "Q > -f P": np.where(smooth | open_, 1.0, f * P + Q),
            "Q < f P": np.where(smooth | open_, 1.0, f * P - Q),
            "gap > 0": np.where(open_, gap, 1.0),
        }
        beyond = {(name, int(i)) for name, d in limits.items() for i in left_out if d[i] <= 0.0}
        found = reduction.leaving(moved.u[None], np.append(load, 1.0)[None], 1e-3)
        assert set(found.tolist()) == {i for _, i in beyond}
        nodes = [i for _, i in beyond]
        seen |= {name for name, i in beyond if nodes.count(i) == 1}
    # each limit was at least once the only one that a node had passed
    assert seen == {"P > 0", "Q > -f P", "Q < f P", "gap > 0"}


def test_random_systems_with_two_loads_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    # neighbours in number are no neighbours in a random system
    monkeypatch.setattr(exact_path, "widen", lambda changed: changed)
    loop = [[1.0, 0.0], [0.9, 0.1], [0.95, -0.1], [1.0, 0.0]]
    loads = [[0.0, 0.0], *loop[:1], *(loop[1:] * 4)]
    reduced = 0
    for seed in range(15):
        system = random_system(seed, 14, 0.4)
        if seed % 3 == 0:
            system = replace(system, f=np.where(np.arange(14) % 5 == 0, 0.0, system.f))
        path = EventPath(system)
        assert_equal(play(path, loads, 3), play(whole(system), loads, 3), states=False)
        reduced += path.reduction is not None
    assert reduced >= 5


def test_active_ranges_are_widened_on_both_sides() -> None:
    changed = np.zeros(12, dtype=bool)
    changed[[0, 7]] = True
    assert np.flatnonzero(widen(changed)).tolist() == [0, 1, 2, 5, 6, 7, 8, 9]
