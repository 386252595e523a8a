"""Cycles to come as an affine map of the last one: against the same cycles, played."""

import numpy as np
import pytest
from models import block_system
from small import cyclic

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.limit.tail import NoLimit, TracedCycle, follow, trace
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.system import frictional_form

pytestmark = pytest.mark.one_rank


def traced(minimum: float, cycles: int) -> tuple[TracedCycle, float, list[np.ndarray]]:
    """Return a cycle of the block, the largest nodal force, and u at the ends of those after it."""
    system, history = block_system(40, 20), cyclic(300, minimum)
    record = evolve(system, history)
    points = record.turning_points
    rows = [row for row in map(record.start_row, range(cycles, 300)) if row is not None]
    ends = [turning_point(record, system, row) for row in rows]
    force = float(max(np.abs(points.P).max(), np.abs(points.Q).max()))
    cycle = trace(Segments(frictional_form(system)), ends[0], history.loop, force)
    return cycle, force, [end.u for end in ends]


@pytest.mark.parametrize(("minimum", "cycles"), [(0.05, 30), (1 / 3, 30), (0.6, 20)])
def test_the_limit_and_cycles_to_come_are_those_played(minimum: float, cycles: int) -> None:
    cycle, force, ends = traced(minimum, cycles)
    tail = follow(cycle, force, 1e-10 * force)
    size = np.abs(ends[-1]).max()
    assert not tail.walks
    assert np.abs(ends[0] - ends[-1]).max() > 1e-7 * size
    assert np.abs(tail.u - ends[-1]).max() < 1e-11 * size
    for start, end in tail.others:  # releases come in another order there
        n = int(np.argmin([np.abs(start - u).max() for u in ends]))
        assert n > 0 and np.abs(start - ends[n]).max() < 1e-11 * size
        assert np.abs(end - ends[n + 1]).max() < 1e-11 * size
    if minimum == 0.6:  # it shakes down: the nodes that drift slip nowhere in the limit
        assert np.any(tail.drifting)


def test_a_tail_of_fewer_cycles_than_it_needs_is_no_limit() -> None:
    cycle, force, _ = traced(1 / 3, 10)
    with pytest.raises(NoLimit, match="another order"):
        follow(cycle, force, 1e-10 * force)
