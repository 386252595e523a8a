"""Margins of a safe slip, evaluated from K independently of the programs that found it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.shakedown.margins import LoadRange
from receding_fenicsx.interface.system import ContactSystem, reactions


def margin_residual(
    system: ContactSystem, loads: LoadRange, v: Array, top: float, away: NDArray[np.bool_]
) -> float:
    """Return the largest violation of a margin at all vertices, over the largest nodal force.

    Displacements follow from v, closed gaps and forces that vanish, independently of the programs.
    """
    n, K = system.n, system.K
    loose = ~system.held[:n]
    known = np.concatenate([~loose | (system.friction.present & ~away), ~away | system.held[n:]])
    u = np.concatenate([v, np.where(system.held[n:], 0.0, -system.g0)])
    e = np.flatnonzero(~known)
    worst, force = 0.0, 0.0
    for vertex in loads.vertices:
        load = loads.mean + top * vertex
        u[e] = 0.0
        if len(e):
            u[e] = -np.linalg.solve(K[np.ix_(e, e)], reactions(system, load, u)[e])
        r = reactions(system, load, u)
        A, B = system.friction.margins(r[:n], r[n:])
        slips = known[:n] & loose & ~system.held[n:] & system.friction.present
        pressed = ~away & ~system.held[n:]
        margins = np.concatenate([A[slips], B[slips], r[n:][pressed]])
        gaps = np.diagonal(K)[n:][away] * (u[n:] + system.g0)[away]
        worst = max(worst, -float(margins.min()), -float(gaps.min(initial=0.0)))
        worst = max(worst, float(np.abs(r[e]).max(initial=0.0)))
        force = max(force, float(np.abs(r).max()))
    return worst / force
