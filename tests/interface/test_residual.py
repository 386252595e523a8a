"""The residual of the contact law, against its definition written out for one node."""

import numpy as np
import pytest
from small import small_system

from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.residual import law_residual, residual_at_rest
from receding_fenicsx.interface.system import ContactState

K_T, K_N, F = 2.0, 5.0, 0.5
SYSTEM = small_system(np.diag([K_T, K_N]), {"a": [0.0, 1.0]}, F, 0.125)


def at(Q: float, P: float, w: float, state: State) -> ContactState:
    return ContactState(np.array([0.0, w]), np.array([Q, P]), np.array([state], np.int8))


@pytest.mark.parametrize(
    ("Q", "P", "gap", "state", "expected"),
    [
        # the law holds
        (0.3, 1.0, 0.0, State.STICK, 0.0),
        (-0.5, 1.0, 0.0, State.FORWARD_SLIP, 0.0),
        (0.5, 1.0, 0.0, State.BACKWARD_SLIP, 0.0),
        (0.0, 0.0, 0.25, State.SEPARATION, 0.0),
        # a slipping node within its friction limit, or at the limit of the other direction
        (-0.3, 1.0, 0.0, State.FORWARD_SLIP, 0.2),
        (0.5, 1.0, 0.0, State.FORWARD_SLIP, 1.0),
        (0.1, 1.0, 0.0, State.BACKWARD_SLIP, 0.4),
        # beyond the limit, pulled, pressed through the plane, pressed across a gap
        (0.7, 1.0, 0.0, State.STICK, 0.2),
        (0.0, -0.25, 0.0, State.STICK, 0.25),
        (0.0, 0.0, -0.125, State.SEPARATION, 0.125 * K_N),
        (0.0, 0.25, 0.0625, State.STICK, 0.25),
    ],
)
def test_residual_at_one_instant_is_the_force_by_which_the_law_fails(
    Q: float, P: float, gap: float, state: State, expected: float
) -> None:
    for scale in (1.0, 4.0):
        found = residual_at_rest(SYSTEM, at(Q, P, gap - 0.125, state), scale)
        assert found == pytest.approx(expected / scale, abs=1e-15)


def test_slip_against_its_force_is_a_residual_of_its_stiffness_times_the_slip() -> None:
    r, u = np.array([-0.5, 1.0]), np.array([0.0, -0.125])
    stiffness = np.array([K_T]), np.array([K_N])
    for slip, expected in ((0.01, 0.0), (0.0, 0.0), (-0.01, 0.02), (-1.0, 1.0)):
        found = law_residual(SYSTEM, r, u, np.array([slip]), stiffness)
        assert found == pytest.approx([expected, 0.0], abs=1e-15)


def test_pulled_node_has_no_friction_limit() -> None:
    stiffness = np.array([K_T]), np.array([K_N])
    pulled, u = np.array([0.1, -0.25]), np.array([0.0, -0.125])
    found = law_residual(SYSTEM, pulled, u, np.zeros(1), stiffness)
    assert found == pytest.approx([0.1, 0.25], abs=1e-15)
