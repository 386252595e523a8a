"""Certificate of one set of states: definiteness of the matrix of the rate problem, and its margin.

In a set of states the separated nodes, and the tangential freedoms without friction, move at zero
reaction; condensed of these the stiffness is K'. With C = diag(c), Q = -c P at the slipping nodes,
the rates are unique if

    sym(K'_tt + C K'_nt)

on the slipping nodes is positive definite. All friction may grow up to the factor

    phi = 1 / lambda_max(-sym(C K'_nt), K'_tt).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION
from receding_fenicsx.interface.rigid_motions import neutral_motions
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SAME_MARGIN
from receding_fenicsx.interface.uniqueness.sides import States, bits_of, mask_of

SINGULAR = 1e-11
"""Pivot of a Cholesky factorisation over the diagonal entry, or coupling over the stiffness, below
which it counts as zero."""

LEADING = 0.5
"""Entry of the critical slip mode, over its largest, from which on a node is named."""

MOST_MINORS = 12
"""Slipping nodes up to which all principal minors are computed."""


class Certificate:
    """Judges sets of states of one contact; an answer depends on the set alone.

    Attributes:
        system: the condensed body in 2N form.
        frictional: (N,) nodes with the full contact law.
        smooth: (N,) nodes without friction, or held tangentially.
        rubbing: the frictional nodes, as an integer.
        loose: freedoms that move at zero reaction in every set of states.
        coupling: size of K_tn over that of K_nn.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Prepare for a system of ``kind = "frictional"``."""
        n = system.n
        self.system = system
        normal = ~system.held[n:]
        self.frictional = ~system.held[:n] & normal & system.friction.present
        self.smooth = normal & ~self.frictional
        self.loose = np.flatnonzero(~system.held[:n] & ~self.frictional)
        self.rubbing = bits_of(self.frictional)
        K_tn, K_nn = (float(np.linalg.norm(K)) for K in (system.K[:n, n:], system.K[n:, n:]))
        self.coupling = max(K_tn / K_nn, SINGULAR) if K_nn else SINGULAR
        self._factor: tuple[int, tuple[NDArray[np.intp], Array]] | None = None

    def slips(self, state: States) -> NDArray[np.bool_]:
        """Return whether each node slips against friction."""
        return self.frictional & ((state == FORWARD) | (state == BACKWARD))

    def slipping(self, state: States) -> NDArray[np.intp]:
        """Return the nodes that slip against friction."""
        return np.flatnonzero(self.slips(state))

    def free(self, open_: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the freedoms that move at zero reaction where some nodes are open."""
        n = self.system.n
        return np.concatenate(
            [
                np.flatnonzero(open_ & self.frictional),
                self.loose,
                n + np.flatnonzero(open_ & ~self.system.held[n:]),
            ]
        )

    def matrices(self, state: States) -> tuple[Array, Array]:
        """Return K'_tt and C K'_nt of the slipping nodes.

        Raises:
            np.linalg.LinAlgError: what moves freely, or together with a slipping node, has a motion
                without stiffness.
        """
        system, slips = self.system, self.slipping(state)
        m = len(slips)
        rows = np.concatenate([slips, system.n + slips])
        K = self.condensed(rows, m, bits_of(state == SEPARATION))
        # what remains of a motion without stiffness is round-off
        if np.any(np.diagonal(K) <= SINGULAR * np.diagonal(system.K)[slips]):
            raise np.linalg.LinAlgError
        return K[:m], system.friction[slips].at_slip(state[slips])[:, None] * K[m:]

    def condensed(self, rows: NDArray[np.intp], columns: int, open_: int) -> Array:
        """Return rows of K', of some open nodes, on the first of these freedoms as columns.

        Raises:
            np.linalg.LinAlgError: what moves freely has a motion without stiffness.
        """
        free, factor = self._free_stiffness(open_)
        K = self.system.K[rows][:, rows[:columns]]
        if len(free) and len(rows):
            coupled = self.system.K[free][:, rows]
            half = sla.solve_triangular(factor, coupled, lower=True, check_finite=False)
            K -= half.T @ half[:, :columns]
        return K

    def _free_stiffness(self, open_: int) -> tuple[NDArray[np.intp], Array]:
        """Return the freedoms free where nodes are open, and the factor of their stiffness.

        Rigid motions that move nothing but these are kept from moving.
        """
        if self._factor is None or self._factor[0] != open_:
            K, free = self.system.K, self.free(mask_of(open_, self.system.n))
            kept = np.ones(len(K), dtype=bool)
            kept[free] = False
            stiffness = K[np.ix_(free, free)]
            motions = neutral_motions(self.system.rigid, kept)[free]
            if motions.shape[1]:
                stiffness = stiffness + float(np.diagonal(K).max()) * motions @ motions.T
            self._factor = open_, (free, cholesky(stiffness))
        return self._factor[1]

    def margin(self, state: States) -> tuple[float, tuple[int, ...]]:
        """Return phi of a set of states, and the leading nodes of the critical slip mode.

        It is 0 where something moves without stiffness, infinite where nothing slips or friction
        only stiffens.
        """
        slips = self.slipping(state)
        try:
            K_tt, X = self.matrices(state)
            if not len(slips):
                return np.inf, ()
            cholesky(K_tt)
        except np.linalg.LinAlgError:
            return 0.0, tuple(slips.tolist())
        last = len(slips) - 1
        size, mode = sla.eigh(-0.5 * (X + X.T), K_tt, subset_by_index=[last, last])
        # below this the eigenvalue is round-off
        if size[0] <= SINGULAR:
            return np.inf, ()
        large = np.abs(mode[:, 0])
        leading = slips[large >= LEADING * large.max()]
        return float(1.0 / size[0]), tuple(leading.tolist())

    def is_p_matrix(self, state: States) -> bool:
        """Return whether all principal minors of the rate problem are positive, for few nodes."""
        m = len(self.slipping(state))
        if m > MOST_MINORS:
            return False
        try:
            K_tt, X = self.matrices(state)
        except np.linalg.LinAlgError:
            return False
        scale = 1.0 / np.sqrt(np.diagonal(K_tt))
        M = scale[:, None] * (K_tt + X) * scale
        for size in range(1, m + 1):
            chosen = np.array(list(combinations(range(m), size)))
            if np.linalg.det(M[chosen[:, :, None], chosen[:, None, :]]).min() <= SAME_MARGIN:
                return False
        return True


def cholesky(matrix: Array) -> Array:
    """Return the lower Cholesky factor.

    Raises:
        np.linalg.LinAlgError: the matrix is not positive definite, or only by round-off.
    """
    factor = np.linalg.cholesky(matrix)
    if np.any(np.diagonal(factor) ** 2 <= SINGULAR * np.diagonal(matrix)):
        raise np.linalg.LinAlgError
    return factor
