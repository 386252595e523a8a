"""Every way that a contact can go on along a leg, by trying all states of all nodes on limits.

The judge of refusals: slow, for a few nodes, nothing of the package's solvers. In every set of
states the rates follow from a linear system (``replay.States``); sets whose rates keep all
inequalities lead on, to the next place where a limit is reached.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy.optimize
from equations import BACKWARD, EPS, FORWARD, OPEN, STICK, Array, Body, States
from replay import HELD_SHARE

PRESSED = 7
"""Marks a touching node without pressure whose bond holds: it has to stay pressed."""
NEAR = 1e-9
"""Distance from a limit, over the largest force, that counts as being on it."""
SLACK = 1e-9
"""Violation of a rate inequality, over the largest rate of its kind, that is let pass."""
TRIED = 4**6
"""Sets of states that are gone through at most at one place."""


class TooMany(Exception):
    """More sets of states, or pieces, than can be gone through."""


class End(NamedTuple):
    """Where one branch ends."""

    s: float  # place on the leg; 1 where it goes all the way
    u: Array
    state: Array  # before


def choices(body: Body, r: Array, u: Array, state: Array, near: Array) -> list[tuple[int, ...]]:
    """Return the states that each node may take next; ``near`` is (2N,), in forces."""
    n = body.n
    Q, P, gap = r[:n], r[n:], (body.g0 + u[n:]) * body.k[n:]
    found: list[tuple[int, ...]] = []
    for i in range(n):
        if body.branched and body.rubs[i] and not (state[i] == OPEN and gap[i] > near[n + i]):
            found.append(_choices_of_branches(body, i, (float(Q[i]), float(P[i])), near))
            continue
        if body.carried[i]:
            found.append((STICK,))
        elif state[i] == OPEN and gap[i] > near[n + i]:
            found.append((OPEN,))
        elif state[i] == OPEN or P[i] <= near[n + i]:
            found.append((STICK, OPEN, FORWARD, BACKWARD) if body.rubs[i] else (STICK, OPEN))
        elif not body.rubs[i]:
            found.append((STICK,))
        else:
            limit = near[i] + max(body.f[i], body.f_backward[i]) * near[n + i]
            may = [STICK]
            if Q[i] + body.f[i] * P[i] <= limit:
                may.append(FORWARD)
            if body.f_backward[i] * P[i] - Q[i] <= limit:
                may.append(BACKWARD)
            found.append(tuple(may))
    return found


def _choices_of_branches(
    body: Body, i: int, force: tuple[float, float], near: Array
) -> tuple[int, ...]:
    """Return the states of a touching node: slip on either branch where Q is at it."""
    (Q, P), n = force, body.n
    f, back, c, t = body.f[i], body.f_backward[i], body.c[i], body.t[i]
    limit = near[i] + max(f, back) * near[n + i]
    may = [STICK]
    if P <= near[n + i]:
        # under shear its cohesion would be lost at once
        may += [OPEN] if abs(Q) <= near[i] else [PRESSED]
    for states, side, slope in (((FORWARD, 5), Q, f), ((BACKWARD, 6), -Q, back)):
        reached = slope * P + c + side <= limit, t + side <= limit
        may += [state for state, at in zip(states, reached, strict=True) if at]
    return tuple(may)


def _states(body: Body, states: Array) -> States:
    """Return the equations of states, 5 and 6 being slip at the shear limit."""
    body.capped = states >= 5
    return body.states(np.where(states >= 5, states - 2, states))


def rates(
    body: Body, way: Array, may: list[tuple[int, ...]], most: int = TRIED
) -> list[tuple[Array, Array, Array]]:
    """Return (states, du, dr) of every different solution of the rate problem.

    ``way`` is (n_loads,) the rate of the load factors, ``may`` the states that each node may take.
    """
    if np.prod([float(len(c)) for c in may]) > most:
        raise TooMany
    found: list[tuple[Array, Array, Array]] = []
    held = way @ body.r_star
    for states in product(*([s for s in c if s != PRESSED] for c in may)):
        here = _states(body, np.array(states))
        du = here.rates(way)
        if np.abs(here.M @ du + here.mix @ held).max() > SLACK * np.abs(held).max():
            continue  # a motion that nothing resists is loaded
        scale = max(float(np.abs(held + body.K @ du).max()), float(np.abs(body.k * du).max()))
        dr = held + body.K @ du
        rows, right, forces = _inequalities(body, held, states, may)
        # displacements in a nearly singular body are no measure of its forces
        of_forces = _force_slack(body, du, dr) + 64 * EPS * float(np.abs(held).max())
        slack = np.where(forces, of_forces, (SLACK + 64 * EPS * here.condition) * scale)
        if len(here.free) and np.any(rows @ du + right < -slack):
            du = du + _along(here.free, rows.astype(float), rows @ du + right)
        if np.any(rows @ du + right < -slack):
            continue
        # rates closer than this mean the same
        if all(np.abs(body.k * (du - other[1])).max() > 1e-7 * scale for other in found):
            found.append((np.array(states), du, held + body.K @ du))
    return found


def _inequalities(
    body: Body, held: Array, states: tuple[int, ...], may: list[tuple[int, ...]]
) -> tuple[Array, Array, Array]:
    """Return A and b of what A du + b >= 0 has to hold in a set of states, as forces.

    The third value tells which are rates of forces, not of displacements.
    """
    n, eye = body.n, np.diag(body.k).astype(np.longdouble)
    rows: list[tuple[Array, Any, bool]] = [(np.zeros(2 * n, np.longdouble), 0.0, False)]
    for i, (state, choice) in enumerate(zip(states, may, strict=True)):
        t, m, f, back = i, n + i, body.f[i], body.f_backward[i]
        if len(choice) == 1:
            continue
        if state == OPEN:
            rows.append((eye[m], 0.0, False))
            continue
        if OPEN in choice or PRESSED in choice:
            rows.append((body.K[m], held[m], True))
        if state in (FORWARD, 5):
            rows.append((eye[t], 0.0, False))
        if state in (BACKWARD, 6):
            rows.append((-eye[t], 0.0, False))
        # margins of stuck nodes, and those of the other branch of slipping ones
        for side, slip, slope in (
            (1.0, FORWARD, f),
            (-1.0, BACKWARD, back),
            (1.0, 5, 0.0),
            (-1.0, 6, 0.0),
        ):
            if slip in choice and slip != state:
                rate = slope * body.K[m] + side * body.K[t], slope * held[m] + side * held[t]
                rows.append((*rate, True))
    A, b, forces = zip(*rows, strict=True)
    return np.array(A), np.array(b, np.longdouble), np.array(forces)


def _force_slack(body: Body, du: Array, dr: Array) -> float:
    """Return the violation of an inequality of forces that is let pass, and their round-off."""
    return SLACK * float(np.abs(dr).max()) + 64 * EPS * float((np.abs(body.K) @ np.abs(du)).max())


def _along(free: Array, A: Array, b: Array) -> Array:
    """Return a motion among those left free that mends violated inequalities."""
    m = len(free)
    answer = scipy.optimize.linprog(
        np.zeros(m), A_ub=-(A @ free.T), b_ub=b.astype(float), bounds=[(None, None)] * m
    )
    return answer.x @ free if answer.success else np.zeros(free.shape[1])


def follow(
    system: Any,
    a: Array,
    b: Array,
    u: Array,
    state: Array,
    force: float,
    close: float = NEAR,
    counts: list[int] | None = None,
) -> list[End]:
    """Return the ends of all branches along a leg from u (2N,) and states (N,).

    Load factors go from ``a`` to ``b``; ``force`` is the largest nodal force so far, ``close`` the
    distance from a limit over it that counts as being on it. ``counts`` takes the number of
    continuations at each instant.
    """
    body = Body(system)
    a, b = np.array(a, np.longdouble), np.array(b, np.longdouble)
    force = max(force, HELD_SHARE * float(np.abs(np.array([a, b]) @ body.r_star).max()))
    u = np.array(u, np.longdouble)
    if not np.any(a):
        u = _laid(system, body, b - a, u)
        # nodes that the body has rolled off touch no more
        rolled_off = (body.g0 + u[body.n :]) * body.k[body.n :] > NEAR * force
        state = np.where(rolled_off & ~body.carried, OPEN, state)
    ends: list[End] = []
    waiting = [(0.0, u, np.array(state, int), 0)]
    pieces = 0
    while waiting:
        s, u, state, still = waiting.pop()
        load = (1 - s) * a + s * b
        near = close * force + body.round_off(load, u)
        r = body.reactions(load, u)
        found = rates(body, b - a, choices(body, r, u, state, near))
        if counts is not None:
            counts.append(len(found))
        if not found or still > 50:  # changes of state at one place
            ends.append(End(s, u.astype(float), state))
            continue
        for now, du, dr in found:
            pieces += 1
            if pieces > 400:
                raise TooMany
            ds = _next(body, now, u, r, du, dr, near)
            if s + ds >= 1.0 - 1e-13:
                slips = np.where(now >= 5, now - 2, now)
                ends.append(End(1.0, (u + (1.0 - s) * du).astype(float), slips))
            else:
                waiting.append((s + ds, u + ds * du, now, still + 1 if ds < 1e-11 else 0))
    return ends


def _next(body: Body, now: Array, u: Array, r: Array, du: Array, dr: Array, near: Array) -> float:
    """Return how far the next limit is."""
    n, f, back = body.n, body.f, body.f_backward
    touches, law = now != OPEN, ~body.carried
    k, rubs = body.k[n:], body.rubs & touches
    margins = [(r[n:], dr[n:], law & touches, near[n:])]
    for side, slip, slope, offset in (
        (-1.0, BACKWARD, back, body.c),
        (1.0, FORWARD, f, body.c),
        (-1.0, 6, 0.0, body.t),
        (1.0, 5, 0.0, body.t),
    ):
        # a slipping node may pass to its other branch
        counts = rubs & ((now == STICK) | (body.branched & (now != slip)))
        value = slope * r[n:] + side * r[:n] + offset
        margins.append(
            (value, slope * dr[n:] + side * dr[:n], counts & np.isfinite(offset), near[:n])
        )
    margins += [((body.g0 + u[n:]) * k, du[n:] * k, law & ~touches, near[n:])]
    of_forces = _force_slack(body, du, dr)
    slacks = *[of_forces] * 5, SLACK * float(np.abs(body.k * du).max())
    first = np.inf
    for (value, rate, where, close), slack in zip(margins, slacks, strict=True):
        # what lies on its limit has been decided by the rates
        falls = where & (rate < -slack) & (value > close)
        if np.any(falls):
            first = min(first, float((value[falls] / -rate[falls]).min()))
    return first


def _laid(system: Any, body: Body, way: Array, u: Array) -> Array:
    """Roll an unloaded free body with gaps to where the first load lets it rest."""
    n, R = body.n, np.asarray(system.rigid, float)
    if R.shape[1] == 0 or not np.any(body.g0):
        return u
    loose = ~body.held[:n]
    _, size, right = np.linalg.svd(R[:n][loose], full_matrices=True)
    R = R @ right[np.count_nonzero(size > 1e-8) :].T
    if R.shape[1] == 0:
        return u
    law = ~body.carried
    cost = (way @ body.r_star).astype(float) @ R
    gap = np.maximum((body.g0 + u[n:]).astype(float), 0.0)
    lift = np.repeat([0.0, 1.0], n)
    lifts = np.abs(R @ np.linalg.lstsq(R, lift, rcond=None)[0] - lift).max() <= 1e-8
    if lifts and not np.any(gap[law] == 0.0):
        return u
    answer = scipy.optimize.linprog(
        cost, A_ub=-R[n:][law], b_ub=gap[law], bounds=[(None, None)] * R.shape[1]
    )
    if not answer.success or answer.fun >= -1e-9 * np.abs(cost).max() * gap.max():
        return u
    return u + R @ answer.x


def balanced(system: Any, load: Array) -> bool:
    """Return whether contact forces exist that balance the loads on the rigid motions: R^T r = 0.

    r = sum lambda r* + K u, K R = 0, with P >= 0 and |Q| <= min(f P + c, t), is a linear program.
    """
    body, R = Body(system), np.asarray(system.rigid, float)
    n, law = body.n, ~body.carried
    rubs = np.flatnonzero(body.rubs)
    # each friction cone is spanned by its edges; without friction P alone
    smooth = np.flatnonzero(law & ~body.rubs)
    f, back = body.f[rubs][:, None], body.f_backward[rubs][:, None]
    edges = np.vstack([R[n + smooth], R[n + rubs] - f * R[rubs], R[n + rubs] + back * R[rubs]])
    held = (load @ body.r_star).astype(float)
    if R.shape[1] == 0:
        return True
    if body.branched and len(rubs):
        # here with P and Q themselves
        m, eye = len(rubs), np.eye(len(rubs))
        cone = np.vstack([np.hstack([-f * eye, -eye]), np.hstack([-back * eye, eye])])
        rows = np.hstack([np.zeros((2 * m, len(smooth))), cone])
        found = scipy.optimize.linprog(
            np.zeros(len(smooth) + 2 * m),
            A_ub=rows,
            b_ub=np.tile(body.c[rubs], 2),
            A_eq=np.vstack([R[n + smooth], R[n + rubs], R[rubs]]).T,
            b_eq=held @ R,
            bounds=[(0.0, None)] * (len(smooth) + m) + [(-t, t) for t in body.t[rubs]],
        )
        return bool(found.success)
    if not len(edges):
        return bool(np.abs(held @ R).max() <= 1e-12 * np.abs(held).sum())
    answer = scipy.optimize.linprog(np.zeros(len(edges)), A_eq=edges.T, b_eq=held @ R)
    return bool(answer.success)
