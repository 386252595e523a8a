import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.interface.measures.zones import contact_zones

STICK, OPEN, FORWARD, BACKWARD = rf.State


def test_zone_ends_lie_midway_between_nodes() -> None:
    x = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    state = np.array([OPEN, BACKWARD, STICK, STICK, STICK, FORWARD, OPEN])
    assert rf.zones(x, state) == [
        ("separation", -2.0, -1.5),
        ("backward slip", -1.5, -0.75),
        ("stick", -0.75, 0.75),
        ("forward slip", 0.75, 1.5),
        ("separation", 1.5, 2.0),
    ]
    assert rf.contact_half_width(x, state) == 1.5
    assert rf.stick_half_width(x, state) == 0.75


def test_one_zone_fills_the_edge() -> None:
    x = np.array([0.0, 1.0, 4.0])
    assert rf.zones(x, np.full(3, OPEN)) == [("separation", 0.0, 4.0)]
    assert rf.contact_half_width(x, np.full(3, OPEN)) == 0.0
    assert rf.contact_half_width(x, np.full(3, STICK)) == 2.0
    assert rf.zones(x[:0], np.zeros(0, dtype=np.int8)) == []


def test_a_contact_in_several_pieces_has_no_half_width() -> None:
    x = np.arange(7.0)
    state = np.array([OPEN, STICK, OPEN, OPEN, STICK, FORWARD, OPEN])
    assert np.isnan(rf.contact_half_width(x, state))
    middle = np.array([STICK, OPEN, FORWARD, STICK, BACKWARD, OPEN, STICK])
    assert np.isnan(rf.contact_half_width(x, middle))
    assert rf.stick_half_width(x, middle) == 0.5


def test_only_a_stick_zone_around_the_middle_has_a_half_width() -> None:
    x = np.linspace(-3.0, 3.0, 7)
    outer = np.array([STICK, STICK, FORWARD, BACKWARD, FORWARD, STICK, STICK])
    assert np.isnan(rf.stick_half_width(x, outer))
    assert rf.stick_half_width(x, np.where(outer == STICK, FORWARD, outer)) == 0.0
    # as many nodes on the one side as on the other, or one more
    ends = {(-1, 1): 1.5, (-1, 2): 2.0, (-2, 1): 2.0, (0, 2): None, (0, 0): 0.5, (1, 2): None}
    for (first, last), half in ends.items():
        state = np.where((x >= first) & (x <= last), STICK, FORWARD)
        found = rf.stick_half_width(x, state)
        assert np.isnan(found) if half is None else found == half, (first, last)
        assert rf.contact_half_width(x, np.where(state == STICK, STICK, OPEN)) == pytest.approx(
            found, nan_ok=True
        )


def test_a_disc_of_stick_begins_on_the_axis() -> None:
    r = np.arange(5.0)
    assert rf.stick_half_width(r, np.array([1, 1, 1, 3, 2]), begins_on_axis=True) == 2.5
    assert np.isnan(rf.stick_half_width(r, np.array([3, 1, 1, 3, 2]), begins_on_axis=True))


def test_nodes_without_friction_do_not_stick() -> None:
    x = np.linspace(-2.0, 2.0, 5)
    state = np.array([OPEN, STICK, STICK, STICK, OPEN])
    assert rf.stick_half_width(x, state, np.zeros(5)) == 0.0
    assert rf.stick_half_width(x, state, np.array([0.3, 0.0, 0.3, 0.0, 0.3])) == 0.5


def test_closed_nodes_without_friction_are_in_contact_and_do_not_stick() -> None:
    x, closed = np.arange(6.0), np.array([2, 1, 1, 1, 3, 2])
    f = np.array([0.0, 0.0, 0.0, 0.3, 0.3, 0.3])
    expected = [
        ("separation", 0.0, 0.5),
        ("contact", 0.5, 2.5),
        ("stick", 2.5, 3.5),
        ("forward slip", 3.5, 4.5),
        ("separation", 4.5, 5.0),
    ]
    assert contact_zones(x, closed, f) == expected
    assert [name for name, _, _ in contact_zones(x, np.ones(6, int), 0.0 * f)] == ["contact"]
    assert contact_zones(x[1:], closed[1:], f[1:], True)[0] == ("contact", 0.0, 2.5)
