"""A record asked by names, and as labelled tables."""

from dataclasses import replace
from functools import cache

import models
import numpy as np
import pytest
from small import cyclic, random_system, table

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record

pytestmark = pytest.mark.one_rank


@cache
def record() -> Record:
    return evolve(models.block_system(20, 10), cyclic(3, 0.25))


def test_turning_points_are_found_by_the_size_of_the_load() -> None:
    found, table = record(), record().turning_points
    for cycle in (1, 2, 3):
        rows = np.flatnonzero(table.cycle == cycle)
        low, high = found.at(cycle, "minimum"), found.at(cycle, "maximum")
        assert (low.load["p0"], high.load["p0"]) == (0.25, 1.0)
        assert np.array_equal(low.p, table.p[rows[0]])
        assert np.array_equal(high.v, table.v[rows[1]])
        assert high.load_displacement["p0"] == table.load_displacement[rows[1], 0]
        assert np.array_equal(found.at(cycle).state, high.state)
        assert found.at(cycle - 4).cycle == cycle


def test_extremes_of_several_loads_do_not_depend_on_their_units() -> None:
    system = random_system(3, 4, 0.4)
    loop = [[0.5, 0.0], *[[1.0, 0.1], [0.3, 0.4]] * 2, [0.5, 0.0]]
    # over the largest in the history, not in the cycle
    found = evolve(system, table(system, [[0.0, 0.0], [0.5, 4.0], loop[0]], loop, 1))
    for units in ([1.0, 1.0], [1e3, 1.0], [1.0, 1e3]):
        points = found.turning_points
        other = replace(found, turning_points=replace(points, load=points.load * units))
        # of equal ones the last
        assert (other.at(1, "maximum").leg, other.at(1, "minimum").leg) == (2, 3)


def test_instants_and_nodes_of_a_dataset_are_selected_by_coordinates() -> None:
    found = record()
    data = found.to_xarray()
    third = data.sel(cycle=3)
    assert third.sizes["instant"] == 2
    low = third.sel({"load.p0": 0.3}, method="nearest")
    assert np.array_equal(low.p.values, found.at(3, "minimum").p)
    assert np.array_equal(third.sel(leg=1).q.values, found.at(3, leg=1).q)
    node = int(np.argmin(np.abs(found.x - 0.52)))
    assert float(data.sel(x=0.52, method="nearest").x) == found.x[node]
    assert np.array_equal(data.sel(x=found.x[node]).v.values, found.turning_points.v[:, node])
    assert dict(data.sizes) == {"instant": 7, "node": len(found.x), "load": 1}
    assert float(low.load_factor.sel(load="p0")) == 0.25
    frame = found.to_pandas()
    frame = frame[(frame.cycle == 3) & (frame["load.p0"] == 0.25)].sort_values("x")
    assert np.array_equal(frame.p.to_numpy(), low.p.values)
    samples = found.to_xarray("samples").sel(cycle=2).sel(leg=0)
    half = samples.sel(s=0.5, method="nearest")
    assert np.array_equal(half.P.values, found.at(2, leg=0, s=float(half.s)).P)


def test_contact_edges_of_a_dataset_are_selected_by_name() -> None:
    found = record()
    n = len(found.x)
    # two edges with the same x, as those of a dovetail
    edge = np.repeat([0, 1], [n // 2, n - n // 2])
    x = np.concatenate([found.x[: n // 2], found.x[: n - n // 2]])
    two = replace(found, x=x, edge=edge, edge_names=("left", "right"), f_backward=0.5 * found.f)
    with pytest.raises(InputError, match=r"several contact edges; .*\['left'\]"):
        two.at(1)
    part = two.to_xarray().sel(edge="right")
    assert np.array_equal(part.P.values, found.turning_points.P[:, n // 2 :])
    nearest = part.sel(x=x[2] + 1e-3, method="nearest")
    assert np.array_equal(nearest.P.values, found.turning_points.P[:, n // 2 + 2])
