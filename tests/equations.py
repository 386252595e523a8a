"""The contact law in given states as a linear system, in extended precision.

Eqs. (4) to (12) of Ahn & Barber (2008), written once more: nothing of the package is used. All rows
are forces, so that one tolerance serves; solutions are refined with residuals in extended
precision, so that they are right to double precision in near-singular systems too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray

STICK, OPEN, FORWARD, BACKWARD = 1, 2, 3, 4
EPS = float(np.finfo(float).eps)

ROUNDINGS = 512.0
"""Round-offs eps |K| |u| that are let pass beside a law's tolerance."""
SINGULAR = 1e-13
"""Singular value, over the largest stiffness, below which the states leave a motion free."""
REFINEMENTS = 6
"""Steps of iterative refinement."""


class Body:
    """A condensed contact in extended precision.

    Attributes:
        k: (2N,) diagonal of K; a displacement times k is compared with forces.
    """

    def __init__(self, system: Any) -> None:
        """Copy what the laws need; K, r*, f, g0, held."""
        self.n = n = len(system.f)
        self.K = np.array(system.K, dtype=np.longdouble)
        self.r_star = np.array(system.r_star, dtype=np.longdouble)
        self.f, self.g0 = np.array(system.f, float), np.array(system.g0, float)
        backward = getattr(system, "f_backward", None)
        self.f_backward = self.f if backward is None else np.array(backward, float)
        self.held = np.array(system.held, bool)
        k = np.diagonal(system.K).astype(float)
        largest = k.max(initial=0.0) or 1.0
        self.k = np.where(k > SINGULAR * largest, k, largest)
        self.carried = self.held[n:]
        """(N,) nodes whose normal displacement a support holds: no contact law."""
        given = getattr(system, "cohesion", None), getattr(system, "shear_limit", None)
        weight = np.array(system.weight, float)
        # forces c m and t m of the limits min(f P + c m, t m) of |Q|
        self.c = np.zeros(n) if given[0] is None else weight * given[0]
        self.t = np.full(n, np.inf) if given[1] is None else weight * given[1]
        self.branched = any(part is not None for part in given)
        self.capped = np.zeros(n, dtype=bool)
        """(N,) slipping nodes that are at t m, the others at f P + c m."""
        self.rubs = (self.f > 0.0) | (self.f_backward > 0.0) | (self.c > 0.0)
        self.rubs &= (self.t > 0.0) & ~self.held[:n] & ~self.carried
        self._inverses: dict[bytes, States] = {}

    def at_limit(self, slip: Array) -> Array:
        """Return c of Q = -c P - d in slip of the given signs: f forward, -f_backward backward."""
        slope = np.where(slip > 0.0, self.f, np.where(slip < 0.0, -self.f_backward, 0.0))
        return np.where(self.capped, 0.0, slope)

    def offset(self, slip: Array) -> Array:
        """Return d of Q = -c P - d in slip of the given signs."""
        return np.where(slip == 0.0, 0.0, slip * np.where(self.capped, self.t, self.c))

    def limits(self, P: Array) -> tuple[Array, Array]:
        """Return the sizes of both limits of Q, forward and backward."""
        rough = (slope * P + self.c for slope in (self.f, self.f_backward))
        forward, backward = (np.minimum(one, self.t) for one in rough)
        return forward, backward

    def off_limit(self, Q: Array, P: Array, slip: Array) -> Array:
        """Return by how much Q is off the limit of slip of the given signs."""
        forward, backward = self.limits(P)
        return np.abs(Q + np.where(slip > 0.0, forward, np.where(slip < 0.0, -backward, 0.0)))

    def beyond(self, Q: Array, P: Array) -> Array:
        """Return by how much Q is beyond the nearer limit, -f P or f_backward P."""
        forward, backward = self.limits(P)
        return np.maximum(Q - backward, -Q - forward)

    def above_kink(self, P: Array, slip: Array) -> Array:
        """Return (N,) P less the pressure at which both branches of slip are equal, in f P."""
        slope = np.where(slip > 0.0, self.f, np.where(slip < 0.0, self.f_backward, 0.0))
        return np.where(slip == 0.0, -np.inf, slope * P + self.c - self.t)

    def cone_error(self, error: Array) -> Array:
        """Return (N,) errors of Q +- f P from errors (2N,) of the reactions."""
        return error[: self.n] + np.maximum(self.f, self.f_backward) * error[self.n :]

    def reactions(self, load: Array, u: Array) -> Array:
        """Return r = sum lambda r* + K u (eq. 11)."""
        return load @ self.r_star + self.K @ u

    def round_off(self, load: Array, u: Array) -> Array:
        """Return (2N,) the largest eps (|lambda| |r*| + |K| |u|), the round-off of reactions.

        The entries of K and r* have round-off of the largest: rigid motions pass it from node to
        node.
        """
        size = np.abs(load) @ np.abs(self.r_star) + np.abs(self.K) @ np.abs(u)
        return np.full(len(size), float(ROUNDINGS * EPS * size.max()))

    def states(self, state: Array) -> States:
        """Return the equations of a set of states."""
        key = np.asarray(state, np.int8).tobytes() + self.capped.tobytes()
        if key not in self._inverses:
            self._inverses[key] = States(self, np.asarray(state))
        return self._inverses[key]


class States:
    """The linear equations M u = rhs of a set of states, every row a force."""

    def __init__(self, body: Body, state: Array) -> None:
        """Choose the rows of eqs. (4), (6), (8), (10)."""
        self.body, n = body, body.n
        touches = (state != OPEN) & ~body.carried
        slip = np.where(state == FORWARD, 1.0, 0.0) - np.where(state == BACKWARD, 1.0, 0.0)
        self.sign = np.where(body.rubs & touches, slip, 0.0)
        self.offset = np.concatenate([body.offset(self.sign), np.zeros(n)])
        self.touches = touches
        # displacements given: held, stuck; closed gaps
        stuck = body.rubs & (state == STICK)
        self.given = np.concatenate([body.held[:n] | stuck, body.carried | touches])
        self.stuck = stuck & ~body.held[:n]
        # reactions given: those of the others, Q + sign f P
        mix = np.eye(2 * n)
        mix[np.arange(n), n + np.arange(n)] = body.at_limit(self.sign)
        self.mix = np.where(self.given[:, None], 0.0, mix).astype(np.longdouble)
        self.M = self.mix @ body.K + np.diag(np.where(self.given, body.k, 0.0))
        left, size, right = np.linalg.svd(self.M.astype(float))
        kept = size > SINGULAR * body.k.max()
        self.inverse = (right[kept].T / size[kept]) @ left[:, kept].T
        self.free = right[~kept]
        """(m, 2N) motions that the states leave free."""
        loose = np.any(np.abs(self.free[:, :n]) > SINGULAR, axis=0)
        self.slides_freely = loose & (self.sign != 0.0)
        """(N,) slipping nodes that such motions move."""
        self.condition = float(size[0] / size[kept].min(initial=np.inf)) if kept.any() else 1.0

    def solve(self, load: Array, v_ref: Array, near: Array) -> Array:
        """Return u at the load, stuck nodes at v_ref; where motions are free, nearest to a u."""
        body, n = self.body, self.body.n
        place = np.concatenate(
            [np.where(self.stuck, v_ref, 0.0), np.where(self.touches, -body.g0, 0.0)]
        )
        force = self.mix @ (load @ body.r_star) + self.offset
        rhs = np.where(self.given, body.k * place, 0.0) - force
        return self._refine(rhs, near if len(self.free) else np.zeros(2 * n, np.longdouble))

    def rates(self, way: Array) -> Array:
        """Return the change of u when the loads change by ``way``."""
        rhs = -self.mix @ (way @ self.body.r_star)
        return self._refine(rhs, np.zeros(2 * self.body.n, np.longdouble))

    def _refine(self, rhs: Array, u: Array) -> Array:
        for _ in range(REFINEMENTS):
            u = u + self.inverse @ (rhs - self.M @ u).astype(float)
        return u

    def reach(self, force: Array) -> Array:
        """Return (2N,) largest displacement that errors of the equations' rows may cause."""
        return np.abs(self.inverse) @ force

    def reach_of_forces(self, force: Array) -> Array:
        """Return (2N,) largest change of the reactions that errors of the rows may cause."""
        return np.abs((self.body.K @ self.inverse).astype(float)) @ force

    def row_errors(self, error: Array) -> Array:
        """Return (2N,) errors of the rows that errors of the reactions are worth."""
        n = self.body.n
        both = np.abs(np.diagonal(self.mix[:n, n:])).astype(float) * error[n:]
        return error + np.concatenate([both, np.zeros(n)])
