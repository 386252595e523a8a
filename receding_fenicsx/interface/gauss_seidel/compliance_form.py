"""A load step as the local frictional contact problem that general solvers take.

With the reactions r of the plane as unknowns, at every contact the normal part before the
tangential one, and rigid motions rho that nothing but the contact hinders,

    u = W r + V rho + q,    V^T r + s = 0,

where u_N is the gap at the end of the step and u_T the slip in the step, find r and u with

    0 <= u_N, 0 <= r_N, u_N r_N = 0,    |r_T| <= mu r_N,  r_T = -mu r_N u_T / |u_T| where u_T != 0

(Acary, Bremond, Koziara, Perignon: *FCLIB: a collection of discrete 3D frictional contact
problems*, 2014). It is eqs. (4) to (11) of Ahn & Barber (2008) for one step, with the slip of every
node counted from the start of the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem, frictional_form
from receding_fenicsx.interface.system_checks import check_system


@dataclass(frozen=True)
class StepProblem:
    """One step of m contacts; the unknowns are [N, T] of each, one after the other."""

    W: Array  # (2m, 2m) compliance, symmetric, positive semi-definite
    q: Array  # (2m,) gaps and slips without reactions
    mu: Array  # (m,) coefficients of friction
    V: Array  # (2m, p) rigid motions that only the contact hinders
    s: Array  # (p,) resultant of the loads along them, with the sign of V^T r + s = 0
    nodes: NDArray[np.intp]  # (m,) contact node of each contact


@dataclass(frozen=True)
class StepSolution:
    """What solves a :class:`StepProblem`."""

    u: Array  # (2m,) gaps and slips
    r: Array  # (2m,) reactions
    rho: Array  # (p,) rigid motions


def step_problem(
    system: ContactSystem, load: Array, start: ContactState | None = None
) -> StepProblem:
    """Return the problem of one step to the load factors (n_loads,), from rest by default.

    Nodes that a support holds normally are no contacts. A node that is held tangentially has no
    friction, and a compliance of its own that leaves it where it is.

    Raises:
        InputError: an array is wrong, friction is more than one coefficient, or K has no compliance
            to half the digits.
    """
    check_system(system)
    if system.has_branches or system.f_backward is not None:
        raise InputError(
            "friction differs forward and backward, or has a shear limit or cohesion; the local "
            "frictional contact problem has one coefficient for both directions and no more"
        )
    model = frictional_form(system)
    n, held = model.n, model.held
    free = np.flatnonzero(~held)
    v = np.zeros(n) if start is None else start.v
    # with orthonormal rigid motions X, K + c X X^T is regular and its inverse less X X^T / c is K^+
    X = np.linalg.qr(model.rigid[free])[0]
    K = model.K[np.ix_(free, free)]
    c = float(np.trace(K)) / len(free)
    regular = K + c * X @ X.T
    try:
        inverse = np.linalg.inv(regular)
    except np.linalg.LinAlgError:
        inverse = np.full_like(regular, np.inf)
    with np.errstate(invalid="ignore"):
        error = np.abs(regular @ inverse - np.eye(len(free))).max()
    if not error <= 1e-8:
        raise InputError(
            "the stiffness is singular to round-off beside its rigid motions, so that the problem "
            "has no compliance form; hold the parts that are almost free to move"
        )
    whole, r = np.zeros((2 * n, 2 * n)), load @ model.r_star
    whole[np.ix_(free, free)] = 0.5 * (inverse + inverse.T) - X @ X.T / c
    nodes = np.flatnonzero(~held[n:])
    order = np.stack([n + nodes, nodes], axis=1).ravel()
    W, q = whole[np.ix_(order, order)], -(whole @ r)[order]
    q[0::2] += model.g0[nodes]
    still = held[nodes]
    q[1::2] = np.where(still, 0.0, q[1::2] - v[nodes])
    alone = 2 * np.flatnonzero(still) + 1
    W[alone, alone] = 1.0 / float(np.median(model.local_stiffness[1]))
    return StepProblem(
        W=W,
        q=q,
        mu=np.where(still, 0.0, model.f[nodes]),
        V=model.rigid[order],
        s=-model.rigid[free].T @ r[free],
        nodes=nodes,
    )


def solve_problem(
    system: ContactSystem, load: Array, start: ContactState | None = None
) -> StepSolution:
    """Solve the problem of :func:`step_problem` by this program's Gauss-Seidel method.

    Raises:
        NotConverged: the sweeps ran out.
    """
    model = frictional_form(system)
    n = model.n
    if start is None:
        start = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.zeros(n, dtype=np.int8))
    # a node that counts as touching slips from where it was at the start
    touching = replace(start, state=np.full(n, State.STICK, dtype=np.int8))
    end = solve_step(model, touching, load, GaussSeidelOptions()).end
    problem = step_problem(system, load, start)
    i = problem.nodes
    r = np.stack([end.P[i], np.where(model.held[i], 0.0, end.Q[i])], axis=1).ravel()
    slip = np.where(model.held[i], 0.0, end.v[i] - start.v[i])
    u = np.stack([model.g0[i] + end.w[i], slip], axis=1).ravel()
    rest = u - problem.W @ r - problem.q
    return StepSolution(u, r, np.linalg.lstsq(problem.V, rest, rcond=None)[0])
