"""Load steps and jumps: none is passed over, none is made up; the exact path is the reference."""

import re
from dataclasses import replace

import numpy as np
import pytest
from law import worst_violation
from problems import problem
from small import small_system, table

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, NotConverged
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.gauss_seidel.node_problem import NodeProblem
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    solve_step,
)
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.load_steps.steps import Continuation, LegInSteps
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

ALL = OutputOptions(samples_per_leg=20, cycles="all")


def steps(number: int, on_jump: str = "stop") -> SolverOptions:
    return SolverOptions(method="gauss-seidel", steps_per_leg=number, on_jump=on_jump)


# One node that sticks at u = 0 up to s of leg 1, r = (1 - 3/4 s, 1 - 7/4 s): at Q = f P, s = 4/11,
# it can neither stick nor slip, since f K_tn > K_tt. It opens: u = -K^-1 r, which releases
# r K^-1 r / 2 = 32 / 211.75.
LEVER = small_system([[2.0, 1.5], [1.5, 2.0]], {"a": [1, 1], "b": [0, -1]}, 2.0)
PATH = table(LEVER, [[0, 0], [1, 0], [0.25, 1]])


@pytest.mark.parametrize("number", [1, 3, 40, 160, 640])
def test_load_steps_stop_where_the_path_ends(number: int) -> None:
    with pytest.raises(NoQuasiStaticContinuation) as caught:
        evolve(LEVER, PATH, steps(number))
    place = re.search(
        r"^cycle 0, leg 1: .* \(s = (\S+) of the leg\): .*nodes \[0\]", str(caught.value)
    )
    assert place is not None and float(place[1]) == pytest.approx(4 / 11, abs=1e-8)
    turning = caught.value.record.turning_points  # type: ignore[attr-defined]
    assert turning.state.tolist() == [[State.STICK]]


@pytest.mark.parametrize("number", [1, 3, 40, 160, 640])
def test_load_steps_count_a_jump_and_its_energy(number: int) -> None:
    record = evolve(LEVER, PATH, steps(number, "static"))
    assert record.jumps == 1
    assert record.released == pytest.approx(32 / 211.75, rel=1e-6)
    assert record.turning_points.state.tolist() == [[State.STICK], [State.SEPARATION]]
    # nothing slips: with what is released the energy is whole
    assert record.dissipation_first_loading == 0.0 and record.energy_error_max <= 1e-12


def strong_case(seed: int) -> tuple[ContactSystem, History]:
    """Return a small random body with strong coupling of v and w at each node, and a history."""
    rng = np.random.default_rng([5, seed])
    n, n_loads = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    G = rng.standard_normal((2 * n, 3 * n))
    k_t, k_n = rng.uniform(0.5, 3.0, (2, n))
    c = rng.uniform(0.3, 0.95, n) * rng.choice([-1.0, 1.0], n) * np.sqrt(k_t * k_n)
    K = np.block([[np.diag(k_t), np.diag(c)], [np.diag(c), np.diag(k_n)]])
    K += rng.choice([0.0, 0.1, 0.3]) * (G @ G.T / (3 * n) + 0.2 * np.eye(2 * n))
    r = rng.standard_normal((n_loads, 2 * n))
    r[0, n:] = np.abs(r[0, n:]) + 0.3
    gap = np.where(rng.random(n) < 0.4, 0.3 * rng.random(n), 0.0) if rng.random() < 0.4 else 0.0
    system = small_system(
        0.5 * (K + K.T), {f"l{k}": r[k] for k in range(n_loads)}, rng.uniform(0.05, 3.0, n), gap
    )
    low = np.full(n_loads, -1.0)
    low[0] = 0.0 if rng.random() < 0.7 else -0.3
    first = np.eye(n_loads)[0]
    path = np.vstack([0.0 * first, first, rng.uniform(low, 1.2, (3, n_loads))])
    loop = np.vstack([path[-1], rng.uniform(low, 1.2, (2, n_loads)), path[-1]])
    return system, table(system, path, loop, 1)


def place_of_jump(
    system: ContactSystem, history: History, solver: SolverOptions
) -> tuple[int, int, float] | None:
    """Return cycle, leg and s where a path ends, None where it does not."""
    try:
        evolve(system, history, solver)
    except NoQuasiStaticContinuation as error:
        found = re.search(r"cycle (\d+), leg (\d+): .*\(s = (\S+) of the leg\)", str(error))
        assert found is not None, str(error)
        return int(found[1]), int(found[2]), float(found[3])
    return None


@pytest.mark.parametrize("group", range(4))
def test_load_steps_jump_where_the_exact_path_ends_and_nowhere_else(group: int) -> None:
    number, jumps, passes = 30, 0, 0
    for seed in range(15 * group, 15 * group + 15):
        system, history = strong_case(seed)
        exact = place_of_jump(system, history, SolverOptions())
        found = place_of_jump(system, history, steps(number))
        if exact is None:
            assert found is None, seed
            passes += 1
        else:
            assert found is not None and found[:2] == exact[:2], seed
            assert abs(found[2] - exact[2]) <= 1.0 / number, seed
            jumps += 1
    print(f"{jumps} jumps, {passes} without")
    assert jumps >= 3 and passes >= 3


def test_load_steps_release_what_the_exact_path_releases() -> None:
    jumped = 0
    for seed in range(20):
        system, history = strong_case(seed)
        exact = evolve(system, history, SolverOptions(on_jump="static"))
        record = evolve(system, history, steps(20, "static"), ALL)
        assert record.jumps == exact.jumps, seed
        assert record.released == pytest.approx(exact.released, rel=0.1), seed
        assert worst_violation(system, record) <= 1e-9 and record.residual_max <= 1e-10, seed
        jumped += record.jumps
    assert jumped >= 15


def test_a_straight_way_is_one_that_keeps_the_law_at_both_ends() -> None:
    # K = 2 I, f = 1/2: the node sticks under (Q*, P*) = (0, 1), slips under (-1, 1)
    node = small_system(2.0 * np.eye(2), {"press": [0, 1], "push": [-1, 0]}, 0.5)
    check, rest = Continuation(node), ContactState(np.zeros(2), np.zeros(2), np.array([1], np.int8))
    pressed, limit, slipped, back, lifted = (
        solve_step(node, rest, np.array(load, dtype=float), GaussSeidelOptions()).end
        for load in ([1, 0.25], [1, 0.5], [1, 1], [1, -1], [-1, 0])
    )
    assert slipped.state[0] == State.FORWARD_SLIP and back.state[0] == State.BACKWARD_SLIP
    assert all(check.is_straight(rest, end, 1.0) for end in (pressed, limit, slipped, back, lifted))
    assert check.is_straight(limit, slipped, 1.0) and check.is_straight(pressed, limit, 1.0)
    assert not check.is_straight(pressed, slipped, 1.0)  # it reaches its limit on the way
    assert not check.is_straight(limit, back, 1.0)  # it is not at that limit
    assert not check.is_straight(pressed, lifted, 1.0)  # its pressure ends on the way
    assert not check.is_straight(lifted, pressed, 1.0)  # it lands on the way
    assert not check.is_straight(slipped, replace_state(limit, State.FORWARD_SLIP), 1.0)


def replace_state(at: ContactState, state: State) -> ContactState:
    return ContactState(at.u, at.r, np.array([state], dtype=np.int8))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_slip_that_stays_at_its_limit_does_not_divide_by_zero(sign: float) -> None:
    # K_tt = f |K_tn|: the distance from one limit does not change with slip
    node = small_system([[2.0, sign], [sign, 2.0]], {"load": [0.0, 2.0]}, 2.0, 0.25)
    loop = table(node, [0.0, 1.0], [1.0, 0.0, 1.0], 1)
    exact, record = evolve(node, loop), evolve(node, loop, steps(20))
    a, b = exact.turning_points, record.turning_points
    assert np.array_equal(a.state, b.state)
    for field in ("P", "Q", "v", "w"):
        assert getattr(b, field) == pytest.approx(getattr(a, field), abs=1e-12), field
    for assumed in (1, 2, 3, 4):
        state, v, w = NodeProblem(2.0, 2.0, sign, 2.0, 2.0, -0.25).solve(0.0, 1.0, 0.125, assumed)
        assert (state, v, w) == (State.STICK, 0.125, -0.25)


@pytest.mark.parametrize("number", [7, 20, 40])
def test_displacements_of_the_size_of_round_off_count_as_settled(number: int) -> None:
    # after complete unloading |Q*| = f P* up to round-off, and u is round-off alone
    node = small_system(2.0 * np.eye(2), {"a": [0.0, 1.0], "b": [1.0, 1.0]}, 0.5)
    path = [[0, 0], [1, 0], [1, 0.75], [0.75, -0.25]]
    history = table(node, path, [[0.75, -0.25], [0.25, 1], [0, 0], [0.75, -0.25]], 2)
    a, b = (evolve(node, history, solver).turning_points for solver in (None, steps(number)))
    for field in ("P", "Q", "w"):
        assert getattr(b, field) == pytest.approx(getattr(a, field), abs=1e-12), field


@pytest.mark.parametrize("number", [0, 3, 9])
@pytest.mark.parametrize("through", [[], [[0, 0]]])
def test_a_leg_through_zero_load_dissipates_what_two_legs_that_meet_there_do(
    number: int, through: list[list[int]]
) -> None:
    """K = I, f = 1/2; load a presses node 0 and lifts node 1, b pulls them.

    Node 0 slips at Q = -1/2 by 1/2; unloaded to lambda < 1/3 it slips back by 3 lambda/2 at
    Q = lambda/2 and opens at 0, where node 1 lands and slips by lambda/2 at Q = lambda/2.
    In a load step that ends open, from lambda = 1/number, no slip is counted.
    """
    pair = small_system(np.eye(4), {"a": [0, 0, 1, -1], "b": [-1, 1, 0, 0]}, 0.5)
    path = [[0, 0], [1, 0.5], [1, 1], *through, [-1, -1]]
    record = evolve(pair, table(pair, path), steps(number) if number else None)
    lost = 0.5 * 0.5 * 1.5 / number**2 if number else 0.0
    D = 0.5 * 0.5 + 0.5 * 0.5 * 1.5 / 9.0 - lost + 0.5 * 0.5 * 0.5
    assert record.dissipation_first_loading == pytest.approx(D, rel=1e-12)
    # the leg from 1 to -1 ends with the elastic energy of its start, so that its work is 1/6
    if not through:
        assert record.energy_error_max == pytest.approx(lost / (1 / 6 - lost), abs=1e-12)
    assert record.turning_points.state[-1].tolist() == [State.SEPARATION, State.FORWARD_SLIP]


def test_pieces_of_the_exact_path_add_up_and_the_whole_path_replaces_them() -> None:
    """K = I, f = 1/2, pulled to twice its limit: stuck up to s = 1/2, then slip by 1/2."""
    node = small_system(np.eye(2), {"press": [0, 1], "pull": [-1, 0]}, 0.5)
    start = evolve(node, table(node, [[0, 0], [1, 0]])).turning_points
    at = ContactState(
        np.array([*start.v[-1], *start.w[-1]]),
        np.array([*start.Q[-1], *start.P[-1]]),
        start.state[-1],
    )
    check = Continuation(node)
    now = LegInSteps(node, LegProblem(at, (np.array([1.0, 0]), np.array([1.0, 1])), 1.0), None)
    whole = check.follow(now.problem, 1.0, None).walk.finish()

    def numbers(leg: Leg) -> list[float]:
        return [*leg.dissipation, leg.work, leg.end.v[0], *(event[0] for event in leg.events)]

    for s, s_end in ((0.0, 0.3), (0.3, 0.7), (0.7, 1.0)):
        now.add(check.follow(now.rest(s, 1.0), s_end, None).walk.finish(), (s, s_end))
    # work of the pull: -integral of lambda dv
    assert numbers(now.leg) == pytest.approx([0.25, -0.375, 0.5, 0.5], rel=1e-12)
    now.replace(whole, 1.0)
    assert numbers(now.leg) == pytest.approx([0.25, -0.375, 0.5, 0.5], rel=1e-12)


@pytest.mark.parametrize("spring", [0.0, 1e-17, -1e-17])
def test_a_free_node_that_is_pulled_off_has_no_equilibrium(spring: float) -> None:
    # nothing but round-off of the stiffness holds it normally
    node = small_system([[1.0, 0.0], [0.0, spring]], {"p": [0.1, 1.0]}, 0.5, rigid=[[0.0, 1.0]])
    for solver in (None, steps(5)):
        evolve(node, table(node, [0.0, 1.0, 0.2, 1.0]), solver)
        with pytest.raises(NoEquilibrium, match="lift-off"):
            evolve(node, table(node, [0.0, 1.0, -0.1]), solver)


@pytest.mark.parametrize("number", [1248, 1643])
def test_steps_whose_sweeps_cycle_follow_the_exact_path(number: int) -> None:
    p = problem(number)
    with pytest.raises(NotConverged, match="stopped after 900 sweeps"):
        evolve(p.system, p.history, replace(p.solver, max_sweeps=900))
    record, exact = evolve(p.system, p.history, p.solver, ALL), evolve(p.system, p.history)
    assert record.jumps == exact.jumps == 0 and record.residual_max <= 1e-11
    fine = evolve(p.system, p.history, replace(p.solver, steps_per_leg=160))
    for field in ("P", "Q", "v", "w"):
        reference = getattr(exact.turning_points, field)
        coarse_off, fine_off = (
            np.abs(getattr(found.turning_points, field) - reference).max()
            for found in (record, fine)
        )
        size = np.abs(reference).max()
        assert coarse_off <= 0.05 * size, field
        assert fine_off <= max(0.5 * coarse_off, 1e-4 * size), field


def test_sweeps_that_creep_to_complete_unloading_give_way_to_the_exact_path() -> None:
    # no friction and no normal stiffness: P = lambda P*, v = -lambda Q* / K_tt
    node = small_system([[1.75, 0.0], [0.0, 0.0]], {"a": [0.36, 1.23]}, 0.0, rigid=[[0.0, 1.0]])
    record = evolve(node, table(node, [0.0, 1.0], [1.0, 0.0, 1.0], 3), steps(40))
    load = record.turning_points.load
    assert record.turning_points.P == pytest.approx(1.23 * load, abs=1e-11)
    assert record.turning_points.v == pytest.approx(-0.36 / 1.75 * load, abs=1e-11)
    assert np.all(record.turning_points.Q == pytest.approx(0.0, abs=1e-11))


def test_drift_without_friction_dissipates_nothing() -> None:
    p = problem(20638)
    record = evolve(p.system, p.history, p.solver)
    drift = np.abs(np.diff(record.turning_points.v, axis=0)).max()
    assert not np.any(p.system.f) and drift > 0.0
    assert np.all(record.cycles.dissipation == 0.0) and record.dissipation_first_loading == 0.0
