from dataclasses import replace

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system

import receding_fenicsx as rf
from receding_fenicsx.interface.gauss_seidel.sweeps import NodeProblem
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


@pytest.mark.parametrize("gap", [0.0, 0.2])
def test_accelerations_leave_the_answer_alone(gap: float) -> None:
    """Also where nodes land, whose slip begins there."""
    block = replace(BLOCK, g0=gap * BLOCK.x**2)

    def answer(omega: float, polish: bool) -> rf.Record:
        options = gauss_seidel(12, over_relaxation=omega, polish=polish)
        return rf.evolve(block, cyclic(1), options, replace(ALL, samples_per_leg=12))

    plain = answer(1.0, False)
    for omega, polish in ((1.5, False), (1.0, True), (1.5, True)):
        fast = answer(omega, polish)
        for field in ("P", "Q", "v", "w"):
            a, b = getattr(fast.samples, field), getattr(plain.samples, field)
            assert np.abs(a - b).max() <= 1e-9 * np.abs(b).max(), (omega, polish, field)
        assert fast.cycles.dissipation == pytest.approx(plain.cycles.dissipation, rel=1e-9)
        assert fast.sweeps < 0.7 * plain.sweeps


def test_the_error_of_the_energy_identity_falls_with_the_step() -> None:
    errors = [rf.evolve(BLOCK, cyclic(1), gauss_seidel(n)).energy_error_max for n in (10, 40, 160)]
    assert errors[1] < 0.4 * errors[0] and errors[2] < 0.4 * errors[1]
    assert errors[2] < 1e-4
