"""Check that forces and displacements belong together, at a cost that does not grow with N^2."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.system import ContactSystem


def summed(n: int, error: float) -> float:
    """Return the imbalance of n nodes, 50 at least, whose forces have an error of random sign."""
    return error * sqrt(max(2 * n, 100))


class BalanceCheck:
    """Random sums over the nodes of the errors of Q and P.

    With random signs s_i and t_i at the nodes, a sum of the errors of eq. (11) is

        sum_i s_i (Q_i(u, lambda) - Q_i) + t_i (P_i(u, lambda) - P_i),

    linear in u, lambda, A and B with weights that are made once. With independent errors it is some
    sqrt(N) times theirs, and never much below the largest. Q and P enter, not the margins A and B:
    where friction is low these hide an error of P. Without friction Q_i = 0.
    """

    def __init__(
        self, system: ContactSystem, frictional: NDArray[np.bool_], smooth: NDArray[np.bool_]
    ) -> None:
        """Make the weights.

        Args:
            system: the condensed body in 2N form.
            frictional: (N,) nodes with the full contact law.
            smooth: (N,) nodes without friction, or held tangentially, at which A stands for P.
        """
        n = system.n
        on_Q, on_P = np.random.default_rng(0).choice([-1.0, 1.0], (2, n, 4))
        on_Q *= ~system.held[:n, None]
        on_P *= (frictional | smooth)[:, None]
        opening = np.where(frictional, system.friction.opening(np.ones(n)), 1.0)[:, None]
        a, b = system.friction[:, None].shares
        on_margins = np.where(frictional[:, None], on_Q, 0.0)
        on_A, on_B = a * on_margins + on_P / opening, on_P / opening - b * on_margins
        on_B[~frictional] = 0.0
        on_r = np.vstack([on_Q, on_P])
        on_u = system.K @ on_r
        self.on_y = np.asfortranarray(np.vstack([on_u, -on_A, -on_B]))
        self.on_load = system.r_star @ on_r
        self._of_gaps = system.g0 @ on_u[n:]

    def error(self, q: Array, direction: Array) -> float:
        """Return the largest of the sums of rates q (4N,), the loads changing by ``direction``."""
        return float(np.abs(q @ self.on_y + direction @ self.on_load).max())

    def errors(self, y: Array, load: Array) -> Array:
        """Return the sums of quantities y (4N,) under a load (n_loads,)."""
        errors: Array = y @ self.on_y + load @ self.on_load - self._of_gaps
        return errors
