"""Hysteresis loops and the paths of single nodes."""

import dataclasses
from functools import cache

import models
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.output.plots.cycle_plots import moving_loads
from receding_fenicsx.output.plots.labels import Scales, leg_pieces

pytestmark = pytest.mark.one_rank

CYCLES = 25


@cache
def record() -> rf.Record:
    return rf.evolve(models.block_system(40, 20), cyclic(CYCLES))


def test_path_of_a_cycle_goes_from_turning_point_to_turning_point() -> None:
    found = record()
    for cycle in (1, 9, CYCLES):
        loop, table = rf.loop_of(found, cycle), found.turning_points
        rows = np.flatnonzero(np.isin(table.cycle, (cycle - 1, cycle)))[-3:]
        assert np.array_equal(loop.q[loop.turning], table.q[rows])
        assert np.array_equal(loop.load[loop.turning], [[1.0], [1.0 / 3.0], [1.0]])
        middle = int(np.flatnonzero(loop.turning)[1])
        assert np.all(np.diff(loop.load[: middle + 1, 0]) < 0.0)
        assert np.all(np.diff(loop.load[middle:, 0]) > 0.0)
    for number, moving in ((8, [*range(8)]), (9, [])):  # of more loads than eight none is drawn
        load, moved = (np.tile(part, number) for part in (loop.load, loop.displacement))
        assert moving_loads([dataclasses.replace(loop, load=load, displacement=moved)]) == moving


@pytest.mark.parametrize("slip", [None, "0.01*x"])
def test_path_of_the_first_loading_begins_at_rest(slip: str | None) -> None:
    """All is zero there, but for an initial slip, whose first leg is one jump."""
    loads = (rf.Load("p0", "top", pressure=1.0),)
    scene = rf.Scene(loads=loads, history=rf.HistoryOptions(initial_slip=slip))
    found = dataclasses.replace(record(), scene_toml=rf.to_toml(scene))
    loop = rf.loop_of(found, 0)
    begins = [part[0] for part in (loop.load, loop.displacement, loop.p, loop.q, loop.v, loop.w)]
    assert all(np.all(part == 0.0) for part in begins) == (slip is None)
    assert len({len(part) for part in (loop.load, loop.v, loop.turning)}) == 1
    assert loop.load[-1] == [1.0] and loop.turning.tolist() == [False] * (len(loop.v) - 1) + [True]


@pytest.mark.parametrize("mu", [0.0, 50.0])
def test_round_off_is_not_drawn_as_a_loop(mu: float) -> None:
    # without friction, and with so much that nothing slips, loading and unloading are one way
    system = models.block_system(40, 20)
    system = dataclasses.replace(system, f=np.full_like(system.f, mu))
    found = rf.evolve(system, cyclic(2, minimum=0.5))
    for line in rf.figures.hysteresis(found).axes[1].lines:
        assert np.all(np.asarray(line.get_xdata()) == 0.0)
    for axes in rf.figures.trajectories(found).axes[:3]:
        for line in axes.lines:
            q = np.asarray(line.get_xdata())
            assert np.all(q == 0.0) if mu == 0.0 else np.any(q != 0.0)


@pytest.mark.parametrize("backward", [None, 0.6])
def test_trajectories_stay_in_the_friction_cone_that_is_drawn(backward: float | None) -> None:
    system = models.block_system(40, 20)
    f_backward = None if backward is None else np.full(system.n, backward)
    found = rf.evolve(dataclasses.replace(system, f_backward=f_backward), cyclic(2))
    for axes in rf.figures.trajectories(found).axes[:4]:
        (cone,) = axes.collections
        assert np.allclose(np.asarray(cone.get_facecolor())[0, :3], to_rgb(rf.style.CONE["fc"]))
        corners = np.asarray(cone.get_paths()[0].vertices)
        ends = [side(corners[:, 0]) / axes.get_ylim()[1] for side in (np.min, np.max)]
        assert axes.viewLim.x0 < corners[:, 0].min() < corners[:, 0].max() < axes.viewLim.x1
        assert ends == pytest.approx([-0.35, backward or 0.35], rel=1e-9)
        for line in axes.lines:
            q, p = np.array(line.get_data())
            for side, end in zip((-1.0, 1.0), ends, strict=True):
                assert np.all(side * q <= side * end * p * (1.0 + 1e-9) + 1e-12)


def test_the_plane_of_a_node_with_a_gap_is_drawn_where_it_touches() -> None:
    """K = I pressed by lambda: the gap 0.3 closes at lambda = 0.3, where w = -0.3."""
    node = small_system(np.eye(2), {"press": [0.0, 1.0]}, 0.5, 0.3)
    found = rf.evolve(node, table(node, [0.0, 1.0], [1.0, 0.0, 1.0], 1))
    below = rf.figures.trajectories(found, nodes=[0]).axes[-1]
    (plane,) = (
        line for line in below.lines if np.array_equal(np.asarray(line.get_xdata()), [0, 1])
    )
    w = np.concatenate([line.get_ydata() for line in below.lines])
    assert np.asarray(plane.get_ydata())[0] == pytest.approx(w.min(), rel=1e-12)
    assert w.max() == 0.0
    # legs of a cycle of more than two have numbers
    found = rf.evolve(node, table(node, [0.0, 1.0], [1.0, 0.2, 0.8, 1.0], 1))
    assert leg_pieces(1, 2, Scales(found)) == ["cycle 1, leg 2"]
