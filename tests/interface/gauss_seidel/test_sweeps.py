import re
from dataclasses import replace

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.interface.gauss_seidel.node_problem import NodeProblem
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    solve_step,
)
from receding_fenicsx.interface.residual import law_residual

BLOCK = block_system(20, 10)
ALL = rf.OutputOptions(samples_per_leg=20, cycles="all")


def gauss_seidel(steps: int, **options: float) -> rf.SolverOptions:
    return replace(rf.SolverOptions(method="gauss-seidel", steps_per_leg=steps), **options)  # type: ignore[arg-type]


def random_nodes(seed: int, count: int) -> np.ndarray:
    """Return (count, 8) Q0, P0, k_t, k_n, c, f, w_c, v_ref; f |c| < k_t, K positive definite."""
    rng = np.random.default_rng(seed)
    k_t, k_n = rng.uniform(0.1, 3.0, (2, count))
    c = rng.uniform(-0.99, 0.99, count) * np.sqrt(k_t * k_n)
    f = rng.uniform(0.0, 0.99, count) * np.minimum(k_t / np.abs(c), 3.0)
    Q0, P0, v_ref = rng.standard_normal((3, count))
    w_c = -rng.choice([0.0, 1.0], count) * rng.uniform(0.0, 1.0, count)
    return np.column_stack([Q0, P0, k_t, k_n, c, f, w_c, v_ref])


def test_one_node_is_solved_from_any_first_guess_with_one_answer() -> None:
    seen = set()
    for row in random_nodes(0, 3000).tolist():
        Q0, P0, k_t, k_n, c, f, w_c, v_ref = row
        K = np.array([[k_t, c], [c, k_n]])
        node = small_system(K, {"load": [Q0, P0]}, f, -w_c)
        answers = []
        for guess in (1, 2, 3, 4):
            problem = NodeProblem(k_t, k_n, c, f, f, w_c)
            state, v, w = problem.solve(Q0, P0, v_ref, guess)
            u = np.array([v, w])
            r = np.array([Q0, P0]) + K @ u
            stiffness = np.array([k_t]), np.array([k_n])
            residual = law_residual(node, r, u, np.array([v - v_ref]), stiffness)
            scale = abs(Q0) + abs(P0) + np.abs(K @ u).max()
            # an open node has no slip to be judged
            assert residual.max() <= 1e-13 * scale or (state == 2 and residual[1] <= 1e-13 * scale)
            answers.append((v, w))
            seen.add(state)
        assert np.ptp(answers, axis=0).max() <= 1e-11 * (1.0 + np.abs(answers).max())
    assert seen == {1, 2, 3, 4}


def test_accelerations_leave_the_answer_alone() -> None:
    def answer(omega: float, polish: bool) -> rf.Record:
        options = gauss_seidel(12, over_relaxation=omega, polish=polish)
        return rf.evolve(BLOCK, cyclic(1), options, replace(ALL, samples_per_leg=12))

    plain = answer(1.0, False)
    for omega, polish in ((1.5, False), (1.0, True), (1.5, True)):
        fast = answer(omega, polish)
        for field in ("P", "Q", "v", "w"):
            a, b = getattr(fast.samples, field), getattr(plain.samples, field)
            assert np.abs(a - b).max() <= 1e-9 * np.abs(b).max(), (omega, polish, field)
        assert fast.cycles.dissipation == pytest.approx(plain.cycles.dissipation, rel=1e-9)
        assert fast.sweeps < 0.7 * plain.sweeps


def test_running_out_of_sweeps_names_residual_and_node() -> None:
    with pytest.raises(rf.NotConverged) as caught:
        rf.evolve(BLOCK, cyclic(1), gauss_seidel(5, max_sweeps=3))
    text = str(caught.value)
    found = re.search(r"after 3 sweeps .* residual (\S+) at node (\d+) \(x = (\S+)\), toler", text)
    assert found is not None and "\n" not in text
    assert float(found[1]) > 1e-12
    assert float(found[3]) == pytest.approx(BLOCK.x[int(found[2])], rel=1e-5)


def test_a_small_last_change_alone_is_not_enough() -> None:
    # sweeps whose last change is under 1e-2 leave a residual far above the tolerance
    start = rf.ContactState(np.zeros(42), np.zeros(42), np.ones(21, dtype=np.int8))
    loose = GaussSeidelOptions(1.0, False, change_tolerance=1e-2, residual_tolerance=1e-8)
    lazy = replace(loose, residual_tolerance=1.0)
    load = np.ones(1)
    strict_step = solve_step(BLOCK, start, load, loose)
    assert strict_step.residual <= 1e-8
    lazy_step = solve_step(BLOCK, start, load, lazy)
    assert lazy_step.residual > 1e-4 and lazy_step.sweeps < strict_step.sweeps


# Touch-down. K = [[2, 1], [1, 2]], g0 = 1. Held reactions (0, 3) move the free node along (1, -2)
# per unit load: it closes the gap at load 1/2 with v = 1/2, where Q = 2 v - 1 = 0 for any load: it
# sticks there. Held reactions (-3, 3) move it along (3, -3): it lands at load 1/3 with v = 1. With
# f = 1/2 it then slips: Q = -P/2 gives v = 0.6 lambda + 0.8, P = 3.6 lambda - 1.2, and
# D = integral of P/2 dv from 1/3 to 1 = 0.24.
FREE_NODE = [[2.0, 1.0], [1.0, 2.0]]


@pytest.mark.parametrize("steps", [1, 2, 3, 7])
def test_a_node_that_slips_after_touch_down_dissipates_from_there(steps: int) -> None:
    node = small_system(FREE_NODE, {"load": [-3.0, 3.0]}, 0.5, 1.0)
    record = rf.evolve(node, table(node, [0.0, 1.0]), gauss_seidel(steps))
    end = record.turning_points
    assert end.state.tolist() == [[rf.State.FORWARD_SLIP]]
    assert (end.v[0, 0], end.P[0, 0], end.Q[0, 0]) == pytest.approx((1.4, 2.4, -1.2), rel=1e-13)
    assert record.dissipation_first_loading == pytest.approx(0.24, rel=1e-12)


def test_the_reference_point_of_a_touch_down_lies_on_the_straight_path() -> None:
    # The last position is off the free path: v = 0.3, w = -0.5, gap 1/2. The zero-traction trial
    # at load 1 is v0 = 1, w0 = -2, gap -1, so v_ref = 0.3 + 0.7 * 0.5 / 1.5; at the plane
    # |Q| = |2 v_ref - 1| < P.
    node = small_system(FREE_NODE, {"load": [0.0, 3.0]}, 1.0, 1.0)
    start = rf.ContactState(np.array([0.3, -0.5]), np.zeros(2), np.array([2], dtype=np.int8))
    step = solve_step(node, start, np.ones(1), GaussSeidelOptions())
    assert step.end.v[0] == pytest.approx(0.3 + 0.7 / 3.0, rel=1e-14)
    assert step.end.state[0] == rf.State.STICK and step.dissipation[0] == 0.0


def test_the_error_of_the_energy_identity_falls_with_the_step() -> None:
    errors = [rf.evolve(BLOCK, cyclic(1), gauss_seidel(n)).energy_error_max for n in (10, 40, 160)]
    assert errors[1] < 0.4 * errors[0] and errors[2] < 0.4 * errors[1]
    assert errors[2] < 1e-4


@pytest.mark.parametrize("method", ["gauss-seidel", "events"])
def test_scaling_the_load_factors_is_scaling_the_loads(method: str) -> None:
    options = rf.SolverOptions(method=method, steps_per_leg=6)
    reference = rf.evolve(BLOCK, cyclic(2), options)
    grown = rf.evolve(BLOCK, cyclic(2, 2.0**30 / 3, 2.0**30), options)
    assert np.array_equal(grown.turning_points.P, 2.0**30 * reference.turning_points.P)
    assert np.array_equal(grown.turning_points.v, 2.0**30 * reference.turning_points.v)
