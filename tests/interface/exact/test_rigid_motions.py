"""Rigid motions that neither supports nor the contact resist: what slides, hangs, turns, drifts."""

import numpy as np
import pytest
from replay import objections
from small import small_system, table

from receding_fenicsx.errors import NoEquilibrium
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.exact.free_motions import _least
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

STICK, OPEN = 1, 2
ALL = OutputOptions(samples_per_leg=8, cycles="all")
METHODS = pytest.mark.parametrize("method", ["events", "gauss-seidel"])


def solver(method: str, on_jump: str = "stop") -> SolverOptions:
    return SolverOptions(method=method, steps_per_leg=8, on_jump=on_jump)


# A node on a spring of stiffness 5 along the plane and none across it: without pressure it moves
# by v = lambda / 5.
def hanging(g0: float) -> ContactSystem:
    return small_system(np.diag([5.0, 0.0]), {"pull": [-1.0, 0.0]}, 0.6, g0, [[0.0, 1.0]])


@METHODS
@pytest.mark.parametrize("g0", [0.0, 0.25])
def test_a_node_that_nothing_presses_moves_freely_and_does_not_fall(method: str, g0: float) -> None:
    system = hanging(g0)
    history = table(system, [[0.0], [0.5]], [[0.5], [-0.5], [0.5]], 2)
    record = evolve(system, history, solver(method), ALL)
    assert objections(system, history, record) == []
    ends = record.turning_points
    assert ends.v[:, 0] == pytest.approx([0.1, -0.1, 0.1, -0.1, 0.1], abs=1e-15)
    assert np.all(ends.w == 0.0) and np.all(ends.P == 0.0)
    if method == "events" or g0 > 0.0:
        assert np.all(ends.state == OPEN)
    assert np.all(ends.state != STICK)


def test_a_body_that_slides_is_not_held_by_round_off_of_its_stiffness() -> None:
    # to the coupling c = 1.3e-16 of v and P, v = 4e16 would be a pressure that friction needs
    K = [[8e-33, 1.3e-16], [1.3e-16, 2.1]]
    system = small_system(K, {"push": [-1.0, 1.0]}, 0.1656920328, 0.0, [[-1.0, 0.0]])
    with pytest.raises(NoEquilibrium, match="no equilibrium was found"):
        evolve(system, table(system, [[0.0], [1.0]]))


def test_the_least_drift_is_the_nearest_one_that_keeps_all_bounds() -> None:
    rows = np.array([[1.0, 0.0], [1.0, 1.0]])
    for bounds, nearest in (([1.0, 3.0], [1.5, 1.5]), ([2.0, 3.0], [2.0, 1.0]), ([-1, -1], [0, 0])):
        assert _least(rows, np.array(bounds)) == pytest.approx(nearest, abs=1e-14)
    assert _least(np.array([[1.0], [-1.0]]), np.array([1.0, 0.0])) is None


BEND = np.array([1.0, -2.0, 1.0])


@pytest.mark.parametrize(
    ("k", "at"), [(1e-6, [1, 1, 1]), (1e-12, [1, 1, 1]), (1e-7, [0, 1, 0]), (1e-9, [0, 1, 0])]
)
def test_a_beam_on_soft_springs_falls_through_its_play(k: float, at: list[int]) -> None:
    """Three feet land where all gaps close: P = P* - k g0. On one spring the beam may turn."""
    K, turn, g0 = np.zeros((6, 6)), np.array([0.0, 0.0, 0.0, -1.0, 0.0, 1.0]), 0.005
    K[:3, :3] = np.eye(3)
    K[3:, 3:] = np.outer(BEND, BEND) + k * np.diag(at)
    noise = 1e-14 * np.random.default_rng(0).standard_normal((6, 6))
    P = np.array([1.0, 2.0, 1.0])
    loads = {"press": np.concatenate([np.zeros(3), P])}
    system = small_system(K + noise + noise.T, loads, 0.3, g0, [] if all(at) else [turn])
    record = evolve(system, table(system, [0.0, 1.0]))
    assert record.turning_points.P[0] == pytest.approx(P - k * g0 * np.array(at), rel=1e-9)
    assert record.turning_points.w[0] == pytest.approx([-g0] * 3, rel=1e-12)


@pytest.mark.parametrize("g0", [0.0, 0.3])
@pytest.mark.parametrize("k", [1e-4, 1e-8, 1e-9])
def test_soft_springs_carry_a_body_that_is_lifted_off_and_put_back(k: float, g0: float) -> None:
    """They lift by the load over k, with round-off of K times that; it is small beside the load."""
    lift, turn = np.array([[0.0, 0, 1, 1], [0, 0, 1, -1]]) / np.sqrt(2.0)
    K = np.diag([1.0, 1.0, 0.0, 0.0]) + k * np.outer(lift, lift) + 0.7 * np.outer(turn, turn)
    pull = np.array([0.0, 0.0, -1.3, -0.4])
    system = small_system(K, {"pull": pull}, 0.3, g0)
    record = evolve(system, table(system, [[0.0], [1.0], [-1.0], [1.0]]))
    ends = record.turning_points
    w = -(lift @ pull / k * lift + turn @ pull / 0.7 * turn)[2:]
    assert ends.w[[0, 2]] == pytest.approx(np.array([w, w]), rel=1e-15 / k)
    assert np.abs(ends.P[[0, 2]]).max() <= 1e-14 / k
    # put back, it is pressed on through its gaps
    assert ends.P[1] == pytest.approx(-pull[2:] - k * g0, rel=1e-12)
    assert ends.w[1].tolist() == [-g0, -g0]


@pytest.mark.parametrize("angle", [0.49, 0.7, 1.1])
@pytest.mark.parametrize("k", [1e-6, 1e-7, 1e-8])
def test_a_body_on_a_soft_spring_lands_where_it_has_landed_before(k: float, angle: float) -> None:
    """Along its guide it lands with Q = P = 0, at v = -g0 (1 - k) s c / (s^2 + k c^2), each time.

    It moves away by the load over k, the round-off of which must not remain as a force: with
    f K_tn > K_tt a node that unloads with Q unlike 0 would jump.
    """
    s, c, g0 = np.sin(angle), np.cos(angle), 0.0625
    K = np.outer([-s, c], [-s, c]) + k * np.outer([c, s], [c, s])
    loads = {"a": [0.0, 0.41], "b": [0.0, -0.99], "c": [0.0, 0.7]}
    system = small_system(K, loads, 1.0, g0)
    pressed, away = [0.75, 0.5, 1.0], [0.75, 1.0, -0.5]
    record = evolve(system, table(system, [[0.0] * 3, pressed, *[away, pressed] * 3]))
    v = record.turning_points.v[::2, 0]
    assert v == pytest.approx(-g0 * (1.0 - k) * s * c / (s**2 + k * c**2), rel=1e-9)


@pytest.mark.parametrize("left", [0.0, 2e-12])
@pytest.mark.parametrize("f", [0.3, 2.0])
def test_pressure_may_vanish_under_shear_at_the_end_of_a_leg(f: float, left: float) -> None:
    """K_tt = 2, P = 1 - s, pull s: Q = f P - s beyond s = f / (1 + f), D = f / (4 (1 + f)).

    Pressed again, it sticks. The load that presses ends at 0 but for round-off.
    """
    loads = {"press": [0.0, 1.0], "pull": [1.0, 0.0]}
    free = small_system(np.diag([2.0, 0.0]), loads, f, rigid=[[0.0, 1.0]])
    record = evolve(free, table(free, [[0.0, 0.0], [1.0, 0.0], [-left, 1.0], [1.0, 1.0]]))
    assert record.turning_points.v[:, 0] == pytest.approx([0.0, -0.5, -0.5], abs=1e-11)
    assert record.dissipation_first_loading == pytest.approx(0.25 * f / (1.0 + f), rel=1e-10)


def test_a_stiffness_that_is_round_off_carries_no_load() -> None:
    # a body that is free to lift and to turn about its two nodes: it tips where P of node 0 is gone
    K = np.diag([10.0, 6.0, 8.6e-31, 5.2e-31])
    K[0, 1] = K[1, 0] = -4.0
    loads = {"a": [0.0, 0.0, 3.0, 2.0], "b": [0.0, 0.0, -1.0, -2.0], "c": [2.0, 2.0, -2.0, 0.0]}
    rigid = [[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, -1.0, 1.0]]
    system = small_system(K, loads, 0.0, [0.0, 0.0625], rigid)
    system.held[1] = True
    path = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75, 1.0]]
    # P_0 = 3 - 4.25 s
    with pytest.raises(NoEquilibrium, match=r"overturning at a = 0\.647058"):
        evolve(system, table(system, path))
