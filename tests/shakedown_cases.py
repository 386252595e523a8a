"""Contacts with a mean load and a load range: two nodes with known limits, and random ones."""

from __future__ import annotations

import numpy as np
from small import small_system

import receding_fenicsx as rf

Loads = dict[str, float]
Case = tuple[rf.ContactSystem, Loads, list[Loads]]
"""System, mean loads, corners of the range."""
Span = tuple[float, float]

TO_AND_FRO = [{"range": 1.0}, {"range": -1.0}]
LOWER, UPPER = 8 / 19, 12 / 23
"""Limits of the two nodes under TO_AND_FRO."""


def two_nodes(coupling: float = 1.0) -> rf.ContactSystem:
    """Return the two-node example of Ahn, Bertocchi & Barber's kind with rational limits."""
    K_tn = coupling * np.array([[0.4, 0.8], [-0.8, -0.4]])
    K = np.block([[np.array([[2, -1], [-1, 2]]), K_tn], [K_tn.T, np.array([[3, -1], [-1, 3]])]])
    return small_system(K, {"mean": [0, 0, 1, 1], "range": [1, 0.5, 0, 0.5]}, 0.5)


def coupled_case(
    rng: np.random.Generator,
    n: int,
    corners: int,
    mean: tuple[Span, Span],
    change: tuple[Span, Span],
    friction: Span,
) -> Case:
    """Return a coupled system of random stiffness, its mean loads and a range of some corners.

    ``mean`` are the least and largest nodal forces of the mean loads, tangential and normal,
    ``change`` those of the loads "a" and "b" that make up the range.
    """
    G = rng.standard_normal((2 * n, 3 * n))
    K = G @ G.T / (3 * n) + 0.2 * np.eye(2 * n)
    K[:n, n:] *= rng.uniform(0.2, 0.6)
    K[n:, :n] = K[:n, n:].T
    spans = {"mean": mean, "a": change, "b": change}
    loads = {name: np.concatenate([rng.uniform(*s, n) for s in spans[name]]) for name in spans}
    angles = 2.0 * np.pi * (np.arange(corners) + rng.uniform(0.0, 0.3, 1)) / corners
    loop = [{"a": float(np.cos(t)), "b": float(np.sin(t))} for t in angles]
    return small_system(K, loads, rng.uniform(*friction, n)), {"mean": 1.0}, loop
