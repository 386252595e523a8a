"""All sets of states tried against linear complementarity and against paper and pencil."""

from itertools import product

import numpy as np
import pytest

from receding_fenicsx.interface.law import Friction, State
from receding_fenicsx.interface.lcp import enumerate_states, lemke
from receding_fenicsx.interface.lcp.enumerate_states import count, exhaust

STICK, OPEN, FORWARD, BACKWARD = 1, 2, 3, 4
ANY = (STICK, OPEN, FORWARD, BACKWARD)


def random_problem(seed: int, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a positive definite S, s and friction up to strong coupling."""
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((2 * m, 3 * m))
    return G @ G.T, rng.standard_normal(2 * m), rng.uniform(0.0, 3.0, m)


KINDS = [ANY, (STICK, FORWARD), (STICK, BACKWARD)]


def complementary(S: np.ndarray, s: np.ndarray, f: np.ndarray, kinds: list[int]) -> bool:
    """Return whether the same problem has a solution as linear complementarity (Klarbring)."""
    m = len(f)
    t, n = np.eye(2 * m)[:m], np.eye(2 * m)[m:]
    A, B = t + f[:, None] * n, f[:, None] * n - t
    pairs = [
        [(A[i], t[i]), (B[i], -t[i]), (n[i], n[i])][slice(*[(0, 3), (0, 1), (1, 2)][kinds[i]])]
        for i in range(m)
    ]
    E, Z = (np.array([pair[k] for node in pairs for pair in node]) for k in (0, 1))
    return next(lemke.enumerate_all(E @ S @ Z.T, E @ s), None) is not None


def test_it_finds_a_solution_exactly_where_complementarity_has_one() -> None:
    solved = unsolved = 0
    for seed in range(150):
        m = 1 + seed % 3
        S, s, f = random_problem(seed, m)
        f *= 4.0
        kinds = np.random.default_rng(seed).integers(0, 3, m).tolist()
        found = exhaust(
            S, s, Friction(f, f), [KINDS[kind] for kind in kinds], np.zeros(m, dtype=bool)
        )
        assert (found is not None) == complementary(S, s, f, kinds), seed
        solved, unsolved = solved + (found is not None), unsolved + (found is None)
    assert solved > 60 and unsolved > 10


def test_a_found_set_satisfies_the_law() -> None:
    for seed in range(40):
        S, s, f = random_problem(seed, 3)
        states = exhaust(S, s, Friction(f, f), [ANY] * 3, np.zeros(3, dtype=bool))
        assert states is not None, seed
        # slips: v and w such that Q = -+ f P and w = 0; open nodes: no reaction
        equations, right = [], []
        for i, state in enumerate(states):
            Q, P, v, w = S[i], S[3 + i], np.eye(6)[i], np.eye(6)[3 + i]
            sign = {FORWARD: 1.0, BACKWARD: -1.0}.get(int(state), 0.0)
            if state == OPEN:
                equations += [Q, P]
                right += [-s[i], -s[3 + i]]
            elif state == STICK:
                equations += [v, w]
                right += [0.0, 0.0]
            else:
                equations += [Q + sign * f[i] * P, w]
                right += [-s[i] - sign * f[i] * s[3 + i], 0.0]
        u = np.linalg.solve(np.array(equations), np.array(right))
        x = S @ u + s
        assert np.all(x[3:] >= -1e-9) and np.all(u[3:] >= -1e-9)
        assert np.all(np.abs(x[:3]) <= f * x[3:] + 1e-9)
        assert np.all((x[:3] * u[:3] <= 1e-9) | (np.abs(u[:3]) <= 1e-9))


@pytest.mark.parametrize("pull", [-1.0, 1.0])
def test_one_node_with_strong_friction_has_no_answer_on_one_side(pull: float) -> None:
    # K_tt = K_nn = 1, K_tn = -0.9, f = 2: slip against the pull adds more friction than pull
    S = np.array([[1.0, -0.9], [-0.9, 1.0]])
    f, one = np.array([2.0]), np.zeros(1, dtype=bool)
    # at the limit of forward slip only: stick needs A = s_t + f s_n >= 0, slip v >= 0 with A = 0
    s = np.array([pull, 0.0])
    found = exhaust(S, s, Friction(f, f), [(STICK, FORWARD)], one)
    # forward: v = -s_t / (1 - 0.9 f) = s_t / 0.8; so both answers for a push, none for a pull
    assert (found is not None) == (pull > 0.0)


def test_smooth_nodes_know_contact_and_separation_only() -> None:
    S, f = np.diag([1.0, 4.0]), np.array([0.5])
    smooth = np.ones(1, dtype=bool)
    for s_n, expected in ((1.0, State.STICK), (-1.0, State.SEPARATION)):
        found = exhaust(S, np.array([0.0, s_n]), Friction(f, f), [(STICK, OPEN)], smooth)
        assert found is not None and found[0] == expected


def test_the_count_is_of_sets_and_the_limit_eight_free_nodes() -> None:
    choices = [ANY, (STICK, FORWARD), (STICK, OPEN)]
    assert count(choices) == len(list(product(*choices)))
    assert count([ANY] * 8) == enumerate_states.EXHAUSTED
