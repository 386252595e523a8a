"""Random contacts with several continuations, and all their branches by trying all states."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from small import small_system, table
from ways import follow

from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History

APART = 1e-6
"""Distance of ends, over the largest displacement, above which they are different."""

Ends = list[tuple[int, float, np.ndarray]]
"""Leg on which a branch ends, place on it, displacements there."""


def random_problem(seed: int) -> tuple[ContactSystem, History]:
    """Return 1 to 4 nodes of strong coupling, and a path of 2 to 4 legs; gaps in every third."""
    rng = np.random.default_rng([seed, 17])
    n = 1 + seed % 4
    G = rng.standard_normal((2 * n, 3 * n + 1))
    couple = rng.uniform(0.7, 0.97, n) * rng.choice([-1.0, 1.0], n)
    of_nodes = np.kron(np.eye(2), np.eye(n)) + np.kron([[0, 1], [1, 0]], np.diag(couple))
    K = 0.03 * G @ G.T / n + of_nodes
    press, shear = rng.standard_normal((2, 2 * n))
    press[n:] = np.abs(press[n:]) + 0.3
    # where couple Q > P the node may open as well as stick
    press[:n] = press[n:] * rng.uniform(0.5, 2.0, n) * np.sign(couple)
    f = rng.uniform(0.5, 3.0, n) * (rng.random(n) > 0.1)
    g0 = np.where(rng.random(n) < 0.5, rng.uniform(0.05, 0.3, n), 0.0) if seed % 3 == 0 else 0.0
    system = small_system(K, {"press": press, "shear": shear}, f, g0)
    corners = np.column_stack([rng.uniform(0.4, 1.2, 4), rng.uniform(-1.0, 1.0, 4)])
    return system, table(system, [[0.0, 0.0], *corners[: 2 + int(rng.integers(3))]])


def all_ends(system: Any, history: History, counts: list[int] | None = None) -> Ends:
    """Return the ends of all branches of a path, those that mean the same once.

    ``counts`` takes the number of continuations at each instant.
    """
    n, found = system.n, []
    touches = system.g0 <= 0.0
    start = np.zeros(2 * n), np.where(touches, 1, 2), 0.0
    here = [start]
    for leg, (a, b) in enumerate(pairwise(history.path)):
        following = []
        for u, state, force in here:
            r = [load @ system.r_star + system.K @ u for load in (a,)]
            force = max(force, float(np.abs(r).max()) if leg else 0.0)
            for end in follow(system, a, b, u, state, force, counts=counts):
                if end.s < 1.0:
                    found.append((leg, end.s, end.u))
                else:
                    following.append((end.u, end.state, force))
        here = following
    found += [(len(history.path) - 2, 1.0, u) for u, _, _ in here]
    return different(found)


def different(ends: Ends) -> Ends:
    """Return ends without those that are alike."""
    kept: Ends = []
    for leg, s, u in ends:
        size = max(np.abs(u).max(), *(np.abs(other).max() for *_, other in kept), 1e-300)
        if not any(
            leg == at and abs(s - place) <= APART and np.abs(u - other).max() <= APART * size
            for at, place, other in kept
        ):
            kept.append((leg, s, u))
    return kept
