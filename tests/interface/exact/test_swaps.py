"""Rates in new sets of states from those of their neighbours."""

from collections.abc import Callable
from dataclasses import replace

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

from receding_fenicsx.interface.exact import walk
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.segments import Following, Segment, Segments
from receding_fenicsx.interface.exact.swaps import beside, changed, overtaking
from receding_fenicsx.interface.exact.tableau import EXCHANGES, A, B
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.system import ContactSystem

RandomCase = Callable[[int], tuple[ContactSystem, list[list[float]]]]

CASES = [
    under_four_loads,
    tall_under_four_loads,
    gapped_under_four_loads,
    directed_under_four_loads,
]

SINGLE = [change for change, pairs in EXCHANGES.items() if len(pairs) == 1]
"""Changes of state of a node by one exchange."""


@pytest.fixture
def overtaken(monkeypatch: pytest.MonkeyPatch) -> list[Following]:
    """Collect what came of events that overtook others."""
    found: list[Following] = []

    def noting(*args: object) -> Following | None:
        following = overtaking(*args)  # type: ignore[arg-type]
        found.extend([following] if following else [])
        return following

    monkeypatch.setattr(walk, "overtaking", noting)
    return found


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("case", CASES)
def test_the_fourth_rates_are_those_of_the_tableau(case: RandomCase, seed: int) -> None:
    system, loop = case(seed)
    rng, way, n = np.random.default_rng(seed), np.array(loop[1]) - np.array(loop[0]), system.n
    compared = 0
    for _ in range(20):
        state = rng.integers(1, 5, n).astype(np.int8)
        i, j = rng.choice(np.flatnonzero(system.friction.present & ~system.held[:n]), 2, False)
        a, b = (
            (int(k), *chosen[rng.integers(len(chosen))])
            for k in (i, j)
            if (chosen := [one for one in SINGLE if one[0] == state[k]])
        )
        segments = Segments(system)
        try:
            known = [segments.at(s, way) for s in (state, changed(state, a))]
            known.append(segments.at(changed(changed(state, a), b), way))
            expected = Segments(system).at(changed(state, b), way)
        except SingularExchange:
            continue
        trials = segments.trials
        if beside(segments, state, b, a, way):
            found = segments.at(changed(state, b), way)
            assert segments.trials == trials
            largest = max(np.abs(one.q * segments.weight).max() for one in (*known, expected))
            assert np.abs((found.q - expected.q) * segments.weight).max() < 1e-9 * largest
            compared += 1
    assert compared > 10


def test_rates_of_a_body_that_nothing_holds_are_left_to_the_tableau() -> None:
    """One node sticks, all others slip or are open; once it slips, too, the block slides freely."""
    rng, way = np.random.default_rng(0), np.array([1.0, 0.5])
    block = block_system(8, 2, half=False)
    n = block.n
    push = np.concatenate([-0.3 * block.weight, np.zeros(n)])
    system = replace(
        block,
        r_star=np.vstack([block.r_star, push]),
        load_names=("press", "push"),
        load_compliance=np.zeros((0, 0)),
    )
    singular = 0
    for _ in range(40):
        i, j = (int(k) for k in rng.choice(n, 2, False))
        state = rng.integers(2, 5, n).astype(np.int8)
        state[i], state[j] = STICK, rng.integers(FORWARD, BACKWARD + 1)
        a, b = (j, int(state[j]), STICK), (i, STICK, int(rng.integers(FORWARD, BACKWARD + 1)))
        segments, with_a = Segments(system), changed(state, a)
        try:
            for known in (state, with_a, changed(with_a, b)):
                segments.at(known, way)
        except SingularExchange:
            continue
        with pytest.raises(SingularExchange):
            Segments(system).at(changed(state, b), way)
        assert not beside(segments, state, b, a, way)
        singular += 1
    assert singular > 5


def test_events_in_another_order_need_no_tableau(overtaken: list[Following]) -> None:
    system = block_system(80, 20)
    loads = [[0.0], [1.0], *[[1.0 / 3.0], [1.0]] * 15]
    plain = play(EventPath(system, check_all=True), loads)
    assert not overtaken
    assert_same(play(EventPath(system), loads), plain)
    assert len(overtaken) > 50


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", CASES)
def test_corners_in_random_order(case: RandomCase, seed: int) -> None:
    system, loop = case(seed)
    order = np.random.default_rng(seed).integers(1, min(len(loop), 4), 20)
    loads = [[0.0] * len(loop[0]), loop[0], *(loop[k] for k in order)]
    assert_that_of_single_events(system, loads)


def test_a_node_does_not_overtake_itself() -> None:
    """Events that came last are those of a node that first slips, then opens."""
    system, way = block_system(20, 5), np.array([1.0])
    segments, i, n = Segments(system), 15, system.n
    states = [np.full(n, STICK, dtype=np.int8)]
    changes = [(i, STICK, FORWARD), (i, FORWARD, SEPARATION)]
    for change in changes:
        states.append(changed(states[-1], change))
    made: list[Segment] = [segments.at(state, way) for state in states]
    labels = [A * n + i, B * n + i]
    for k, (change, label) in enumerate(zip(changes, labels, strict=True)):
        made[k].last = Following(label, states[k + 1], made[k + 1], [change])
    segments.at(changed(states[0], (i, STICK, SEPARATION)), way)
    assert overtaking(segments, made[0], states[0], labels[1], way) is None
