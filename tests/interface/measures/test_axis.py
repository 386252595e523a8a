"""Whether a contact edge of a body of revolution begins on the axis."""

from __future__ import annotations

import numpy as np
import pytest
from nodal import nodal_forces, with_middles

from receding_fenicsx.interface.measures.zones import begins_on_axis

ENDS = {
    "disc": (0.0, np.arange(6.0), True),
    "graded disc": (0.0, np.array([0.0, 1.0, 4.0, 9.0]), True),
    "one element": (0.0, np.array([0.0, 1.0]), True),
    "hole of one element": (1.0, np.arange(6.0), False),
    "hole of half an element": (0.5, np.arange(6.0), False),
    "wide ring": (7.0, np.arange(6.0), False),
}
"""Radius where the edge begins, ends of its elements from there, and the answer."""


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slope", [1.0, 0.3])
@pytest.mark.parametrize("name", ENDS)
def test_only_an_edge_with_a_point_at_radius_zero_begins_on_the_axis(
    name: str, slope: float, degree: int
) -> None:
    """On a plane (slope 1) and on a cone; all weights may have a common factor."""
    begin, ends, expected = ENDS[name]
    s = with_middles(ends) if degree == 2 else ends
    radius = begin + slope * s
    weight = 2.0 * np.pi * nodal_forces(s, degree, lambda at: begin + slope * at)
    # at order 2 the node on the axis has no weight, and is no contact node
    kept = weight > 1e-9 * weight.max()
    assert np.all(kept[1:]) and kept[0] == (not expected or degree == 1)
    assert begins_on_axis(radius[kept], weight[kept]) == expected


def test_a_cylinder_does_not_begin_on_the_axis() -> None:
    radius = np.full(7, 3.0)
    assert not begins_on_axis(
        radius, 3.0 * nodal_forces(np.linspace(-1.0, 1.0, 7), 2, np.ones_like)
    )
