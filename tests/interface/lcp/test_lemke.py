from itertools import product

import numpy as np
import pytest

from receding_fenicsx.interface.lcp.lemke import is_solution, lemke, solve


def all_solutions(M: np.ndarray, q: np.ndarray) -> list[np.ndarray]:
    """Go through all complementary bases, written out apart from the package."""
    n, found = len(q), []
    for basis in product([False, True], repeat=n):
        on = np.array(basis)
        z = np.zeros(n)
        if on.any():
            if abs(np.linalg.det(M[np.ix_(on, on)])) < 1e-12:
                continue
            z[on] = np.linalg.solve(M[np.ix_(on, on)], -q[on])
        if z.min() >= -1e-10 and (M @ z + q).min() >= -1e-10:
            found.append(z)
    return found


def p_matrix(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return an unsymmetric matrix whose principal minors are positive: x M x > 0."""
    G, S = rng.standard_normal((2, n, n))
    return G @ G.T / n + 0.1 * np.eye(n) + 2.0 * (S - S.T)


@pytest.mark.parametrize("n", [1, 2, 4, 7])
def test_lemke_finds_the_one_solution_of_a_p_matrix(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(40):
        M, q = p_matrix(rng, n), rng.standard_normal(n)
        (wanted,) = all_solutions(M, q)
        z = lemke(M, q, rng.uniform(0.1, 1.0, n))
        assert z is not None
        assert z == pytest.approx(wanted, abs=1e-9)
        assert solve(M, q, np.ones(n)) == pytest.approx(wanted, abs=1e-9)


def test_lemke_processes_copositive_matrices() -> None:
    # M >= 0 with a positive diagonal is strictly copositive: a solution exists for every q
    rng = np.random.default_rng(3)
    several = 0
    for _ in range(200):
        n = int(rng.integers(2, 7))
        M = rng.uniform(0.0, 1.0, (n, n)) * rng.choice([0.0, 3.0], (n, n)) + 0.3 * np.eye(n)
        q = rng.standard_normal(n)
        solutions = all_solutions(M, q)
        z = lemke(M, q, rng.uniform(0.1, 3.0, n))
        assert z is not None and is_solution(M, q, z)
        assert any(np.abs(z - one).max() <= 1e-8 for one in solutions)
        several += len(solutions) > 1
    assert several > 10


def test_lemke_survives_degenerate_ties() -> None:
    # equal ratios everywhere: without the lexicographic rule pivots may go round in circles
    rng = np.random.default_rng(4)
    for _ in range(50):
        n = 6
        G = rng.integers(-1, 2, (n, n)).astype(float)
        M = G @ G.T + np.eye(n)
        q = -rng.integers(0, 2, n).astype(float)
        z = lemke(M, q, np.ones(n))
        assert z is not None and is_solution(M, q, z)


def test_a_problem_without_solution_ends_on_a_ray() -> None:
    M, q = np.array([[-1.0, 0.0], [0.0, 1.0]]), np.array([-1.0, 1.0])
    assert all_solutions(M, q) == []
    assert lemke(M, q, np.ones(2)) is None
    assert solve(M, q, np.ones(2)) is None and solve(M, q, np.array([0.2, 1.0])) is None


def test_solve_is_indifferent_to_the_unit_of_each_pair() -> None:
    rng = np.random.default_rng(6)
    for _ in range(30):
        n = 16
        M, q = p_matrix(rng, n), rng.standard_normal(n)
        z = solve(M, q, np.ones(n))
        d = 10.0 ** rng.uniform(-6, 6, n)
        scaled = solve(d[:, None] * M * d, d * q, d)
        assert z is not None and scaled is not None
        assert scaled * d == pytest.approx(z, rel=1e-6, abs=1e-8)


def test_large_unknowns_excuse_no_violation() -> None:
    M, z = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.full(2, 1e7)
    assert is_solution(M, np.zeros(2), z)
    assert is_solution(M, np.array([1e-9, 0.0]), z)
    assert not is_solution(M, np.array([-1e-3, 0.0]), z)
    assert not is_solution(M, np.array([1e-3, 0.0]), z)
    assert not is_solution(M, np.array([-0.2, 0.0]), 1e10 * z)
