"""Data of the condensed contact problem: contact system, states, legs, rigid motions.

Notation of Ahn & Barber (2008): ``v``, ``w`` are the tangential and normal displacements of a
contact node, ``Q``, ``P`` the tangential and normal reactions on the body (``P > 0`` is
compression), and

    r = sum_k lambda_k r*_k + K u,   r = [Q; P],   u = [v; w]        (eqs. 11 and 12).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, brief, described
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.law import Friction, friction_of
from receding_fenicsx.interface.tolerances import NO_STIFFNESS, RESULTANT, RIGID_TOLERANCE


@dataclass(frozen=True)
class ProbeMatrix:
    """Displacements and stresses at m points of the bodies, linear in [v; w; lambda]."""

    names: tuple[str, ...]  # name of the probe of each point
    points: Array  # (m, 2) coordinates
    # (m, 6, 2N + n_loads), with [u_x, u_y, s_xx, s_yy, s_zz, s_xy] = rows @ [v; w; lambda] at each
    # point; N are the modelled nodes, the points those of the whole body
    rows: Array


@dataclass(frozen=True, repr=False)
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
        f: (N,) coefficient of friction; for forward slip only where ``f_backward`` is given.
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
        axisymmetric: points are (r, z), and everything is per radian.
        edge: (N,) number of the node's contact edge, not decreasing; None stands for one edge.
        edge_names: names of the contact edges.
        scene_toml: text of the scene that the system was condensed from, "" when made by hand.
        f_backward: (N,) coefficient of friction for backward slip; None stands for ``f``.
        cohesion, shear_limit: (N,) tractions c and t of the limits min(f P + c m, t m) of Q, m the
            weight; None for none.
        probes: displacements and stresses at the points of the scene's probes; None without.
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
    f_backward: Array | None = None
    probes: ProbeMatrix | None = None
    cohesion: Array | None = None
    shear_limit: Array | None = None

    @property
    def friction(self) -> Friction:
        """Coefficients of friction for both directions of slip.

        Raises:
            InputError: the law is more than a cone; whoever serves such laws takes :attr:`law`.
        """
        if self.has_branches:
            raise InputError(
                "[contact] shear_limit, cohesion: not served here, only by run, sweep, joint and "
                "wear; leave them out"
            )
        return friction_of(self.f, self.f_backward)

    @property
    def has_branches(self) -> bool:
        """Whether there is a cohesion or a shear limit."""
        return self.cohesion is not None or self.shear_limit is not None

    @cached_property
    def law(self) -> Friction:
        """Law of friction with its cohesion and its shear limit."""
        branches = self.cohesion, self.shear_limit
        return friction_of(self.f, self.f_backward, self.weight, branches)

    def __repr__(self) -> str:
        """Return what the system is of, and its arrays by shape and range."""
        half = "half of a mirror-symmetric contact" if self.half else "the whole contact"
        law = ("f", "f_backward", "cohesion", "shear_limit")
        arrays = ("x", "weight", "K", "r_star", *law, "g0", "held")
        found = [(name, getattr(self, name)) for name in arrays]
        return described(
            f"ContactSystem: {self.n} contact nodes of {half}, {self.kind}",
            [
                *((name, brief(value)) for name, value in found if value is not None),
                ("rigid", f"{self.rigid.shape[1]} motions"),
                ("loads", ", ".join(self.load_names)),
                ("edges", ", ".join(self.edge_names) or "-"),
                ("axisymmetric", str(self.axisymmetric)),
                ("scene", self.scene_toml.partition("\n")[0] or "made by hand"),
            ],
        )

    def load_text(self, load: Array) -> str:
        """Return load factors by name, for messages."""
        values = zip(self.load_names, load, strict=True)
        # a load of the law itself has no name
        return ", ".join(f"{name} = {value + 0.0:.9g}" for name, value in values if name)

    @property
    def n(self) -> int:
        """Number N of contact nodes in the model."""
        return len(self.x)

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of K, stored in one piece."""
        return np.diagonal(self.K).copy()

    @cached_property
    def largest_stiffness(self) -> float:
        """Largest entry of K, which is on its diagonal."""
        return float(self.diagonal.max(initial=0.0))

    @cached_property
    def load_forces(self) -> Array:
        """(n_loads,) largest held reaction to each unit load."""
        return np.abs(self.r_star).max(axis=1)

    @cached_property
    def local_stiffness(self) -> tuple[Array, Array]:
        """Local stiffnesses k_i of the residual, (K_tt)_ii and (K_nn)_ii.

        A freedom without stiffness of its own, which would hide its displacements, has the largest.
        """
        largest = self.largest_stiffness or 1.0
        stiffness = np.where(self.diagonal > NO_STIFFNESS * largest, self.diagonal, largest)
        return stiffness[: self.n], stiffness[self.n :]

    @cached_property
    def typical_stiffness(self) -> float:
        """Median of the diagonal of K."""
        return float(np.median(self.diagonal))

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


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """Changes of state of single nodes, one a row, in order of place."""

    s: Array  # (k,) places on the leg
    node: NDArray[np.intp]  # (k,) nodes
    # old, new: (k,) their states before and after
    old: NDArray[np.int8]
    new: NDArray[np.int8]

    @classmethod
    def none(cls) -> Changes:
        """Return no changes."""
        return _NO_CHANGES

    @classmethod
    def of(cls, rows: Iterable[tuple[float, int, int, int]]) -> Changes:
        """Return changes that were noted one by one: place, node, old state, new state."""
        s, node, old, new = list(zip(*rows, strict=True)) or [()] * 4
        states = (np.array(column, dtype=np.int8) for column in (old, new))
        return cls(np.array(s, dtype=float), np.array(node, dtype=np.intp), *states)

    @classmethod
    def between(cls, s: float, old: NDArray[np.int8], new: NDArray[np.int8]) -> Changes:
        """Return the changes between the states (N,) of all nodes before and after s."""
        node = (old != new).nonzero()[0]
        return cls(np.full(len(node), s), node, old[node], new[node])

    @classmethod
    def joined(cls, *parts: Changes) -> Changes:
        """Return the changes of several parts, one after the other."""
        some = [part for part in parts if len(part)]
        if len(some) < 2:
            return some[0] if some else cls.none()
        columns = zip(*((part.s, part.node, part.old, part.new) for part in some), strict=True)
        return cls(*map(np.concatenate, columns))

    def __len__(self) -> int:
        """Return the number k of changes."""
        return len(self.s)

    def __iter__(self) -> Iterator[tuple[float, int, int, int]]:
        """Yield place, node, old state and new state of one change after the other."""
        columns = self.s, self.node, self.old, self.new
        return zip(*(column.tolist() for column in columns), strict=True)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Changes:
        """Return some of the changes: a mask, numbers of rows in the order wanted, or a slice."""
        return Changes(self.s[rows], self.node[rows], self.old[rows], self.new[rows])

    def placed(self, scale: float, offset: float = 0.0) -> Changes:
        """Return the same changes at the places ``offset + scale * s``."""
        return Changes(offset + scale * self.s, self.node, self.old, self.new)


_NO_CHANGES = Changes.of(())


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
        events: changes of state.
        sweeps: Gauss-Seidel sweeps spent.
        jumps: (s, energy released) of every jump that was stepped over.
        stops: (s, u) at the events, for probes; between these and the samples u is taken as linear.
        ties: nodes that sit on a limit at an instant, with their state and another that they might
            take there: a direction of slip, or any (separation) where there is neither gap nor
            pressure; of the exact path those at its start too. Nodes that change their state there
            may be among them.
    """

    end: ContactState
    dissipation: Array
    work: float = 0.0
    residual: float = 0.0
    force_scale: float = 0.0
    samples: list[tuple[float, ContactState]] = field(default_factory=list)
    events: Changes = field(default_factory=Changes.none)
    sweeps: int = 0
    jumps: list[tuple[float, float]] = field(default_factory=list)
    stops: list[tuple[float, Array]] = field(default_factory=list)
    ties: Changes = field(default_factory=Changes.none)

    def placed(self, scale: float, offset: float = 0.0) -> Leg:
        """Return the same leg with its places s at ``offset + scale * s``."""
        return replace(
            self,
            samples=[(offset + scale * s, state) for s, state in self.samples],
            events=self.events.placed(scale, offset),
            jumps=[(offset + scale * s, energy) for s, energy in self.jumps],
            stops=[(offset + scale * s, u) for s, u in self.stops],
            ties=self.ties.placed(scale, offset),
        )

    def add(self, found: Leg) -> None:
        """Add a piece that begins where this one ends, its places on the same leg."""
        self.end = found.end
        self.dissipation = self.dissipation + found.dissipation
        self.work += found.work
        self.residual = max(self.residual, found.residual)
        self.force_scale = max(self.force_scale, found.force_scale)
        self.sweeps += found.sweeps
        self.samples += found.samples
        self.events = Changes.joined(self.events, found.events)
        self.jumps += found.jumps
        self.stops += found.stops
        self.ties = Changes.joined(self.ties, found.ties)


def reactions(system: ContactSystem, load: Array, u: Array) -> Array:
    """Return r = sum_k lambda_k r*_k + K u (eq. 11), evaluated afresh, in the order of K.

    One node of stiffness K_tt = 2, K_nn = 4 that a load pushes down by 3; moved by v = 1/2 its
    reactions are Q = 2 / 2 and P = 3:

        >>> system = ContactSystem(
        ...     x=np.zeros(1), points=np.zeros((1, 2)), weight=np.ones(1), K=np.diag([2.0, 4.0]),
        ...     r_star=np.array([[0.0, 3.0]]), load_names=("press",), f=np.array([0.3]),
        ...     g0=np.zeros(1), held=np.zeros(2, dtype=bool), rigid=np.zeros((2, 0)),
        ... )
        >>> reactions(system, np.array([1.0]), np.array([0.5, 0.0])).tolist()
        [1.0, 3.0]
    """
    return load @ system.r_star + system.K @ u


def neutral_motions(rigid: Array, kept: NDArray[np.bool_]) -> Array:
    """Return (2N, k) orthonormal ones of rigid motions (2N, n) that leave kept freedoms (2N,)."""
    if rigid.shape[1] == 0:
        return rigid
    given = rigid[kept]
    _, size, right = np.linalg.svd(given, full_matrices=len(given) < rigid.shape[1])
    motions = rigid @ right[int(np.count_nonzero(size > RIGID_TOLERANCE)) :].T
    return np.linalg.qr(motions)[0] if motions.size else motions


def pinned_stiffness(system: ContactSystem, free: NDArray[np.intp]) -> Array:
    """Return K of freedoms that move freely; rigid motions of these alone are made stiff."""
    kept = np.ones(len(system.K), dtype=bool)
    kept[free] = False
    motions = neutral_motions(system.rigid, kept)[free]
    pinned = float(system.diagonal.max(initial=0.0)) * motions @ motions.T
    return np.asarray(system.K[np.ix_(free, free)] + pinned)


def has_rigid(rigid: Array, motion: Array) -> bool:
    """Return whether a motion (2N,) of the contact nodes is among the rigid ones left free."""
    if rigid.shape[1] == 0:
        return False
    weights = np.linalg.lstsq(rigid, motion, rcond=None)[0]
    return bool(np.abs(rigid @ weights - motion).max() <= RIGID_TOLERANCE)


def softest_motion(K: Array, held: NDArray[np.bool_], rigid: Array) -> float:
    """Return the stiffness of the softest motion that is not free, over that of the stiffest.

    K is (2N, 2N), or (N, N) without tangential freedoms; ``held`` and ``rigid`` are of all 2N.
    """
    held, rigid = held[-len(K) :], rigid[-len(K) :]
    free = np.linalg.matrix_rank(rigid) if rigid.size else 0
    stiffness = np.linalg.eigvalsh(K[np.ix_(~held, ~held)])[free:]
    largest = float(stiffness.max(initial=0.0))
    return float(stiffness[0]) / largest if largest > 0.0 else 1.0


# -- forms with and without tangential displacements -----------------------------------------------


def eliminate_tangential(system: ContactSystem) -> ContactSystem:
    """Condense a frictionless contact (f = 0 at every node) to its normal displacements.

    With Q = 0 eq. (11) gives v = -K_tt^+ (K_tn w + sum lambda Q*), hence
    K = K_nn - K_nt K_tt^+ K_tn and r* = P* - K_nt K_tt^+ Q*. Bodies that are free to slide have
    rigid motions in K_tt; they are pinned at v = 0 on average, which is allowed only when no load
    has a resultant along them. The system returned is of ``kind = "normal"``, with its
    ``slip_map``.

    Raises:
        InputError: if a load pushes a body along a rigid motion that nothing resists.

    One node with K_tt = 2, K_tn = 1, K_nn = 4 under Q* = 1, P* = 3: v = -(w + lambda) / 2,
    K = 4 - 1/2 and r* = 3 - 1/2:

        >>> system = ContactSystem(
        ...     x=np.zeros(1), points=np.zeros((1, 2)), weight=np.ones(1),
        ...     K=np.array([[2.0, 1.0], [1.0, 4.0]]), r_star=np.array([[1.0, 3.0]]),
        ...     load_names=("press",), f=np.zeros(1), g0=np.zeros(1),
        ...     held=np.zeros(2, dtype=bool), rigid=np.zeros((2, 0)),
        ... )
        >>> normal = eliminate_tangential(system)
        >>> normal.K.tolist(), normal.r_star.tolist(), normal.slip_map.tolist()
        ([[3.5]], [[2.5]], [[-0.5, -0.5]])
    """
    n = system.n
    free = np.flatnonzero(~system.held[:n])
    K_tt = system.K[np.ix_(free, free)]
    K_tn = system.K[free, n:]
    Q_star = system.r_star[:, free].T
    # rigid motions along the plane, which nothing resists
    motions = neutral_motions(system.rigid, np.arange(2 * n) >= n)
    if motions.shape[1]:
        slides = np.linalg.qr(motions[free])[0]
        resultant = np.abs(slides.T @ Q_star).max(axis=0)
        # relative to all reactions: two mirrored bodies have normal ones only
        pushing = resultant > 1e-10 * np.abs(system.r_star).sum(axis=1)
        if pushing.any():
            name = system.load_names[int(np.argmax(pushing))]
            raise InputError(
                f"load '{name}' pushes the frictionless body along, and nothing resists it: "
                "add a [[support]] or friction"
            )
        K_tt = K_tt + slides @ slides.T * (np.trace(K_tt) / len(free))
    mapped = -np.linalg.solve(K_tt, np.hstack([K_tn, Q_star]))
    slip_map = np.zeros((n, n + len(system.load_names)))
    slip_map[free] = mapped
    K = system.K[n:, n:] + K_tn.T @ mapped[:, :n]
    by_slip = (K_tn.T @ mapped[:, n:]).T
    r_star = system.r_star[:, n:] + by_slip
    # free expansion is not felt but for its round-off
    r_star[np.abs(r_star) <= 1e-12 * np.abs(by_slip).max(axis=1, keepdims=True)] = 0.0
    # the resultants stay, those of round-off vanish
    resultant = system.r_star @ system.rigid
    held = np.abs(system.r_star).sum(axis=1, keepdims=True)
    resultant[np.abs(resultant) <= RESULTANT * held] = 0.0
    lift, size, turn = np.linalg.svd(system.rigid[n:], full_matrices=False)
    felt = size > RIGID_TOLERANCE  # motions along the contact have normal parts of round-off
    missing = (resultant - r_star @ system.rigid[n:]) @ turn[felt].T / size[felt]
    r_star += missing @ lift[:, felt].T
    compliance = system.load_compliance
    if compliance.size:
        # the loads also move through the slip that they cause by themselves
        compliance = compliance + system.load_sign[:, None] * (Q_star.T @ mapped[:, n:])
    return replace(
        system,
        K=0.5 * (K + K.T),
        r_star=r_star,
        kind="normal",
        slip_map=slip_map,
        load_compliance=compliance,
    )


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
