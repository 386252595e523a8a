"""All solutions of the rate problem: paper and pencil, and every set of states of another code."""

from dataclasses import replace

import numpy as np
import pytest
from equations import Body
from small import small_system
from ways import rates

from receding_fenicsx.interface.law import BACKWARD, STICK
from receding_fenicsx.interface.lcp import all_solutions as module
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import Undecided, choices
from receding_fenicsx.interface.system import ContactSystem

NONE = np.zeros(0, dtype=np.intp)


# K_tt - f K_nt and f P - Q of two nodes: each sticks or slips back; one slips, the other, or both
@pytest.mark.parametrize(("M", "sign", "each"), [(-np.eye(2), 1, 4), ([[1, 4], [4, 9]], -1, 3)])
@pytest.mark.parametrize("pairs", [2, 12])
def test_only_a_search_that_finds_all_solutions_says_so(
    M: np.ndarray, sign: int, each: int, pairs: int
) -> None:
    K_nt = np.diag([1, 9]) - M
    K = np.kron(np.block([[np.diag([1, 9]), K_nt], [K_nt, 99 * np.eye(2)]]), np.eye(pairs))
    system = small_system(K, {"a": np.kron(sign * np.array([-1, -3, 0, 0]), np.ones(pairs))}, 1.0)
    undecided = Undecided(NONE, np.arange(2 * pairs), NONE, NONE)
    found = all_solutions(system, system.r_star[0], undecided, NONE)
    assert len(found.states) > 0 and set(found.states.ravel().tolist()) <= {STICK, BACKWARD}
    assert found.complete == (len(found.states) == each**pairs) == (pairs == 2)


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
