"""The rate problem of a contact by brute force: all states of all nodes that sit on a limit.

Nothing of the package's solvers is used; the definitions are the paper's eqs. (4) to (12).
"""

from itertools import product

import numpy as np

from receding_fenicsx.interface.contact import ContactSystem

STICK, OPEN, FORWARD, BACKWARD = 1, 2, 3, 4


def possible_states(
    system: ContactSystem, r: np.ndarray, u: np.ndarray, state: np.ndarray, near: float
) -> list[tuple[int, ...]]:
    """Return the states that each node may take next.

    Args:
        system: whole model of at most a few nodes.
        r: reactions.
        u: displacements.
        state: present states.
        near: distance from a limit, over the largest force, that counts as being on it.
    """
    n = system.n
    Q, P, gap = r[:n], r[n:], system.g0 + u[n:]
    force = max(np.abs(r).max(), 0.01 * np.abs(system.r_star).max())
    k = np.diagonal(system.K)[n:]
    choices: list[tuple[int, ...]] = []
    for i in range(n):
        if state[i] == OPEN:
            touching = gap[i] * k[i] <= near * force
            choices.append((STICK, OPEN, FORWARD, BACKWARD) if touching else (OPEN,))
        elif P[i] <= near * force:
            choices.append((STICK, OPEN, FORWARD, BACKWARD))
        else:
            may = [STICK]
            if Q[i] + system.f[i] * P[i] <= near * force:
                may.append(FORWARD)
            if system.f[i] * P[i] - Q[i] <= near * force:
                may.append(BACKWARD)
            choices.append(tuple(may))
    return choices


def rate_solutions(
    system: ContactSystem,
    direction: np.ndarray,
    r: np.ndarray,
    u: np.ndarray,
    state: np.ndarray,
    near: float,
    slack: float = 1e-6,
) -> list[tuple[int, ...]]:
    """Return every combination of states whose rates satisfy the law.

    Args:
        system: whole model of at most a few nodes.
        direction: (2N,) rate of the held reactions.
        r: reactions.
        u: displacements.
        state: present states.
        near: distance from a limit that counts as being on it.
        slack: violation of a rate inequality, over the largest rate, that is let pass.
    """
    n, f, K = system.n, system.f, system.K
    choices = possible_states(system, r, u, state, near)
    found = []
    for states in product(*choices):
        # rows: what vanishes for each unknown rate
        A, b = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
        for i, s in enumerate(states):
            t, m = i, n + i
            if s == STICK:
                A[t, t] = A[m, m] = 1.0
            elif s == OPEN:
                A[t], A[m] = K[t], K[m]
                b[t], b[m] = -direction[t], -direction[m]
            else:
                sign = 1.0 if s == FORWARD else -1.0
                A[t], b[t] = K[t] + sign * f[i] * K[m], -direction[t] - sign * f[i] * direction[m]
                A[m, m] = 1.0
        if np.linalg.cond(A) > 1e12:
            continue
        du = np.linalg.solve(A, b)
        dr = direction + K @ du
        force = max(np.abs(dr).max(), np.abs(np.diagonal(K) * du).max())
        kept = True
        for i, s in enumerate(states):
            Q, P, dv, dw = dr[i], dr[n + i], du[i], du[n + i]
            k_t, k_n = K[i, i], K[n + i, n + i]
            was = choices[i]
            checks = []
            if s == OPEN and len(was) > 1:
                checks.append(dw * k_n)
            if s == FORWARD:
                checks.append(dv * k_t)
            if s == BACKWARD:
                checks.append(-dv * k_t)
            if s != OPEN and OPEN in was:
                checks.append(P)
            if s == STICK and FORWARD in was:
                checks.append(Q + f[i] * P)
            if s == STICK and BACKWARD in was:
                checks.append(f[i] * P - Q)
            kept &= all(value >= -slack * force for value in checks)
        if kept:
            found.append(states)
    return found
