"""Rigid motions that neither supports nor the contact resist: what slides, hangs, turns, drifts."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
from replay import objections
from small import small_system, table, walker

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

Played = tuple[ContactSystem, list[Any]]


def hanging(g0: float) -> Played:
    """Return a node on a spring along the plane and none across it, pulled to and fro."""
    node = small_system(np.diag([5.0, 0.0]), {"pull": [-1.0, 0.0]}, 0.6, g0, [[0.0, 1.0]])
    return node, [0.0, 0.5, -0.5, 0.5, -0.5]


def beam(k: float, at: list[int]) -> Played:
    """Return three feet on soft springs that fall through their play; on one they may turn."""
    K, turn, bend = np.zeros((6, 6)), [0.0, 0.0, 0.0, -1.0, 0.0, 1.0], [1.0, -2.0, 1.0]
    K[:3, :3] = np.eye(3)
    K[3:, 3:] = np.outer(bend, bend) + k * np.diag(at)
    noise = 1e-14 * np.random.default_rng(0).standard_normal((6, 6))
    loads = {"press": [0.0, 0.0, 0.0, 1.0, 2.0, 1.0]}
    rigid = [] if all(at) else [turn]
    return small_system(K + noise + noise.T, loads, 0.3, 0.005, rigid), [0.0, 1.0]


def lifted(k: float, g0: float) -> Played:
    """Return a body that is lifted off on soft springs, by the load over k, and put back."""
    lift, turn = np.array([[0.0, 0, 1, 1], [0, 0, 1, -1]]) / np.sqrt(2.0)
    K = np.diag([1.0, 1.0, 0.0, 0.0]) + k * np.outer(lift, lift) + 0.7 * np.outer(turn, turn)
    return small_system(K, {"pull": [0.0, 0.0, -1.3, -0.4]}, 0.3, g0), [0.0, 1.0, -1.0, 1.0]


def guided(k: float, angle: float) -> Played:
    """Return a body on a soft spring along its guide that lands again and again.

    It moves away by the load over k, the round-off of which must not remain as a force: with
    f K_tn > K_tt a node that unloads with Q unlike 0 would jump.
    """
    s, c = np.sin(angle), np.cos(angle)
    K = np.outer([-s, c], [-s, c]) + k * np.outer([c, s], [c, s])
    loads = {"a": [0.0, 0.41], "b": [0.0, -0.99], "c": [0.0, 0.7]}
    pressed, away = [0.75, 0.5, 1.0], [0.75, 1.0, -0.5]
    return small_system(K, loads, 1.0, 0.0625), [[0.0] * 3, pressed, *[away, pressed] * 3]


def unpressed(f: float) -> Played:
    """Return a free node whose pressure vanishes under shear."""
    loads = {"press": [0.0, 1.0], "pull": [1.0, 0.0]}
    free = small_system(np.diag([2.0, 0.0]), loads, f, rigid=[[0.0, 1.0]])
    return free, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]


def rolled() -> Played:
    """Return a rigid body that touches with one foot, and rolls onto both when it is pressed."""
    feet, rigid = np.diag([1.0, 1.0, 0.0, 0.0]), [[0.0, 0, 1, 1], [0.0, 0, -1, 1]]
    return small_system(feet, {"press": [0.0, 0, 1, 2]}, 0.3, [0.0, 0.1], rigid), [0.0, 1.0, 0.5]


def walked() -> Played:
    """Return two feet that walk, rest where they have come to, and are loaded again."""
    there = [[1, 0, 0], [1, 0.5, 0], *[[1, 0.5, 0.9], [1, 0.5, -0.9]] * 2, [1, 0, 0], [0, 0, 0]]
    return walker(4.0), [[0, 0, 0], *there, [1, 0.25, 0.5]]


@pytest.mark.parametrize(
    ("make", "given", "method"),
    [(hanging, (g0,), method) for g0 in (0.0, 0.25) for method in ("events", "gauss-seidel")]
    + [(beam, (k, [1, 1, 1]), "events") for k in (1e-6, 1e-12)]
    + [(beam, (k, [0, 1, 0]), "events") for k in (1e-7, 1e-9)]
    + [(lifted, pair, "events") for pair in product((1e-4, 1e-8, 1e-9), (0.0, 0.3))]
    + [(guided, pair, "events") for pair in product((1e-6, 1e-7, 1e-8), (0.49, 0.7, 1.1))]
    + [(unpressed, (f,), "events") for f in (0.3, 2.0)]
    + [(make, (), method) for make in (rolled, walked) for method in ("events", "gauss-seidel")],
)
def test_bodies_that_are_almost_free_keep_all_laws(
    make: Callable[..., Played], given: tuple[Any, ...], method: str
) -> None:
    system, path = make(*given)
    solver, history = SolverOptions(method=method, steps_per_leg=8), table(system, path)
    record = evolve(system, history, solver, OutputOptions(8, "all"))
    assert objections(system, history, record) == []
    assert record.jumps == 0
    assert make is not walked or np.abs(record.turning_points.v[-2]).min() > 0.1
    if make is hanging:  # nothing presses it: it does not fall
        assert not record.turning_points.w.any() and not record.turning_points.P.any()
