"""Newton's method for the limit: derivatives against differences, and cycles that repeat slowly."""

import numpy as np
import pytest
from models import block_system
from small import cyclic

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.limit.frozen import Budget, Frozen
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle
from receding_fenicsx.evolution.limit.newton import approach, margin_rows, smallest_margins
from receding_fenicsx.evolution.limit.sorting import sort_nodes
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import FORWARD, STICK
from receding_fenicsx.interface.normal_form import frictional_form
from receding_fenicsx.interface.residual import residual_at_rest
from receding_fenicsx.interface.system import ContactState, reactions

pytestmark = pytest.mark.one_rank


def frozen_contact(minimum: float) -> tuple[Frozen, Array, FrozenCycle]:
    """Return the block with its nodes sorted after two cycles, the drifts and the limit cycle."""
    system, history = block_system(40, 20), cyclic(2, minimum)
    record = evolve(system, history)
    start, model = turning_point(record, system, -1), frictional_form(system)
    force = float(np.abs(start.r).max())
    nodes = sort_nodes(model, EventPath(model), start, history.loop, force)
    held, drifting = np.flatnonzero(nodes.frozen), np.flatnonzero(nodes.drifting)
    frozen = Frozen(model, held, drifting, history.loop, force, Budget(500))
    start.state[held] = 1
    *_, solution = approach(frozen, start, np.zeros(len(drifting)))
    assert solution.steps <= 5 and solution.residual < 1e-13
    return frozen, solution.shifts, solution.cycle


def test_what_a_cycle_has_still_to_forget_is_that_of_cycles_played() -> None:
    frozen, x, cycle = frozen_contact(0.05)
    away = x + 1e-4 * np.abs(x).max() * np.cos(np.arange(len(x)))
    first = frozen.cycle(frozen.shift(cycle.end, x, away), away)
    left, state = frozen.to_forget(first), first.end
    for _ in range(8):
        last = frozen.cycle(state, away)
        state = last.end
    assert left is not None
    played, size = last.start.u - first.start.u, np.abs(first.change).max()
    assert size > 1e-9 * np.abs(x).max()
    assert np.abs(left.S[:, 0] - played).max() < 1e-6 * size
    moved = first.moved(left)
    assert len(moved.stops) == len(last.stops)
    for one, other in zip(moved.stops, last.stops, strict=True):
        assert np.abs(one.u - other.u).max() < 1e-5 * size


def test_a_node_that_sticks_beyond_its_limit_slips_back_to_it() -> None:
    frozen, x, cycle = frozen_contact(1 / 3)
    system, start, load = frozen.segments.system, cycle.start, np.append(frozen.loop[0], x)
    assert frozen.allowed(start) is start
    i, u, states = (
        int(np.flatnonzero(start.state == FORWARD)[0]),
        start.u.copy(),
        start.state.copy(),
    )
    u[i] -= 1e-6 * frozen.force / system.diagonal[i]
    states[i] = STICK
    beyond = ContactState(u, reactions(system, load, u), states)
    assert residual_at_rest(system, beyond, frozen.force) > 1e-9
    back = frozen.allowed(beyond)
    assert back is not None and back.state[i] == FORWARD and back.v[i] > beyond.v[i]
    assert residual_at_rest(system, back, frozen.force) < 1e-13
    assert np.abs(back.r - reactions(system, load, back.u)).max() < 1e-13 * frozen.force


@pytest.mark.parametrize("minimum", [0.05, 1 / 3])
def test_the_derivatives_of_the_margins_are_those_of_differences(minimum: float) -> None:
    frozen, x, cycle = frozen_contact(minimum)
    nodes, small = frozen.shifted, 1e-6 * np.abs(x).max()
    one = np.ones(len(nodes))
    now = smallest_margins(frozen, cycle, nodes)
    moved = frozen.periodic_change(cycle)
    J = margin_rows(frozen, cycle, nodes, one, now.at_A).moved(moved, nodes)
    compared = 0
    for i in range(0, len(nodes), 3):
        shifted = x + small * (np.arange(len(nodes)) == i)
        state = frozen.shift(cycle.end, x, shifted)
        for _ in range(5):
            again = frozen.cycle(state, shifted)
            state = again.end
        assert [stop.label for stop in again.stops] == [stop.label for stop in cycle.stops]
        then = smallest_margins(frozen, again, nodes)
        same = then.at_A == now.at_A  # another stop has another derivative
        compared += int(same.sum())
        assert np.abs((then.A - now.A) / small - J[:, i])[same].max() < 1e-6 * np.abs(J).max()
    assert compared > 0.8 * len(nodes) * len(range(0, len(nodes), 3))


@pytest.mark.parametrize("freed", [True, False])
def test_rates_of_known_states_serve_with_other_frozen_nodes(freed: bool) -> None:
    frozen, _, cycle = frozen_contact(0.05)
    rubbing = np.flatnonzero(frozen.segments.frictional)
    # one frozen node is freed, or two nodes that rub are frozen, too
    held = frozen.nodes[1:] if freed else np.union1d(frozen.nodes, rubbing[:2])
    others = (held, held[:0], frozen.loop, frozen.force, Budget(1))
    fresh, taken = Frozen(frozen.system, *others), Frozen(frozen.system, *others, before=frozen)
    differ = np.flatnonzero(fresh.segments.frictional != frozen.segments.frictional)
    states = [stop.state for stop in cycle.stops if np.all(stop.state[differ] == STICK)]
    assert len(states) > 10 and len(differ) == (1 if freed else 2)
    for direction in np.diff(frozen.loop, axis=0):
        known = [
            state for state in states if frozen.segments.known(state, way_of(frozen, direction))
        ]
        assert known
        for state in known:
            q, p = (one.segments.at(state, direction).q for one in (taken, fresh))
            assert np.abs((q - p) * fresh.segments.weight).max() < 1e-11 * np.abs(p).max()
    assert taken.segments.trials == fresh.segments.trials
    # no tableau was needed
    assert taken.segments._tableau is None
    assert fresh.segments._tableau is not None


def way_of(frozen: Frozen, direction: Array) -> Array:
    """Return the changes of all load factors along a leg, those of the shifts included."""
    return np.append(direction, np.zeros(len(frozen.shifted)))
