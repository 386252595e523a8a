"""The condensed contact problem: its data, the four states, the law at the nodes, the residual.

Notation of Ahn & Barber (2008): ``v``, ``w`` are the tangential and normal displacements of a
contact node, ``Q``, ``P`` the tangential and normal reactions on the body (``P > 0`` is
compression), and

    r = sum_k lambda_k r*_k + K u,   r = [Q; P],   u = [v; w]        (eqs. 11 and 12).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError

Array = NDArray[np.float64]


class State(IntEnum):
    """The four states of a contact node, numbered as in section 2 of the paper."""

    STICK = 1
    SEPARATION = 2
    FORWARD_SLIP = 3
    BACKWARD_SLIP = 4


STATE_NAMES = {s: s.name.lower().replace("_", " ") for s in State}


@dataclass(frozen=True)
class ContactSystem:
    """An elastic body (or half of a mirror-symmetric one) condensed to its N contact nodes.

    Attributes:
        x: (N,) position along the node's contact edge, increasing on each edge.
        points: (N, 2) coordinates of the nodes.
        weight: (N,) integral of N_i over the modelled contact edge: tractions are Q/weight,
        P/weight.
        K: (2N, 2N) condensed stiffness, symmetric, order [v; w] (eq. 12). For ``kind = "normal"``
            (N, N), the tangential displacements having been eliminated at Q = 0.
        r_star: (n_loads, 2N) reactions to each unit load with all contact nodes held (eq. 11);
            (n_loads, N) for ``kind = "normal"``.
        load_names: n_loads names.
        f: (N,) coefficient of friction.
        g0: (N,) initial gap, >= 0.
        held: (2N,) contact degrees of freedom fixed by symmetry or support; f is 0 where the
            normal one is.
        rigid: (2N, n) rigid motions on the contact that supports and symmetry leave, each with
            largest entry 1; n may be 0.
        half: True when the nodes are the half x >= 0 of a contact symmetric about x = 0.
        kind: "frictional" or "normal".
        slip_map: for ``kind = "normal"`` (N, N + n_loads), with v = slip_map @ [w; lambda]; else
        None.
        load_compliance: (n_loads, n_loads) work-conjugate displacement of load k under unit load l,
            contact held.
        load_sign: (n_loads,) -1 for force-like loads, +1 for prescribed displacements:
            load_displacement = load_compliance @ lambda + load_sign * (r_star @ u).
        axisymmetric: x is the radius, and everything is per radian.
        edge: (N,) number of the node's contact edge, not decreasing; None stands for one edge.
        edge_names: names of the contact edges.
        scene_toml: text of the scene that the system was condensed from, "" when made by hand.
    """

    x: Array
    points: Array
    weight: Array
    K: Array
    r_star: Array
    load_names: tuple[str, ...]
    f: Array
    g0: Array
    held: NDArray[np.bool_]
    rigid: Array
    half: bool = False
    kind: str = "frictional"
    slip_map: Array | None = None
    load_compliance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    load_sign: Array = field(default_factory=lambda: np.zeros(0))
    edge: NDArray[np.int64] | None = None
    edge_names: tuple[str, ...] = ()
    axisymmetric: bool = False
    scene_toml: str = ""

    @property
    def n(self) -> int:
        """Number N of contact nodes in the model."""
        return len(self.x)

    @property
    def edges(self) -> NDArray[np.int64]:
        """(N,) number of the contact edge of each node."""
        return np.zeros(self.n, dtype=np.int64) if self.edge is None else self.edge


@dataclass
class ContactState:
    """Displacements, reactions and states of all contact nodes at one instant.

    Attributes:
        u: (2N,) displacements [v; w].
        r: (2N,) reactions [Q; P] on the body.
        state: (N,) values of :class:`State`.
    """

    u: Array
    r: Array
    state: NDArray[np.int8]

    @property
    def v(self) -> Array:
        """(N,) tangential displacement."""
        return self.u[: len(self.state)]

    @property
    def w(self) -> Array:
        """(N,) normal displacement, away from the plane."""
        return self.u[len(self.state) :]

    @property
    def Q(self) -> Array:
        """(N,) tangential reaction on the body."""
        return self.r[: len(self.state)]

    @property
    def P(self) -> Array:
        """(N,) normal reaction on the body, compression positive."""
        return self.r[len(self.state) :]

    def copy(self) -> ContactState:
        """Return an independent copy."""
        return ContactState(self.u.copy(), self.r.copy(), self.state.copy())


@dataclass
class Leg:
    """One straight piece of the load path, traced by any method.

    Attributes:
        end: state at its end.
        dissipation: (N,) frictional dissipation at each node.
        work: integral of sum_k lambda_k r*_k . du along the leg, for the energy identity.
        residual: largest residual of the contact law over ``force_scale``.
        force_scale: largest nodal force of the history so far.
        samples: (s, state) pairs, s increasing to 1.
        events: (s, node, old state, new state), s not decreasing.
        sweeps: Gauss-Seidel sweeps spent.
        jumps: (s, energy released) of every jump that was stepped over.
    """

    end: ContactState
    dissipation: Array
    work: float = 0.0
    residual: float = 0.0
    force_scale: float = 0.0
    samples: list[tuple[float, ContactState]] = field(default_factory=list)
    events: list[tuple[float, int, int, int]] = field(default_factory=list)
    sweeps: int = 0
    jumps: list[tuple[float, float]] = field(default_factory=list)


def reactions(system: ContactSystem, load: Array, u: Array) -> Array:
    """Return r = sum_k lambda_k r*_k + K u (eq. 11), evaluated afresh.

    Args:
        system: the condensed body.
        load: (n_loads,) load factors.
        u: displacements in the order of ``system.K``.

    Returns:
        Reactions in the same order.
    """
    return load @ system.r_star + system.K @ u


OPEN_SCALE = 1e-2
"""Part of the reactions with all nodes held that counts as force scale where nothing presses."""


def largest_force(system: ContactSystem, load: Array, r: Array, so_far: float) -> float:
    """Return the history's largest nodal force, the scale of every residual and force tolerance.

    An open contact has no force of its own: there the held reactions sum lambda r* set the scale.

    Args:
        system: the condensed body.
        load: (n_loads,) load factors.
        r: reactions at this instant.
        so_far: largest force before it.
    """
    held = float(np.abs(load @ system.r_star).max(initial=0.0))
    return max(so_far, float(np.abs(r).max(initial=0.0)), OPEN_SCALE * held)


def round_off(system: ContactSystem, u: Array, force_scale: float) -> float:
    """Return the relative residual that round-off of u alone leaves: eps max(|K| |u|) / scale."""
    if force_scale == 0.0:
        return 0.0
    return float(np.finfo(float).eps * (np.abs(system.K) @ np.abs(u)).max()) / force_scale


ROUND_OFFS = 32.0
"""Such round-offs that an accepted residual may consist of where nothing better can be had: nearly
incompressible bodies."""


REACHABLE_AT_MOST = 1e-9
"""Residual above which no round-off excuses it: that of a body which has moved far without limit,
tipping over, would let pass anything."""


def reachable(system: ContactSystem, u: Array, force_scale: float) -> float:
    """Return the relative residual that is accepted for round-off."""
    return min(ROUND_OFFS * round_off(system, u, force_scale), REACHABLE_AT_MOST)


def law_residual(
    system: ContactSystem, r: Array, u: Array, slip: Array, stiffness: tuple[Array, Array]
) -> Array:
    """Return the natural-map residual of the contact law, node by node, as a force.

    Normal: P - max(0, P - k_n g). Tangential: Q - clip(Q - k_t dv, -f P+, f P+), P+ = max(P, 0).
    Both vanish exactly when Signorini's and Coulomb's conditions hold (eqs. 4 to 10).

    Args:
        system: the condensed body, ``kind = "frictional"``.
        r: (2N,) reactions, or (k, 2N) of k instants.
        u: (2N,) or (k, 2N) displacements.
        slip: (N,) or (k, N) tangential displacement of the step or segment, from the point of
            first contact for a node that was open at its start.
        stiffness: (N,) tangential and normal stiffness that weigh a displacement against a force.

    Returns:
        (2N,) or (k, 2N) absolute residual, tangential part first; zero at held degrees of freedom.
    """
    n = system.n
    k_t, k_n = stiffness
    Q, P, gap = r[..., :n], r[..., n:], system.g0 + u[..., n:]
    limit = system.f * np.maximum(P, 0.0)
    tangential = np.abs(Q - np.clip(Q - k_t * slip, -limit, limit))
    normal = np.abs(P - np.maximum(0.0, P - k_n * gap))
    both = np.concatenate([tangential, normal], axis=-1)
    both[..., system.held] = 0.0
    return both


def friction_margin(system: ContactSystem) -> float:
    """Return the largest f |(K_tn)_ii| / (K_tt)_ii over the nodes, a diagnostic of single nodes."""
    if system.kind == "normal":
        return 0.0
    n, nodes = system.n, np.flatnonzero(~system.held[: system.n])
    coupling = np.abs(system.K[nodes, n + nodes])
    return float((system.f[nodes] * coupling / system.K[nodes, nodes]).max(initial=0.0))


def relative_residual(
    system: ContactSystem,
    state: ContactState,
    slip: Array,
    stiffness: tuple[Array, Array],
    force_scale: float,
) -> float:
    """Return the largest entry of :func:`law_residual` over the force scale."""
    if force_scale == 0.0:
        return 0.0
    return float(law_residual(system, state.r, state.u, slip, stiffness).max()) / force_scale


def typical_stiffness(system: ContactSystem) -> float:
    """Return the median of the diagonal of K."""
    return float(np.median(np.diagonal(system.K)))


def residual_at_rest(system: ContactSystem, end: ContactState, force_scale: float) -> float:
    """Return the relative residual at one instant; a slipping node must be at its limit.

    Args:
        system: the condensed body in 2N form.
        end: the state, reactions evaluated afresh.
        force_scale: largest nodal force of the history so far.
    """
    sign = (end.state == State.FORWARD_SLIP).astype(float) - (end.state == State.BACKWARD_SLIP)
    worst = relative_residual(system, end, np.zeros(system.n), local_stiffness(system), force_scale)
    on_limit = np.abs(end.Q + sign * system.f * end.P)[sign != 0.0]
    return max(worst, float(on_limit.max(initial=0.0)) / force_scale)


def local_stiffness(system: ContactSystem) -> tuple[Array, Array]:
    """Return the diagonals (K_tt)_ii and (K_nn)_ii, the local stiffnesses k_i of the residual."""
    diagonal = np.diagonal(system.K)
    return diagonal[: system.n].copy(), diagonal[system.n :].copy()


def eliminate_tangential(system: ContactSystem) -> ContactSystem:
    """Condense a frictionless contact (f = 0 at every node) to its normal displacements.

    With Q = 0 eq. (11) gives v = -K_tt^+ (K_tn w + sum lambda Q*), hence
    K = K_nn - K_nt K_tt^+ K_tn and r* = P* - K_nt K_tt^+ Q*. A body that is free to slide has a
    rigid motion in K_tt; it is pinned at v = 0 on average, which is allowed only when no load has
    a resultant along it.

    Args:
        system: ``kind = "frictional"``, f = 0 everywhere.

    Returns:
        The system of ``kind = "normal"`` with its ``slip_map``.

    Raises:
        InputError: if a load pushes the body along a rigid motion that nothing resists.
    """
    n = system.n
    free = np.flatnonzero(~system.held[:n])
    K_tt = system.K[np.ix_(free, free)]
    K_tn = system.K[free, n:]
    Q_star = system.r_star[:, free].T
    slides = _tangential_rigid(system, free)
    if slides is not None:
        resultant = np.abs(slides @ Q_star)
        # two mirrored bodies have normal reactions only
        if np.any(resultant > SLIDE_TOLERANCE * np.abs(system.r_star).sum(axis=1)):
            name = system.load_names[int(np.argmax(resultant))]
            raise InputError(
                f"load '{name}' pushes the frictionless body along, and nothing resists it: "
                "add a [[support]] or friction"
            )
        K_tt = K_tt + np.outer(slides, slides) * (np.trace(K_tt) / len(free))
    mapped = -np.linalg.solve(K_tt, np.hstack([K_tn, Q_star]))
    slip_map = np.zeros((n, n + len(system.load_names)))
    slip_map[free] = mapped
    K = system.K[n:, n:] + K_tn.T @ mapped[:, :n]
    compliance = system.load_compliance
    if compliance.size:
        # the loads also move through the slip that they cause by themselves
        compliance = compliance + system.load_sign[:, None] * (Q_star.T @ mapped[:, n:])
    return replace(
        system,
        K=0.5 * (K + K.T),
        r_star=system.r_star[:, n:] + (K_tn.T @ mapped[:, n:]).T,
        kind="normal",
        slip_map=slip_map,
        load_compliance=compliance,
    )


SLIDE_TOLERANCE = 1e-10
"""Load resultant along a free rigid sliding, over the sum of its reactions, that counts as zero."""


def _tangential_rigid(system: ContactSystem, free: NDArray[np.intp]) -> Array | None:
    """Return the unit vector of a rigid motion with w = 0 on the free tangential nodes, or None."""
    n = system.n
    if system.rigid.shape[1] == 0:
        return None
    # combinations of the rigid modes whose normal part vanishes
    _, values, right = np.linalg.svd(system.rigid[n:])
    rank = int(np.sum(values > SLIDE_TOLERANCE * max(1.0, values.max(initial=0.0))))
    null = right[rank:]
    if len(null) == 0:
        return None
    mode = (system.rigid[:n] @ null.T)[free, 0]
    return mode / np.linalg.norm(mode)


def frictional_form(system: ContactSystem) -> ContactSystem:
    """Return a system of ``kind = "normal"`` in the 2N layout that the solvers share.

    The eliminated tangential degrees of freedom become held ones without stiffness or coupling.
    """
    if system.kind == "frictional":
        return system
    n, n_loads = system.n, len(system.load_names)
    K = np.zeros((2 * n, 2 * n))
    K[n:, n:] = system.K
    held = system.held.copy()
    held[:n] = True
    r_star = np.hstack([np.zeros((n_loads, n)), system.r_star])
    return replace(system, K=K, r_star=r_star, held=held, kind="frictional")
