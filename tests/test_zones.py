import numpy as np

from receding_fenicsx.interface.contact import State
from receding_fenicsx.interface.zones import contact_half_width, stick_half_width, zones

STICK, OPEN, FORWARD, BACKWARD = (
    State.STICK,
    State.SEPARATION,
    State.FORWARD_SLIP,
    State.BACKWARD_SLIP,
)


def test_zone_ends_lie_midway_between_nodes() -> None:
    x = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    state = np.array([OPEN, BACKWARD, STICK, STICK, STICK, FORWARD, OPEN])
    assert zones(x, state) == [
        ("separation", -2.0, -1.5),
        ("backward slip", -1.5, -0.75),
        ("stick", -0.75, 0.75),
        ("forward slip", 0.75, 1.5),
        ("separation", 1.5, 2.0),
    ]
    assert contact_half_width(x, state) == 1.5
    assert stick_half_width(x, state) == 0.75


def test_one_zone_fills_the_edge() -> None:
    x = np.array([0.0, 1.0, 4.0])
    assert zones(x, np.full(3, OPEN)) == [("separation", 0.0, 4.0)]
    assert contact_half_width(x, np.full(3, OPEN)) == 0.0
    assert contact_half_width(x, np.full(3, STICK)) == 2.0
    assert zones(x[:0], np.zeros(0, dtype=np.int8)) == []


def test_contact_reaches_over_gaps_inside() -> None:
    x = np.arange(7.0)
    state = np.array([OPEN, STICK, OPEN, OPEN, STICK, FORWARD, OPEN])
    assert contact_half_width(x, state) == 0.5 * (5.5 - 0.5)


def test_only_the_stick_zone_around_the_centre_counts() -> None:
    x = np.linspace(-3.0, 3.0, 7)
    outer = np.array([STICK, STICK, FORWARD, BACKWARD, FORWARD, STICK, STICK])
    assert stick_half_width(x, outer) == 0.0
    uneven = np.array([OPEN, FORWARD, FORWARD, STICK, STICK, STICK, OPEN])
    assert stick_half_width(x, uneven) == 0.5 * (2.5 - -0.5)


def test_nodes_without_friction_do_not_stick() -> None:
    x = np.linspace(-2.0, 2.0, 5)
    state = np.array([OPEN, STICK, STICK, STICK, OPEN])
    assert stick_half_width(x, state, np.zeros(5)) == 0.0
    assert stick_half_width(x, state, np.array([0.3, 0.0, 0.3, 0.0, 0.3])) == 0.5
