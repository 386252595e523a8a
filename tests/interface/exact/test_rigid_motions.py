"""Rigid motions that neither supports nor the contact resist: what slides, hangs, turns, drifts."""

from dataclasses import replace

import numpy as np
import pytest
from replay import objections
from small import small_system, table

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.exact.free_motions import _least
from receding_fenicsx.interface.gauss_seidel.sweeps import solve_directly
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History
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


def test_a_body_does_not_move_along_a_free_rigid_motion() -> None:
    # it can turn about the node that touches: its stiffness against that is round-off
    K = np.zeros((4, 4))
    K[:2, :2] = [[2.75, -2.75], [-2.75, 2.75]]
    K[1, 3] = K[3, 1] = 6e-16
    K[3, 3] = 2e-30
    rigid = [[0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]]
    system = small_system(K, {"load": [0.5, 0.5, -0.5, 0.0]}, 3.0, 0.0, rigid)
    state, nothing = np.array([STICK, OPEN], dtype=np.int8), np.zeros(4)
    u = solve_directly(system, np.array([-1.0]), nothing, nothing[:2], state)
    assert u is not None
    assert u == pytest.approx([0.0, 0.5 / 2.75, 0.0, 0.0], abs=1e-14)
    path = [[0.0], [-1.0], [0.0], [-1.0], [0.0]]
    ends = evolve(system, table(system, path), output=ALL).turning_points
    assert np.abs(ends.w).max() <= 1e-14
    # the node that sticks throughout does not move, and with it the unloaded body
    assert np.all(ends.v[:, 0] == 0.0) and np.all(ends.v[[1, 3]] == 0.0)


# -- a lever --------------------------------------------------------------------------------------


def lever(held: bool, middle_gap: float) -> ContactSystem:
    """Return three nodes that turn together about the middle one, 0.25 above the plane.

    Args:
        held: the middle node is held, else the body by a pivot elsewhere.
        middle_gap: gap of the middle node.
    """
    K = np.diag([4.0, 4.0, 4.0, 0.0, 0.0, 0.0])
    bend, lift = np.array([1.0, -2.0, 1.0]), np.array([1.0, 0.0, 1.0])
    K[3:, 3:] = np.outer(bend, bend) + 2.0 * np.outer(lift, lift)
    loads = {"turn": [0.0, 0.0, 0.0, -1.0, 0.0, 1.0], "push": [-1.0, 0.0, -0.5, 0.0, 0.0, 0.0]}
    f = [0.5, 0.0 if held else 0.5, 0.5]
    system = small_system(K, loads, f, [0.25, middle_gap, 0.25], [[0.0, 0.0, 0.0, -1.0, 0.0, 1.0]])
    system.held[[1, 4]] = held
    return system


LEVERS = pytest.mark.parametrize(("held", "gap"), [(True, 0.0), (True, 0.25), (False, 0.25)])


@METHODS
@LEVERS
def test_a_lever_that_touches_nowhere_turns_to_the_plane(
    method: str, held: bool, gap: float
) -> None:
    system = lever(held, gap)
    path = [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]]
    record = evolve(system, table(system, path), solver(method), ALL)
    assert record.jumps == 0 and objections(system, table(system, path), record) == []
    P = record.turning_points.P
    # its moment 2 is balanced at the arm 1
    assert P[0, [0, 2]] == pytest.approx([0.0, 2.0], abs=1e-12)
    assert P[2, [0, 2]] == pytest.approx([2.0, 0.0], abs=1e-12)


@METHODS
@LEVERS
def test_a_lever_turned_over_under_load_jumps(method: str, held: bool, gap: float) -> None:
    system = lever(held, gap)
    history = table(system, [[0.0, 0.0], [1.0, 0.0], [1.0, 0.1], [-1.0, 0.1]])
    # nothing is left to hold it half-way, where the moment vanishes
    where = r"turn = 0, push = 0\.1 \(s = 0\.5 of the leg\)"
    with pytest.raises(NoQuasiStaticContinuation, match=where):
        evolve(system, history, solver(method), ALL)
    record = evolve(system, history, solver(method, "static"), ALL)
    assert record.jumps == 1 and objections(system, history, record) == []
    assert record.turning_points.P[-1, [0, 2]] == pytest.approx([2.0, 0.0], abs=1e-9)


# -- drift ----------------------------------------------------------------------------------------


def feet(samples: int) -> tuple[ContactSystem, History, Record]:
    """Return two feet that slip apart, free to drift together, until the middle touches."""
    bend, stretch = np.array([1.0, -2.0, 1.0]), np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    K = np.zeros((6, 6))
    K[:3, :3], K[3:, 3:] = 3.0 * stretch.T @ stretch, 2.0 * np.outer(bend, bend)
    rigid = np.kron([[1.0, 0.0], [0.0, 1.0]], np.ones(3))
    loads = {"load": [2.0, 0.0, -2.0, 1.0, 1.0, 1.0]}
    system = small_system(K, loads, 0.5, [0.0, 0.1, 0.0], [*rigid, [0, 0, 0, -1, 0, 1]])
    history = table(system, [[0.0], [0.1]], [[0.1], [1.0], [0.1]], 1)
    return system, history, evolve(system, history, output=replace(ALL, samples_per_leg=samples))


def test_dissipation_by_node_is_judged_where_the_drift_is_known_only() -> None:
    spoilt = {}
    for samples in (1, 8):
        system, history, record = feet(samples)
        assert objections(system, history, record) == []
        density = record.cycles.dissipation_density
        share = 0.1 * density[0, 0]
        density[0] += [share, 0.0, -share]
        spoilt[samples] = objections(system, history, record)
        density[0] -= [share, 0.0, 0.0]
        assert any("dissipation is off" in said for said in objections(system, history, record))
    # two feet that drift together exchange what they dissipate
    assert spoilt[1] == [] and "dissipation is off" in spoilt[8][0]


@pytest.mark.parametrize("gap", [0.0, 0.25])
def test_a_body_bent_by_loads_without_a_resultant_drifts_out_of_its_ground(gap: float) -> None:
    bend, one, zero = np.array([1.0, -2.0, 1.0]), np.ones(3), np.zeros(3)
    K = np.zeros((6, 6))
    K[:3, :3], K[3:, 3:] = np.eye(3) - 1.0 / 3.0, np.outer(bend, bend)
    rigid = [[*zero, *one], [*one, *zero], [0, 0, 0, -1, 0, 1]]
    system = small_system(K, {"bend": [*zero, *bend]}, 0.5, [0.0, gap, 0.0], rigid)
    history = table(system, [[0.0], [0.6], [0.0], [-0.6]])
    record = evolve(system, history, output=ALL)
    assert objections(system, history, record) == []
    ends = record.turning_points
    assert np.abs([ends.P, ends.Q]).max() <= 1e-14
    # bent by lambda / 6 of ``bend``, and lifted out of the ground
    assert ends.w @ bend == pytest.approx([-0.6, 0.0, 0.6], abs=1e-14)
    assert np.all(ends.w >= [0.0, -gap, 0.0] - np.array(1e-14))
    if gap:  # by as little as the feet need
        assert ends.w[0] == pytest.approx([0.0, 0.3, 0.0], abs=1e-14)


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
