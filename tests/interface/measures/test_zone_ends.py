"""Ends of zones below node spacing: exact tractions laid on nodes, and exact half widths."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from nodal import nodal_forces, with_middles

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State, friction_of
from receding_fenicsx.interface.measures.tractions import Tractions
from receding_fenicsx.interface.measures.zone_ends import (
    contact_half_width_estimate,
    dundurs_beta,
    stick_half_width_estimate,
    zone_end,
    zone_ends,
)

STICK, OPEN, FORWARD, BACKWARD = State
SHIFTS = np.linspace(0.0, 1.0, 13)


forces = partial(nodal_forces, pieces=200)


def edge(degree: int, elements: int, stretch: float = 0.0) -> Array:
    """Nodes of the edge |x| < 1, wider towards its ends by the factor 1 + stretch."""
    s = np.linspace(-1.0, 1.0, elements + 1)
    x = (s + stretch * s**3 / 3.0) / (1.0 + stretch / 3.0)
    return x if degree == 1 else with_middles(x)


def pressed(c: float, m: float, degree: int, x: Array, f: float = 0.0) -> Tractions:
    """Lay p = (1 + x^2) (c^2 - x^2)^m on an edge, slipping outwards where there is friction."""
    P = forces(x, degree, lambda s: (1.0 + s**2) * np.maximum(c**2 - s**2, 0.0) ** m)
    touching = np.abs(x) < c
    slip = np.where(x > 0, FORWARD, BACKWARD) if f else np.full(len(x), STICK)
    state = np.where(touching, slip, OPEN)
    weight = forces(x, degree, np.ones_like)
    law = friction_of(np.full(len(x), f), None)
    return Tractions(x, weight, P, -f * np.sign(x) * P, state, law, beta=0.25)


@pytest.mark.parametrize(("degree", "stretch"), [(1, 0.0), (2, 0.0), (2, 0.5), (1, 0.5)])
def test_contact_ends_of_exact_pressures_are_found_within_hundredths_of_node_spacing(
    degree: int, stretch: float
) -> None:
    x = edge(degree, 200 // degree, stretch)
    for shift in SHIFTS:
        c = 0.7 + 0.02 * shift
        spacing = np.diff(x)[np.searchsorted(x, c) - 1]
        found = contact_half_width_estimate(pressed(c, 0.5, degree, x))
        assert found.fitted
        assert found.low < c < found.high
        assert abs(found.value - c) < 0.04 * spacing


@pytest.mark.parametrize("f", [0.3, 1.0])
def test_power_of_the_pressure_is_that_of_outward_and_inward_slip(f: float) -> None:
    x = edge(2, 100)
    shift = math.atan(0.25 * f) / math.pi
    outwards = pressed(0.712, 0.5 - shift, 2, x, f)
    found = contact_half_width_estimate(outwards)
    assert abs(found.value - 0.712) < 0.04 * (x[1] - x[0])
    inwards = pressed(0.712, 0.5 + shift, 2, x, f)
    swapped = np.select(
        [inwards.state == FORWARD, inwards.state == BACKWARD], [BACKWARD, FORWARD], inwards.state
    )
    inwards = replace(inwards, Q=-inwards.Q, state=swapped)
    found = contact_half_width_estimate(inwards)
    assert abs(found.value - 0.712) < 0.04 * (x[1] - x[0])


def stuck(c: float, power: float, x: Array, degree: int, a: float = 0.9) -> Tractions:
    """Lay p of Hertz on an edge, and f p - |q| = (1 + x^2) (c^2 - x^2)^power in the stick zone."""
    weight, f = forces(x, degree, np.ones_like), 0.4
    P = forces(x, degree, lambda s: np.sqrt(np.maximum(a**2 - s**2, 0.0)))
    y = forces(x, degree, lambda s: (1.0 + s**2) * np.maximum(c**2 - s**2, 0.0) ** power)
    state = np.select([np.abs(x) < c, np.abs(x) < a], [STICK, FORWARD], OPEN)
    law = friction_of(np.full(len(x), f), None)
    return Tractions(x, weight, P, 0.05 * y - f * P, state, law, beta=0.25)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("grows", [0.0, 1.0])
def test_ends_of_stick_zones_that_shrink_and_that_grow_are_in_their_intervals(
    degree: int, grows: float
) -> None:
    x, rng = edge(degree, 200 // degree), np.random.default_rng(4)
    m = 0.5 + math.atan(0.4 * 0.25) / math.pi
    for c in rng.uniform(0.35, 0.6, 12):
        # slip to the right: the power is that of its right end
        at = stuck(c, m + grows, x, degree)
        found = zone_end(at, int(np.flatnonzero(at.state == STICK)[-1]), 1)
        assert found.fitted and found.low < c < found.high
        assert found.low <= found.value <= found.high
        assert abs(found.value - c) < 0.07 * (x[1] - x[0])
        # its mirror image, with more friction against slip the other way
        states = np.where(at.state == FORWARD, BACKWARD, at.state)[::-1]
        law = friction_of(np.full(len(x), 0.9), np.full(len(x), 0.4))
        image = Tractions(x, at.weight[::-1], at.P[::-1], -at.Q[::-1], states, law, at.beta)
        left = zone_end(image, int(np.flatnonzero(states == STICK)[0]), -1)
        assert left.fitted and left.value == pytest.approx(-found.value, abs=1e-9)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("elements", [8, 20, 80])
def test_intervals_hold_zones_narrower_than_a_spacing(degree: int, elements: int) -> None:
    x, rng = edge(degree, elements), np.random.default_rng(5)
    inner, outer = x[-2], x[-1]
    for part in rng.uniform(0.0, 1.0, 12):
        # what is beyond the zone's end, between the last two nodes, is open or slips
        c = inner + part * (outer - inner)
        at = pressed(c, 0.5, degree, x)
        at = replace(at, state=np.where(at.P > 0.0, STICK, OPEN))
        found = contact_half_width_estimate(at)
        assert found.low < c < found.high and found.low <= found.value <= found.high
        at = stuck(c, 0.5, x, degree, a=1.2)
        at = replace(at, state=np.where(at.Q + 0.4 * at.P > 0.0, STICK, FORWARD))
        found = stick_half_width_estimate(at)
        assert found.low < c < found.high and found.low <= found.value <= found.high
        assert contact_half_width_estimate(at).low == outer  # it is pressed on all of the edge
        # a zone of stick between two nodes, or with a single one
        shifted = x[x != 0.0] if part < 0.5 else x
        c = part * (shifted[len(shifted) // 2] if part < 0.5 else 0.5 * x[len(x) // 2 + 1])
        at = stuck(c, 0.5, shifted, 1)
        slips = np.where(shifted < 0.0, BACKWARD, FORWARD)
        state = np.where(np.abs(shifted) > 0.0, slips, STICK)
        for image, far in ((False, 0.0), (True, 0.0), (False, 8.0)):
            found = stick_half_width_estimate(replace(at, x=at.x + far, state=state, half=image))
            assert 0.0 <= found.low < c < found.high and found.low <= found.value <= found.high
            # known to the nodes, the value is midway
            middle = 0.25 * np.diff(shifted)[len(shifted) // 2 - 1]
            assert part >= 0.5 or found.value == pytest.approx(middle)


def test_where_no_power_is_known_there_is_the_nodal_bracket() -> None:
    x, one = edge(2, 100), np.ones(1)
    law = friction_of(one, None)
    single = Tractions(0.0 * one, one, one, 0.0 * one, np.array([STICK]), law)
    none = replace(pressed(0.33, 0.5, 2, x), state=np.full(len(x), OPEN))
    whole = pressed(1.5, 0.5, 2, x)
    for at, end in ((single, 0.0), (replace(none, P=0.0 * none.P), 0.0), (whole, 1.0)):
        found = contact_half_width_estimate(at)
        assert (found.value, found.low, found.high) == (end, end, end)
    # few nodes in contact, or unknown constants under friction; without it they do not matter
    assert not contact_half_width_estimate(pressed(0.33, 0.5, 2, edge(2, 20))).fitted
    for f in (0.0, 0.3):
        at = replace(pressed(0.7123, 0.5, 2, x, f), beta=None)
        assert contact_half_width_estimate(at).fitted == (f == 0.0)
    # nor is a half width fitted of which one end is not
    at = pressed(0.7123, 0.5, 2, x)
    dented = np.where((x > -0.7) & (x < -0.65), 0.0, at.P)
    assert not contact_half_width_estimate(replace(at, P=dented)).fitted


def test_every_end_of_a_zone_is_estimated_from_the_side_where_tractions_vanish() -> None:
    x = edge(2, 100)
    a, c, f = 0.803, 0.437, 0.3
    m = math.atan(0.25 * f) / math.pi
    at = pressed(a, 0.5 - m, 2, x, f)
    # stick for |x| < c, where the shear is less than f p by a part with its own power
    less = forces(x, 2, lambda s: np.sign(s) * np.maximum(c**2 - s**2, 0.0) ** (0.5 + m))
    state = np.where(np.abs(x) < c, STICK, at.state)
    at = replace(at, Q=at.Q + less, state=state)
    ends = zone_ends(at)
    assert [end.fitted for end in ends] == [True] * 4
    spacing = x[1] - x[0]
    for end, exact in zip(ends, (-a, -c, c, a), strict=True):
        assert end.low < exact < end.high
        assert abs(end.value - exact) < 0.05 * spacing
    half = zone_ends(replace(at, half=True))
    assert [end.value for end in half] == pytest.approx([end.value for end in ends], abs=1e-9)
    # between two slips of opposite direction nothing is known but the nodes
    at = pressed(a, 0.5, 1, x[x != 0.0])
    for image in (False, True):
        opposite = np.where(at.x < 0.0, BACKWARD, FORWARD)
        (end,) = zone_ends(replace(at, state=opposite, half=image))
        assert not end.fitted and end.low < 0.0 < end.high


@pytest.mark.parametrize("degree", [1, 2])
def test_both_ends_of_the_contact_of_a_ring_are_found(degree: int) -> None:
    """Its radius is three times as large at the one end of the edge as at the other."""
    x, c = edge(degree, 200 // degree), 0.7123
    radius = 2.0 + x
    weight = forces(x, degree, lambda s: 2.0 + s)
    P = forces(x, degree, lambda s: (2.0 + s) * np.sqrt(np.maximum(c**2 - s**2, 0.0)))
    at = replace(pressed(c, 0.5, degree, x), weight=weight, P=P, radius=radius)
    for end, exact in zip(zone_ends(at), (-c, c), strict=True):
        assert end.fitted and end.low < exact < end.high
        assert abs(end.value - exact) < 0.04 * (x[1] - x[0])


def test_dundurs_constant_of_known_pairs() -> None:
    # incompressible against rigid: 0; nu = 0 against rigid, plane strain: 1/2; equal bodies: 0
    assert dundurs_beta((1.0, 0.5, "plane strain")) == pytest.approx(0.0, abs=1e-15)
    assert dundurs_beta((3.0, 0.0, "plane strain")) == pytest.approx(0.5)
    a, b = (2.0, 0.3, "plane strain"), (5.0, 0.1, "plane strain")
    assert dundurs_beta(a, a) == pytest.approx(0.0, abs=1e-15)
    assert dundurs_beta(a, b) == pytest.approx(-dundurs_beta(b, a))
    stiff = (1e12, 0.2, "plane strain")
    assert dundurs_beta(a, stiff) == pytest.approx(dundurs_beta(a), rel=1e-9)
    # plane stress is plane strain with nu / (1 + nu)
    assert dundurs_beta((1.0, 0.3, "plane stress")) == pytest.approx(
        dundurs_beta((1.0, 0.3 / 1.3, "plane strain"))
    )
