"""Tractions between nodes, from forces that shape functions give exactly."""

import numpy as np
from nodal import nodal_forces, with_middles

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.measures.tractions import midside_nodes, traction_at


def laid_out(degree: int, elements: int) -> tuple[Array, Array, Array]:
    """Nodes, weights and nodal forces of cos(2 x) on an edge with unequal elements."""
    s = np.linspace(0.0, 1.0, elements + 1)
    ends = s + 0.3 * s**2
    x = ends if degree == 1 else with_middles(ends)
    weight = nodal_forces(x, degree, np.ones_like)
    return x, weight, nodal_forces(x, degree, lambda at: np.cos(2.0 * at))


def test_midside_nodes_are_seen_in_the_weights() -> None:
    for elements in (8, 9):
        x, weight, _ = laid_out(1, elements)
        assert len(midside_nodes(x, weight)) == 0
        x, weight, _ = laid_out(2, elements)
        assert list(midside_nodes(x, weight)) == list(range(1, 2 * elements, 2))
        # round the axis, where the axis itself has no weight, or no node
        around = weight * x
        assert list(midside_nodes(x, around, x))[1:] == list(range(3, 2 * elements, 2))
        assert list(midside_nodes(x[1:], around[1:], x[1:])) == list(range(2, 2 * elements - 1, 2))


def test_tractions_between_nodes_are_closer_than_the_lumped_ones() -> None:
    x, weight, force = laid_out(2, 40)
    inside = np.linspace(0.2, 1.1, 50)
    off = np.abs(traction_at(x, weight, force, inside) - np.cos(2.0 * inside)).max()
    lumped = np.abs(force / weight - np.cos(2.0 * x))[4:-4].max()
    assert off < 2e-5
    assert off < 0.2 * lumped
