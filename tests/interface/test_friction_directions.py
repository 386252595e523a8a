"""Friction that differs between forward and backward slip, on problems worked out by hand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from small import small_system, table

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.equilibrium import furthest
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

METHODS = ("events", "gauss-seidel")
ALL = OutputOptions(samples_per_leg=12, cycles="all")


def played(
    system: ContactSystem, corners: Sequence[Sequence[Sequence[float]]], method: str
) -> Record:
    path, loop = corners
    history = table(system, path, loop, 2)
    return evolve(system, history, SolverOptions(method=method, steps_per_leg=12), ALL)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("forward", "backward"), [(0.4, 0.4), (0.5, 0.2), (0.2, 0.5), (0.0, 0.4), (0.4, 0.0)]
)
def test_a_pressed_node_pulled_to_and_fro_slips_at_two_different_limits(
    method: str, forward: float, backward: float
) -> None:
    # One node with a tangential spring k under the pressure P. A pull F brings Q = k v - F. Forward
    # slip ends at v = (F - f_forward P) / k, backward slip at v = (F + f_backward P) / k. Between
    # the pulls +F and -F the node slips by s = (2 F - (f_forward + f_backward) P) / k each way, and
    # one cycle dissipates (f_forward + f_backward) P s.
    k, P, F = 2.0, 3.0, 4.0
    node = small_system([[k, 0.0], [0.0, 1.0]], {"press": [0.0, P], "pull": [-F, 0.0]}, forward)
    node = replace(node, f_backward=np.array([backward]))
    corners = [[[0, 0], [1, 0], [1, 1]], [[1, 1], [1, -1], [1, 1]]]
    record = played(node, corners, method)
    points = record.turning_points
    ahead, back = (F - forward * P) / k, (-F + backward * P) / k
    assert points.v[1:, 0] == pytest.approx([ahead, back, ahead, back, ahead], rel=1e-12)
    limits = [-forward * P, backward * P, -forward * P, backward * P, -forward * P]
    assert points.Q[1:, 0] == pytest.approx(limits, rel=1e-12, abs=1e-14)
    slips = [State.FORWARD_SLIP, State.BACKWARD_SLIP]
    assert points.state[1:, 0].tolist() == [slips[0], slips[1], slips[0], slips[1], slips[0]]
    loop = (forward + backward) * P * (2.0 * F - (forward + backward) * P) / k
    # a load step in which slip begins takes the mean of Q over the whole step
    error = 1e-12 if method == "events" else 0.02
    assert record.cycles.dissipation == pytest.approx([loop, loop], rel=error)
    first = forward * P * ahead
    assert record.dissipation_first_loading == pytest.approx(first, rel=error, abs=1e-14)
    if method == "events":
        # stick ends forward where -F = k v - (-f_forward P) with v at the backward end
        begin = (back * k + forward * P + F) / (2.0 * F)
        again = record.events.s[(record.events.cycle == 2) & (record.events.leg == 1)]
        assert again[-1] == pytest.approx(begin, rel=1e-12)


def test_a_free_body_slides_where_the_friction_of_that_direction_is_overcome() -> None:
    # weight 1 on one node of a free body; a pull of f_forward = 0.3 slides it, backwards of 0.1
    body = small_system(
        np.zeros((2, 2)),
        {"weight": [0.0, 1.0], "pull": [-1.0, 0.0]},
        0.3,
        rigid=[[1.0, 0.0], [0.0, 1.0]],
    )
    body = replace(body, f_backward=np.array([0.1]))
    pressed = np.array([1.0, 0.0])
    for pull, limit in ((1.0, 0.3), (-1.0, 0.1)):
        found = furthest(body, pressed, np.array([1.0, pull]))
        assert found is not None and found.kind == "gross sliding"
        assert found.s == pytest.approx(limit, rel=1e-12)
