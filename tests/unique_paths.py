"""All continuations of random contacts: is a path that is certified the only one?

Contacts of strong coupling, and ones on which several nodes reach their limits at the same instant:
mirror-symmetric ones, doubled ones, whose halves may be coupled, and paths that begin again from no
force. All continuations at each event and turning point are found by ``ways.py``, which tries all
states and shares nothing with the package.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
from small import small_system, table
from ways import TooMany, follow

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import SolverOptions

KINDS = ("pairs", "mirror", "doubled", "from zero", "plain", "gaps", "load steps")
FALSE = "certified, yet several"

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


def symmetric_problem(seed: int, kind: str) -> tuple[ContactSystem, History]:
    """Return a contact and a path on which nodes reach limits together, or again from no force."""
    rng = np.random.default_rng([seed, 29])
    n = {"mirror": 2 + seed % 3, "doubled": 2 + 2 * (seed % 2)}.get(kind, 1 + seed % 4)
    swap = np.eye(n)[::-1] if kind == "mirror" else np.roll(np.eye(n), n // 2, axis=0)
    image = np.kron(np.diag([-1.0 if kind == "mirror" else 1.0, 1.0]), swap)

    def symmetric(rows: np.ndarray) -> np.ndarray:
        return 0.5 * (rows + rows @ image.T) if kind in ("mirror", "doubled") else rows

    G, C = rng.standard_normal((2 * n, 3 * n)), rng.standard_normal((n, n))
    if seed % 3 == 0:
        C = np.diag(np.diag(C))
    K = np.block([[np.zeros((n, n)), C], [C.T, np.zeros((n, n))]])
    K = symmetric(symmetric(K).T)
    K *= np.sqrt(2.0) * rng.uniform(0.6, 0.97) / np.linalg.norm(K, 2)
    K += (
        np.diag(np.repeat([1.0, 2.0], n))
        + rng.uniform(0.0, 0.03) * symmetric(symmetric(G @ G.T).T) / n
    )
    # often pressed first, so that all nodes stick, and then sheared until they slip
    loads, f = rng.standard_normal((2, 2 * n)), rng.uniform(0.5, 2.0, n)
    loads[0, n:] = np.abs(loads[0, n:]) + 0.5
    pressed = rng.random() < 0.7
    loads[0, :n] *= 0.0 if pressed else f * rng.uniform(0.0, 2.0)
    loads[1, :n] *= 2.0 * f
    loads[1, n:] *= 0.0 if pressed else 1.0
    loads = symmetric(loads)
    if kind in ("mirror", "doubled"):
        f = 0.5 * (f + swap @ f)
    if kind == "doubled":
        # coupled weakly or not at all
        half = np.kron(np.ones(2), np.arange(n) < n // 2) > 0.5
        weak = rng.choice([0.0, 1e-3, 0.2])
        K[np.ix_(half, ~half)] *= weak
        K[np.ix_(~half, half)] *= weak
    system = small_system(K, {"press": loads[0], "shear": loads[1]}, f)
    corners = np.column_stack([rng.uniform(0.4, 1.2, 3), rng.uniform(-1.5, 1.5, 3)])
    corners = corners[: 2 + int(rng.integers(2))]
    if pressed:
        corners[0, 1] = 0.0
    if kind == "from zero" or rng.random() < 0.2:
        corners = np.insert(corners, 1, 0.0, axis=0)
    return system, table(system, [[0.0, 0.0], *corners])


def pairs(seed: int) -> tuple[ContactSystem, History]:
    """Return one or two mirror pairs, pressed and then pulled: K_tn = a at a node, b in a pair."""
    rng = np.random.default_rng([seed, 31])
    copies = 1 + seed % 2
    a, b = rng.uniform(-0.9, -0.2), rng.uniform(-1.0, 1.0)
    C = np.array([[a, -b], [b, -a]])
    C *= min(1.0, 1.35 / np.linalg.norm(C, 2))
    apart = np.eye(copies) + rng.choice([0.0, 0.1]) * (1.0 - np.eye(copies))
    eye = np.eye(2 * copies)
    C = np.kron(apart, C) / np.linalg.norm(apart, 2)
    system = small_system(
        np.block([[eye, C], [C.T, 2.0 * eye]]),
        {"press": np.repeat([0.0, 1.0], 2 * copies), "pull": [*[-1, 1] * copies, *[0, 0] * copies]},
        rng.uniform(0.5, 2.0),
    )
    corners = [(0, 0), (1, 0), (1, rng.choice([-3.0, 3.0])), (rng.uniform(0.5, 1.5), 0)]
    return system, table(system, corners[: 3 + seed // 2 % 2])


def problem(seed: int, kind: str) -> tuple[ContactSystem, History]:
    """Return a problem of one of the kinds."""
    if kind == "plain":
        return random_problem(seed if seed % 3 else seed + 4)
    if kind == "gaps":
        return random_problem(3 * seed)
    if kind == "pairs" or (kind == "load steps" and seed % 2):
        return pairs(seed if kind == "pairs" else 2 * seed)
    return symmetric_problem(seed, "mirror" if kind == "load steps" else kind)


def verdict(seed: int, kind: str) -> tuple[str, int]:
    """Return what the certificate of a path is worth, and how many instants there were."""
    system, history = problem(seed, kind)
    method = "gauss-seidel" if kind == "load steps" else "events"
    try:
        unique = evolve(system, history, SolverOptions(method=method)).uniqueness
    except SolveError:
        return "refused", 0
    counts = list[int]()
    try:
        all_ends(system, history, counts)
    except TooMany:
        return "not enumerated", 0
    assert unique is not None
    if max(counts) > 1:
        return (FALSE if unique.certified else "several, not certified"), len(counts)
    return ("one, certified" if unique.certified else "one, not certified"), len(counts)


def tally(seeds: range, kind: str) -> tuple[Counter[str], int, list[int]]:
    """Return the number of each verdict, of instants, and the seeds of false certificates."""
    found, instants, false = Counter[str](), 0, list[int]()
    for seed in seeds:
        said, count = verdict(seed, kind)
        found[said] += 1
        instants += count
        if said == FALSE:
            false.append(seed)
    return found, instants, false
