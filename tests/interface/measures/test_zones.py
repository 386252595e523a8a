"""Zones and half widths of nodal states: their ends lie midway between nodes."""

import numpy as np
import pytest
from nodal import nodal_forces, with_middles

import receding_fenicsx as rf
from receding_fenicsx.interface.measures.zones import begins_on_axis


def coded(states: str) -> np.ndarray:
    """Return states from their letters: stick, open, forward, backward."""
    return np.array([1 + "SOFB".index(letter) for letter in states], dtype=np.int8)


def test_zones_end_midway_between_nodes() -> None:
    x = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    assert rf.zones(x, coded("OBSSSFO")) == [
        ("separation", -2.0, -1.5),
        ("backward slip", -1.5, -0.75),
        ("stick", -0.75, 0.75),
        ("forward slip", 0.75, 1.5),
        ("separation", 1.5, 2.0),
    ]
    assert rf.contact_half_width(x, coded("OBSSSFO")) == 1.5
    assert rf.stick_half_width(x, coded("OBSSSFO")) == 0.75
    assert rf.zones(x[4:], coded("OOO")) == [("separation", 0.5, 2.0)]
    assert rf.zones(x[:0], coded("")) == []


HALF_WIDTHS = {
    # as many nodes on the one side of the middle as on the other, or one more
    **{"FFSSSFF": 1.5, "FFSSSSF": 2.0, "FSSSSFF": 2.0, "FFFSFFF": 0.5, "SSSSSSS": 3.0},
    **{"FFFSSSF": np.nan, "FFFFSSF": np.nan, "SSFFFSS": np.nan, "FSFFSSF": np.nan, "FFFFFFF": 0.0},
}


@pytest.mark.parametrize(("states", "half"), HALF_WIDTHS.items())
def test_only_a_zone_around_the_middle_has_a_half_width(states: str, half: float) -> None:
    x, expected = np.arange(-3.0, 4.0), pytest.approx(half, nan_ok=True)
    assert rf.stick_half_width(x, coded(states)) == expected
    assert rf.contact_half_width(x, coded(states.replace("F", "O"))) == expected
    assert np.isnan(rf.contact_half_width(x, coded("SOSSSOS")))
    # without friction nothing sticks
    assert rf.stick_half_width(x, coded(states), np.zeros(7)) == 0.0
    alone = rf.stick_half_width(x, coded(states), 0.3 * (x == 0.0))
    assert alone == (0.5 if states[3] == "S" else 0.0)


def test_a_disc_of_stick_begins_on_the_axis() -> None:
    r = np.arange(5.0)
    assert rf.stick_half_width(r, coded("SSSFO"), begins_on_axis=True) == 2.5
    # without a node on the axis
    assert rf.stick_half_width(r[1:], coded("SSFO"), begins_on_axis=True) == 2.5
    assert np.isnan(rf.stick_half_width(r, coded("FSSFO"), begins_on_axis=True))


def test_closed_nodes_without_friction_are_in_contact_and_do_not_stick() -> None:
    x, closed = np.arange(6.0), coded("OSSSFO")
    f = np.array([0.0, 0.0, 0.0, 0.3, 0.3, 0.3])
    expected = [
        ("separation", 0.0, 0.5),
        ("contact", 0.5, 2.5),
        ("stick", 2.5, 3.5),
        ("forward slip", 3.5, 4.5),
        ("separation", 4.5, 5.0),
    ]
    assert rf.zones(x, closed, f=f) == expected
    assert rf.zones(x[1:], closed[1:], True, f[1:])[0] == ("contact", 0.0, 2.5)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slope", [1.0, 0.3])
@pytest.mark.parametrize(
    ("begin", "ends"),
    [(0.0, np.arange(6.0)), (0.0, np.array([0.0, 1.0, 4.0, 9.0])), (0.0, np.arange(2.0))]
    + [(begin, np.arange(6.0)) for begin in (0.5, 1.0, 7.0)],
)
def test_only_an_edge_with_a_point_at_radius_zero_begins_on_the_axis(
    begin: float, ends: np.ndarray, slope: float, degree: int
) -> None:
    """On a plane (slope 1) and on a cone; all weights may have a common factor."""
    s = with_middles(ends) if degree == 2 else ends
    radius = begin + slope * s
    weight = 2.0 * np.pi * nodal_forces(s, degree, lambda at: begin + slope * at)
    # at order 2 the node on the axis has no weight, and is no contact node
    kept = weight > 1e-9 * weight.max()
    assert begins_on_axis(radius[kept], weight[kept]) == (begin == 0.0)
