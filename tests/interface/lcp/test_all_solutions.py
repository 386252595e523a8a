"""All solutions of the rate problem: paper and pencil, and every set of states of another code."""

from dataclasses import replace

import numpy as np
import pytest
from equations import Body
from small import small_system
from ways import rates

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp import all_solutions as module
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import Undecided, choices
from receding_fenicsx.interface.system import ContactSystem

NONE = np.zeros(0, dtype=np.intp)


@pytest.mark.parametrize("n", [3, 24])
def test_only_a_search_that_finds_all_solutions_says_so(n: int) -> None:
    # K_tt - f K_nt = -.35: each node by itself may stick or slip back
    system = small_system(np.kron([[1.0, 0.9], [0.9, 1.0]], np.eye(n)), {"a": [1.0, 0.0] * n}, 1.5)
    r0 = np.concatenate([-np.ones(n), np.ones(n)])
    found = all_solutions(system, r0, Undecided(NONE, np.arange(n), NONE, NONE), NONE)
    assert len(found.states) > 0 and set(found.states.ravel().tolist()) <= {STICK, BACKWARD}
    assert found.complete == (len(found.states) == 2**n) == (n == 3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [0.0, 2e-15, -2e-15, 1e-13])
@pytest.mark.parametrize("scale", [1.0, 2.0**40])
def test_round_off_of_a_free_slide_carries_no_load(size: float, scale: float) -> None:
    # pressed down, a body that only friction holds sticks: slip would leave Q = -f P unbalanced
    K = scale * np.array([[size, 0.0], [0.0, 1.0]])
    system = small_system(K, {"press": [9.0, 20.0]}, 0.5)
    found = all_solutions(system, system.r_star[0], Undecided(NONE, NONE, np.arange(1), NONE), NONE)
    assert found.states.tolist() == [[STICK]] and found.complete


def random_system(seed: int, n: int, f: float) -> tuple[ContactSystem, Undecided]:
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((2 * n, 3 * n + 1))
    couple = np.diag(rng.uniform(0.5, 0.95, n))
    K = 0.15 * G @ G.T / n + np.kron(np.eye(2), np.eye(n)) + np.kron([[0, 1], [1, 0]], couple)
    system = small_system(K, {"a": rng.standard_normal(2 * n)}, rng.uniform(0.2, f, n))
    kinds = rng.permutation(np.arange(n)) % 4
    forward, back = (np.where(kinds == 3, 0.0, each) for each in (system.f, rng.uniform(0.2, f, n)))
    friction = replace(system, f=forward, f_backward=back if seed % 2 else None)
    nodes = [np.flatnonzero(kinds == kind) for kind in range(4)]
    return friction, Undecided(*nodes)


@pytest.mark.parametrize("tried_at_once", [2**10, 0])
def test_it_finds_what_all_sets_of_states_of_another_code_find(
    monkeypatch: pytest.MonkeyPatch, tried_at_once: int
) -> None:
    monkeypatch.setattr(module, "BATCH", tried_at_once)
    counts = []
    for seed in range(60):
        system, undecided = random_system(seed, 1 + seed % 5, 3.0)
        n, smooth = system.n, np.flatnonzero(system.f == 0.0)
        found = all_solutions(system, system.r_star[0], undecided, smooth)
        may = [choices(undecided)[i] for i in range(n)]
        expected = rates(Body(system), np.ones(1), may)
        assert found.complete and len(found.states) == len(expected), seed
        rows = {tuple(states) for states in found.states.tolist()}
        assert rows == {tuple(states) for states, _, _ in expected}
        counts.append(len(expected))
    # several, one and none occur
    assert {0, 1, 2} <= set(counts)


def test_many_slipping_nodes_with_little_friction_have_one_solution_without_trying_all() -> None:
    rng = np.random.default_rng(3)
    G = rng.standard_normal((60, 90))
    system = small_system(G @ G.T / 60, {"a": rng.standard_normal(60)}, 0.05)
    n, touching = np.arange(30), np.array([4, 17])
    rest = np.setdiff1d(n, touching)
    undecided = Undecided(rest[:15], rest[15:], touching, NONE)
    found = all_solutions(system, system.r_star[0], undecided, NONE)
    assert found.complete and len(found.states) == 1
    state, K, r = found.states[0], system.K, system.r_star[0]
    # the law of rates, written out
    rows, right = [], []
    for i in range(30):
        sign = {FORWARD: 1.0, BACKWARD: -1.0}.get(int(state[i]), 0.0)
        stick, open_ = state[i] == STICK, state[i] == SEPARATION
        rows += [np.eye(60)[i] if stick else K[i] + sign * 0.05 * K[30 + i] * (not open_)]
        right += [0.0 if stick else -r[i] - sign * 0.05 * r[30 + i] * (not open_)]
        rows += [K[30 + i] if open_ else np.eye(60)[30 + i]]
        right += [-r[30 + i] if open_ else 0.0]
    u = np.linalg.solve(np.array(rows), np.array(right))
    Q, P = (r + K @ u).reshape(2, 30)
    A, B, v = Q + 0.05 * P, 0.05 * P - Q, u[:30]
    assert A[undecided.forward].min() > -1e-12 and v[undecided.forward].min() > -1e-12
    assert B[undecided.backward].min() > -1e-12 and v[undecided.backward].max() < 1e-12
    assert min(A[touching].min(), B[touching].min(), u[30 + touching].min()) > -1e-12
