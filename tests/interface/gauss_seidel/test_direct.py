"""One linear solve for given states, against the laws that each state stands for."""

import numpy as np
import pytest
from law import random_system

from receding_fenicsx.interface.gauss_seidel.sweeps import solve_directly
from receding_fenicsx.interface.system import reactions


@pytest.mark.parametrize("seed", range(3))
def test_every_state_keeps_its_law(seed: int) -> None:
    n = 6
    system = random_system(seed, n, 0.4)
    system.g0[:] = 0.1 * np.arange(n)
    system.held[2], system.held[n + 3] = True, True
    state = np.array([1, 3, 4, 2, 4, 2], dtype=np.int8)
    load, stuck_at = np.array([1.0, -0.3]), 0.01 * np.arange(1.0, n + 1.0)
    given = 0.1 * np.cos(np.arange(2.0 * n))
    u = solve_directly(system, load, given, stuck_at, state)
    assert u is not None
    r, f = reactions(system, load, u), system.f[0]
    v, w, Q, P = u[:n], u[n:], r[:n], r[n:]
    assert v[0] == stuck_at[0]
    # what is held keeps its place, whatever the state
    assert (v[2], w[3]) == (given[2], given[n + 3])
    touching = [0, 1, 2, 4]
    assert w[touching] == pytest.approx(-system.g0[touching], abs=1e-15)
    scale = np.abs(r).max()
    assert abs(Q[1] + f * P[1]) < 1e-13 * scale
    assert abs(Q[4] - f * P[4]) < 1e-13 * scale
    assert np.abs([Q[3], Q[5], P[5]]).max() < 1e-13 * scale
