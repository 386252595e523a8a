"""The rate problem of a contact by brute force: all states of all nodes that sit on a limit.

Nothing of the package's solvers is used; the definitions are the paper's eqs. (4) to (12).
"""

import re
from itertools import product

import numpy as np
from small import table

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution import evolve
from receding_fenicsx.history import History
from receding_fenicsx.interface.contact import ContactSystem

STICK, OPEN, FORWARD, BACKWARD = 1, 2, 3, 4


def possible_states(
    system: ContactSystem, r: np.ndarray, u: np.ndarray, state: np.ndarray, near: float
) -> list[tuple[int, ...]]:
    """Return the states that each node may take next.

    Args:
        system: model of a few nodes with friction.
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
        every = (STICK, OPEN) if system.held[i] else (STICK, OPEN, FORWARD, BACKWARD)
        if state[i] == OPEN:
            choices.append(every if gap[i] * k[i] <= near * force else (OPEN,))
        elif P[i] <= near * force:
            choices.append(every)
        elif system.held[i]:
            choices.append((STICK,))
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
        system: model with friction and with a few nodes on limits.
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
                if system.held[i]:
                    A[t], b[t] = np.eye(2 * n)[t], 0.0
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


def confirmed(system: ContactSystem, history: History, error: SolveError) -> bool:
    """Return whether no rates of any kind satisfy the law where the error says that none do.

    The exact path is followed to just before that place, all states are tried there.
    """
    text = str(error)
    found = re.search(r"cycle (\d+), leg (\d+): .* \(s = (\S+) of the leg\)", text)
    assert found is not None, text
    cycle, leg, s = int(found[1]), int(found[2]), float(found[3])
    polyline = history.path if cycle == 0 else history.loop
    before = [*history.path[:-1]] + [*history.loop[:-1]] * (cycle - 1) if cycle else []
    corners = [*before, *polyline[: leg + 1]]
    a, b = polyline[leg], polyline[leg + 1]
    if s > 1e-8:
        corners.append((1.0 - s + 1e-8) * a + (s - 1e-8) * b)
    short = table(system, corners)
    end = evolve(system, short).turning_points
    direction = (b - a) @ system.r_star
    # the record is of the whole contact, the axis node carrying both halves
    state, Q, P, v, w = (
        getattr(end, name)[-1, -system.n :].copy() for name in ("state", "Q", "P", "v", "w")
    )
    P[0] *= 0.5 if system.half else 1.0
    r, u = np.concatenate([Q, P]), np.concatenate([v, w])
    return not rate_solutions(system, direction, r, u, state, near=1e-4)
