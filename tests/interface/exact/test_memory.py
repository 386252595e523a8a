"""What the exact path remembers of earlier legs changes nothing, on legs that repeat themselves."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from problems import problem
from small import random_system, table

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.evolution.run_state import energy_error
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.system import ContactState, Leg, frictional_form
from receding_fenicsx.interface.uniqueness.instants import Sides
from receding_fenicsx.interface.uniqueness.watch import Uniqueness, UniquenessWatch

pytestmark = pytest.mark.one_rank

LEGS = 40


def random_walk(rng: np.random.Generator, loads: int) -> Iterator[tuple[Array, Array]]:
    """Yield legs between points of a lattice of load factors, whose directions repeat."""
    at = np.zeros(loads)
    at[0] = 1.0
    for _ in range(LEGS):
        to = at.copy()
        to[rng.integers(loads)] += 0.5 * rng.choice([-1, 1])
        if rng.random() < 0.3:
            to[rng.integers(loads)] += 0.5 * rng.choice([-1, 1])
        if 0.5 <= to[0] <= 2.0 and np.abs(to[1:]).max(initial=0.0) <= 1.0:
            yield at, to
            at = to


# the first two once went wrong, by memory of an opening that needed both friction limits
@pytest.mark.parametrize("number", [395, 586, *range(20)])
def test_legs_are_those_of_a_solver_without_memory(number: int) -> None:
    system, rng = problem(number).system, np.random.default_rng(number)
    loads, model = len(system.load_names), frictional_form(system)
    first = np.eye(loads)[0]
    try:
        record = evolve(system, table(system, [np.zeros(loads), first]))
    except SolveError:
        return
    state, scale = turning_point(record, system, -1), 0.0
    force, path = float(np.abs(state.r).max()), EventPath(model)
    for ends in random_walk(rng, loads):
        try:
            fresh = EventPath(model).trace_leg(state, ends, force, 1)
        except SolveError:
            with pytest.raises(SolveError):
                path.trace_leg(state, ends, force, 1)
            return
        leg = path.trace_leg(state, ends, force, 1)
        error, scale = energy_error(model, state, ends, leg, scale)
        assert error < 1e-7
        assert np.abs(leg.end.r - fresh.end.r).max() < 1e-9 * leg.force_scale
        state, force = leg.end, leg.force_scale


def test_a_leg_is_judged_alike_whatever_legs_were_judged_before() -> None:
    """Legs without events from all states of two nodes, in three directions, in any order."""
    begin, doubts = Uniqueness(certified=True, proved=True), 0
    for seed in range(8):
        system, rng = random_system(seed, 2, 4.0), np.random.default_rng(seed)
        watch = UniquenessWatch(system, begin)
        legs = [*product(product((1, 2, 3, 4), repeat=2), ([0.5, 0.0], [0.0, 0.5], [0.0, -0.5]))]
        for k in rng.permutation(len(legs)):
            start = ContactState(np.zeros(4), np.zeros(4), np.array(legs[k][0], np.int8))
            ends, found = (np.ones(2), 1.0 + np.array(legs[k][1])), list[Uniqueness]()
            for judge in (watch, UniquenessWatch(system, begin)):
                judge.found, judge._left = begin, 8
                judge.add((1, 0), start, ends, Leg(start, np.zeros(2), force_scale=1.0))
                found.append(replace(judge.found, margin=0.0))
            assert found[0] == found[1], (seed, legs[k])
            doubts += not found[0].certified
        # nor which sets of states are judged together
        every = [Sides.of(np.array(row, np.int8)) for row in product((1, 2, 3, 4), repeat=2)]
        watch = UniquenessWatch(system, begin)
        watch.judge(every)
        for one in every:
            alone = UniquenessWatch(system, begin)
            alone.judge([one])
            assert (one in alone.indefinite) == (one in watch.indefinite)
    assert doubts > 10
