"""Margins of a closed contact, affine in residual slip and load range, and programs over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import InputError, NoEquilibrium, SolveError
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

FORWARD, BACKWARD, UNLOADS, TOUCHES = "forward slip", "backward slip", "unloads", "touches"
"""Names of the margins A = Q + f P, B = f P - Q, P and the gap: what happens where they vanish."""

REFUSE, STAY = "refuse", "stay"
"""Nodes separated under the mean loads: an error, or taken as separated throughout."""

VANISHES = 1e-9
"""Largest violated margin of an accepted answer, and sum of a target's margins that is zero, over
the largest margin of the mean loads."""
BINDS = 1e-7
"""Margin below which a row binds."""

Loads = Mapping[str, float]
"""Load factors by the names of their loads; loads that are not named have the factor 0."""


@dataclass(frozen=True)
class LoadRange:
    """Loads mean + lambda vertex_k, k = 1 to V."""

    mean: Array  # (n_loads,) load factors
    vertices: Array  # (V, n_loads) changes of the load factors at lambda = 1


@dataclass(frozen=True)
class Margins:
    """Margins G y + c + mu D_k >= 0 at the vertices k of a load range, scaled to order one."""

    G: Array  # (rows, m) influence of the scaled residual slips y
    c: Array  # (rows,) margins under the mean loads without residual slip
    by_load: Array  # (rows, n_loads) change of the margins per unit of each load factor
    D: Array  # (rows, V) change of the margins at each vertex per unit of the scaled range mu
    node: Ints  # (rows,) contact node of each row
    kind: tuple[str, ...]  # (rows,) what happens where the row vanishes
    # rows that vanish together where a node may leave its stick for good: both friction limits of a
    # node with friction, the pressure of one without
    targets: tuple[tuple[int, ...], ...]
    nodes: Ints  # (m,) contact nodes with friction, whose residual slip is unknown
    slip_scale: Array  # (m,) residual slip per unit of y
    range_scale: float  # lambda per unit of mu
    coupled: bool  # whether residual slip changes a pressure or a gap

    @property
    def d(self) -> Array:
        """(rows,) the smallest of D over the vertices: the only one that can bind for mu > 0."""
        return np.asarray(self.D.min(axis=1))


def load_range(system: ContactSystem, mean: Loads, vertices: Sequence[Loads]) -> LoadRange:
    """Return mean loads and range as arrays; the mean has to lie in the polygon of the range."""
    corners = [_factors(system, vertex, "range") for vertex in vertices]
    every = np.array(corners).reshape(-1, len(system.load_names))
    found = LoadRange(_factors(system, mean, "mean"), every)
    size = float(np.abs(found.vertices).max(initial=0.0))
    if size == 0.0:
        raise InputError("range: is empty; give at least two different sets of load factors")
    if not np.any(found.vertices @ system.r_star):
        raise InputError("range: its loads cause no reactions on the contact; give other loads")
    weights = np.vstack([found.vertices.T / size, np.ones(len(vertices))])
    target = np.append(np.zeros(len(system.load_names)), 1.0)
    _, distance = scipy.optimize.nnls(weights, target)
    if distance > 1e-9:
        raise InputError(
            "range: the mean loads are not among its convex combinations, so that the range does "
            "not shrink to them; move the mean, or add {} to the range"
        )
    return found


def _factors(system: ContactSystem, loads: Loads, where: str) -> Array:
    """Return load factors (n_loads,) by the names of the system's loads."""
    if not isinstance(loads, Mapping):
        raise InputError(f"{where}: must be load factors by name, {{name: number}}, not {loads!r}")
    unknown = [name for name in loads if name not in system.load_names]
    if unknown:
        raise InputError(
            f"{where}: '{unknown[0]}' is not a load of the scene; its loads are "
            f"{', '.join(system.load_names)}"
        )
    try:
        values = np.array([float(loads.get(name, 0.0)) for name in system.load_names])
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if not np.all(np.isfinite(values)):
        raise InputError(f"{where}: load factors must be finite numbers, not {dict(loads)}")
    return values


def margins_of(system: ContactSystem, loads: LoadRange, separated: NDArray[np.bool_]) -> Margins:
    """Return the margins of a contact whose set of touching nodes is given and constant.

    Tangential displacements of nodes without friction (Q = 0) and both displacements of the (N,)
    nodes separated throughout (Q = P = 0) are eliminated by eq. (11); closed nodes have w = -g0.
    Margins are over the largest one of the mean loads, slips over that of its force.
    """
    n, friction = system.n, system.friction
    away = separated & ~system.held[n:]
    loose, pressed = ~system.held[:n], ~system.held[n:] & ~away
    nodes = np.flatnonzero(loose & pressed & friction.present)
    if not len(nodes):
        raise InputError("shakedown: no node that touches has friction; give [contact] friction")
    u, r = _affine(system, nodes, away)
    f_forward, f_backward = friction.forward[nodes, None], friction.backward[nodes, None]
    others = np.flatnonzero(pressed & ~np.isin(np.arange(n), nodes))
    gaps = np.flatnonzero(away)
    gap = u[n + gaps]
    gap[:, len(nodes)] += system.g0[gaps]
    stiffness = np.diagonal(system.K)
    rows = np.vstack(
        [
            r[nodes] + f_forward * r[n + nodes],
            f_backward * r[n + nodes] - r[nodes],
            r[n + others],
            stiffness[n + gaps, None] * gap,
        ]
    )
    m, q, p = len(nodes), len(others), len(gaps)
    # pressures and gaps, as forces, that a residual slip changes
    normal = np.vstack([r[n:][pressed, :m], rows[len(rows) - p :, :m]])
    kind = (FORWARD,) * m + (BACKWARD,) * m + (UNLOADS,) * q + (TOUCHES,) * p
    targets = [(i, m + i) for i in range(m)] + [(2 * m + i,) for i in range(q + p)]
    by_load = rows[:, m + 1 :]
    c, D = rows[:, m] + by_load @ loads.mean, by_load @ loads.vertices.T
    force, change = float(np.abs(c).max()), float(np.abs(D).max())
    if force == 0.0:
        raise InputError("mean: its loads do not press the contact; add the load that does")
    slip, size = force / system.local_stiffness[0][nodes], force / change if change else 1.0
    return Margins(
        rows[:, :m] * slip / force,
        c / force,
        by_load / force,
        D * (size / force),
        np.concatenate([nodes, nodes, others, gaps]),
        kind,
        tuple(targets),
        nodes,
        slip,
        size,
        bool(np.abs(normal).max() > 1e-10 * np.abs(r[nodes, :m]).max()),
    )


def _affine(system: ContactSystem, nodes: Ints, away: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return u and r as (2N, m + 1 + n_loads) matrices that multiply [v of nodes; 1; lambda]."""
    n, m = system.n, len(nodes)
    u = np.zeros((2 * n, m + 1 + len(system.load_names)))
    u[nodes, np.arange(m)] = 1.0
    closed = ~system.held[n:] & ~away
    u[n:, m] = np.where(closed, -system.g0, 0.0)
    forces = np.zeros_like(u)
    forces[:, m + 1 :] = system.r_star.T
    free = np.concatenate([~np.isin(np.arange(n), nodes), away]) & ~system.held
    e = np.flatnonzero(free)
    if len(e):
        try:
            np.linalg.cholesky(system.K[np.ix_(e, e)])
        except np.linalg.LinAlgError:
            raise InputError(
                "shakedown: nodes without friction or contact can move without resistance; add a "
                "[[support]]"
            ) from None
        u[e] = -np.linalg.solve(system.K[np.ix_(e, e)], (system.K @ u + forces)[e])
    return u, system.K @ u + forces


def with_bound(margins: Margins, largest_slip: float | None) -> Margins:
    """Return margins with rows that bound the residual slips, after the others."""
    if largest_slip is None:
        return margins
    if not largest_slip > 0.0:
        raise InputError(f"largest_slip: must be positive, not {largest_slip:g}")
    m, bound = len(margins.nodes), largest_slip / margins.slip_scale
    by_load, D = (np.pad(rows, ((0, 2 * m), (0, 0))) for rows in (margins.by_load, margins.D))
    G, c = np.vstack([margins.G, np.eye(m), -np.eye(m)]), np.concatenate([margins.c, bound, bound])
    return replace(margins, G=G, c=c, by_load=by_load, D=D)


def prepared(
    system: ContactSystem, loads: LoadRange, separated: str = REFUSE
) -> tuple[Margins, NDArray[np.bool_]]:
    """Return the margins of a range and the separated nodes; refuse what has no limits."""
    if system.kind == "normal" or not np.any(system.friction.present):
        raise InputError("shakedown: the scene has no friction; give [contact] friction")
    if separated not in (REFUSE, STAY):
        raise InputError(f'separated: "{separated}" is unknown; use "{REFUSE}" or "{STAY}"')
    away = np.zeros(system.n, dtype=bool)
    if separated == STAY:
        away = _mean_state(system, loads.mean).state == SEPARATION
    margins = margins_of(system, loads, away)
    answer = largest_margin(margins)
    if answer.value <= 1.0 + VANISHES:
        return margins, away
    nodes = np.unique(margins.node[answer.multipliers > VANISHES])
    reason = "change the mean loads or the friction"
    if separated == REFUSE:
        try:
            away = _mean_state(system, loads.mean).state == SEPARATION
        except NoEquilibrium as error:
            reason = str(error)
        if np.any(away):
            raise InputError(
                f"mean: {_named(system, np.flatnonzero(away))} separated under the mean loads; "
                "press the contact together, or take these nodes as separated throughout by "
                f'separated = "{STAY}"'
            )
    raise InputError(
        f"mean: no residual slip can hold the mean loads: {_named(system, nodes)} beyond the "
        f"limit; {reason}"
    )


def _mean_state(system: ContactSystem, mean: Array) -> ContactState:
    """Return the state under the mean loads, applied to the contact at rest."""
    state, zero = np.where(system.g0 > 0.0, SEPARATION, STICK), np.zeros(2 * system.n)
    rest = ContactState(zero, zero, state.astype(np.int8))
    return EventPath(system).trace_leg(rest, (np.zeros_like(mean), mean), 0.0).end


def _named(system: ContactSystem, nodes: NDArray[np.integer]) -> str:
    """Return nodes with their positions and a verb, for messages."""
    names = [f"{i} (x = {system.x[i]:.4g})" for i in nodes[:6]]
    more = f" and {len(nodes) - 6} more" if len(nodes) > 6 else ""
    one = len(nodes) == 1
    return f"node{'' if one else 's'} {', '.join(names)}{more} {'is' if one else 'are'}"


def largest_margin(margins: Margins) -> Answer:
    """Return the residual slip whose smallest margin t <= 1 under the mean loads is the largest.

    The answer's value is 1 - t: at most 1 where a residual slip holds the mean loads.
    """
    shift = np.hstack([margins.G, np.ones((len(margins.c), 1))])
    cost = np.append(np.zeros(margins.G.shape[1]), 1.0)
    # t = 1 - z with z >= 0
    return minimise(cost, shift, margins.c - 1.0)


def margin_residual(
    system: ContactSystem, loads: LoadRange, v: Array, top: float, away: NDArray[np.bool_]
) -> float:
    """Return the largest violation of a margin at all vertices, over the largest nodal force.

    Displacements follow from v, closed gaps and forces that vanish, independently of the programs.
    """
    n, K = system.n, system.K
    held_t, held_n = system.held.reshape(2, n)
    pressed = ~away & ~held_n
    slips = system.friction.present & ~held_t & pressed
    known = np.concatenate([held_t | slips, ~away | held_n])
    u = np.concatenate([v, np.where(held_n, 0.0, -system.g0)])
    e = np.flatnonzero(~known)
    worst, force = 0.0, 0.0
    for vertex in loads.vertices:
        load = loads.mean + top * vertex
        u[e] = 0.0
        if len(e):
            u[e] = -np.linalg.solve(K[np.ix_(e, e)], reactions(system, load, u)[e])
        r = reactions(system, load, u)
        A, B = system.friction.margins(r[:n], r[n:])
        margins = np.concatenate([A[slips], B[slips], r[n:][pressed]])
        gaps = np.diagonal(K)[n:][away] * (u[n:] + system.g0)[away]
        worst = max(worst, -float(margins.min()), -float(gaps.min(initial=0.0)))
        worst = max(worst, float(np.abs(r[e]).max(initial=0.0)))
        force = max(force, float(np.abs(r).max()))
    return worst / force


# -- linear programs -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer:
    """Smallest value of a linear function over G z + c >= 0, with its proof."""

    z: Array  # where it is reached; polished on the rows that bind
    value: float  # the smallest value; inf when no z is feasible, -inf when there is none
    bound: float  # value that the multipliers prove to be a lower bound
    multipliers: Array  # (rows,) not negative (of any sign at rows that are equations)
    equations: tuple[int, ...] = ()  # rows that were made to vanish


def minimise(
    cost: Array, G: Array, c: Array, top: float = np.inf, equations: tuple[int, ...] = ()
) -> Answer:
    """Minimise cost z over G z + c >= 0 with 0 <= z[-1] <= top, the other z being free.

    For multipliers m >= 0 with m G = cost - rho the value is at least -m c + rho z; the polished
    multipliers leave rho only in the last unknown, whose bounds are known, and round-off elsewhere.
    The rows ``equations`` vanish. G is (rows, m + 1).
    """
    is_equation = np.isin(np.arange(len(c)), equations)
    reasons = []
    # the dual simplex method gives up at times for no reason of the program
    ways = (("highs-ds", 1e-9), ("highs-ds", 1e-7), ("highs-ipm", 1e-9), ("highs-ds", 1e-10))
    for method, tolerance in ways:
        found = scipy.optimize.linprog(
            cost,
            A_ub=-G[~is_equation],
            b_ub=c[~is_equation],
            A_eq=G[is_equation] if equations else None,
            b_eq=-c[is_equation] if equations else None,
            bounds=[(None, None)] * (len(cost) - 1) + [(0.0, None if np.isinf(top) else top)],
            method=method,
            options={
                "primal_feasibility_tolerance": tolerance,
                "dual_feasibility_tolerance": tolerance,
            },
        )
        if found.status in (2, 3):  # infeasible, unbounded
            value = np.inf if found.status == 2 else -np.inf
            return Answer(np.full(len(cost), np.nan), value, -np.inf, np.zeros(len(c)))
        if found.status == 0:
            multipliers = np.zeros(len(c))
            multipliers[~is_equation] = np.maximum(-found.ineqlin.marginals, 0.0)
            multipliers[is_equation] = found.eqlin.marginals
            z = _polished(found.x, G, c, is_equation, top)
            multipliers = _refined(multipliers, cost, G, is_equation, 0.0 < z[-1] < top)
            bound = dual_bound(multipliers, cost, G, c, top, z)
            answer = Answer(z, float(cost @ z), bound, multipliers, equations)
            violated, gap = -float((G @ z + c).min()), abs(answer.value - bound)
            if violated <= VANISHES and gap <= 1e-8 * (1.0 + abs(answer.value)):
                return answer
            found.message = f"margins violated by {violated:.1e}, dual bound off by {gap:.1e}"
        reasons.append(found.message)
    raise SolveError(
        f"a linear program of the shakedown limits has no answer that passes its checks: "
        f"{'; '.join(reasons)}"
    )


def dual_bound(multipliers: Array, cost: Array, G: Array, c: Array, top: float, z: Array) -> float:
    """Return the lower bound of cost z that (rows,) multipliers prove.

    The size of the point z tells what the residual rho of the unbounded unknowns may do.
    """
    rest = cost - multipliers @ G
    free = slice(0, -1) if np.isfinite(top) else slice(None)
    last = min(0.0, rest[-1]) * top if np.isfinite(top) else 0.0
    return float(-multipliers @ c) + last - float(np.abs(rest[free]) @ np.abs(z[free]))


def _polished(x: Array, G: Array, c: Array, is_equation: NDArray[np.bool_], top: float) -> Array:
    """Return the nearest point at which the rows that bind vanish to round-off."""
    margins = G @ x + c
    rows = np.flatnonzero(is_equation | (np.abs(margins) <= BINDS))
    z = x.copy()
    z[-1] = next((end for end in (0.0, top) if abs(x[-1] - end) <= VANISHES), x[-1])
    # the last unknown stays where it is at one of its bounds
    moving = slice(None) if 0.0 < z[-1] < top else slice(0, -1)
    z[moving] -= np.linalg.lstsq(G[rows][:, moving], G[rows] @ z + c[rows], rcond=None)[0]
    return z if -(G @ z + c).min() <= max(-margins.min(), VANISHES) else x


def _refined(
    multipliers: Array, cost: Array, G: Array, is_equation: NDArray[np.bool_], inside: bool
) -> Array:
    """Return multipliers that balance the cost of the unknowns away from bounds to round-off."""
    rows = np.flatnonzero(is_equation | (multipliers > 0.0))
    columns = slice(None) if inside else slice(0, -1)
    rest = (cost - multipliers @ G)[columns]
    refined = multipliers.copy()
    refined[rows] += np.linalg.lstsq(G[rows][:, columns].T, rest, rcond=None)[0]
    return np.where(is_equation, refined, np.maximum(refined, 0.0))
