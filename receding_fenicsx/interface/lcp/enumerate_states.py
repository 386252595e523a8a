"""Exhaustive search over the states of a few contact nodes; failure proves nonexistence.

Every set of states makes the contact law of the nodes a linear system; its answer is a solution if
it keeps the inequalities of section 2 of Ahn & Barber (2008).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import Friction, State

EXHAUSTED = 2**16
"""Largest number of sets of states that is gone through: eight nodes with all four states."""

ACCEPTED = 1e-9
"""Violation of an inequality, over the largest term of its kind, up to which a set is accepted."""

UNCOUNTED = 2**62
"""Number of sets of states beyond which they are not counted."""

BATCH = 4096
"""Sets of states solved at once."""

Choices = list[tuple[int, ...]]


def count(choices: Choices) -> int:
    """Return the number of sets of states, ``UNCOUNTED`` where there are as many or more."""
    if not choices:
        return 0
    return min(math.prod(len(c) for c in choices), UNCOUNTED)


def exhaust(
    S: Array, s: Array, friction: Friction, choices: Choices, smooth: NDArray[np.bool_]
) -> NDArray[np.int8] | None:
    """Return states of m nodes that satisfy the contact law of rates, or None if there are none.

    Args:
        S: (2m, 2m) stiffness, order [v; w]: x = S u + s with the changes u of displacement and x of
            reaction.
        s: (2m,) change of reaction with the nodes held.
        friction: (m,) coefficients of friction.
        choices: the states that each node may take. A node that may not separate keeps its
            pressure, and one that may slip in one direction only is at that limit of friction.
        smooth: (m,) nodes that know only contact (stick) and separation, at whatever v does not
            concern.
    """
    for states in batches(choices):
        found, _ = solutions(S, s, friction, states, choices, smooth)
        if len(found):
            return found[0]
    return None


def batches(choices: Choices) -> Iterator[NDArray[np.int8]]:
    """Yield all sets of states, (k, m) with k up to ``BATCH`` at once."""
    every = product(*choices)
    while batch := list(islice(every, BATCH)):
        yield np.array(batch, dtype=np.int8)


def solutions(
    S: Array,
    s: Array,
    friction: Friction,
    states: NDArray[np.int8],
    choices: Choices,
    smooth: NDArray[np.bool_],
) -> tuple[NDArray[np.int8], Array]:
    """Return those of (k, m) sets of states that are solutions, and their (j, 2m) changes u.

    Arguments as for :func:`exhaust`.
    """
    m = len(friction.forward)
    S_t, S_n, s_t, s_n = S[:m], S[m:], s[:m], s[m:]
    A, B = friction[:, None].margins(S_t, S_n)
    a, b = friction.margins(s_t, s_n)
    stick, forward, backward, open_ = (
        states == state
        for state in (State.STICK, State.FORWARD_SLIP, State.BACKWARD_SLIP, State.SEPARATION)
    )
    eye = np.eye(2 * m)
    pick = [mask[:, :, None] for mask in (forward, backward, open_)]
    rows_t = np.where(pick[0], A, np.where(pick[1], B, np.where(pick[2], S_t, eye[:m])))
    right_t = np.where(forward, -a, np.where(backward, -b, np.where(open_, -s_t, 0.0)))
    rows_n, right_n = np.where(pick[2], S_n, eye[m:]), np.where(open_, -s_n, 0.0)
    # a smooth node's tangential freedom is not in the problem
    rows_t = np.where(smooth[:, None], eye[:m], rows_t)
    right_t = np.where(smooth, 0.0, right_t)
    matrix = np.concatenate([rows_t, rows_n], axis=1)
    right = np.concatenate([right_t, right_n], axis=1)[:, :, None]
    try:
        u = np.linalg.solve(matrix, right)[:, :, 0]
    except np.linalg.LinAlgError:
        # a set that leaves a motion without stiffness: least squares, checked below like all
        u = np.array(
            [np.linalg.lstsq(M, r[:, 0], rcond=None)[0] for M, r in zip(matrix, right, strict=True)]
        )
    x = u @ S.T + s
    balance = np.abs(np.einsum("kij,kj->ki", matrix, u) - right[:, :, 0]).max(axis=1)
    v, w, Q, P = u[:, :m], u[:, m:], x[:, :m], x[:, m:]
    force = np.maximum(np.abs(x).max(axis=1), np.abs(s).max())[:, None] * ACCEPTED
    way = np.abs(u).max(axis=1)[:, None] * ACCEPTED
    can_open, can_forward, can_backward = (
        np.array([state in c for c in choices])
        for state in (State.SEPARATION, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    )
    on_A, on_B = (can_forward | can_open) & ~smooth, (can_backward | can_open) & ~smooth
    margin_A, margin_B = friction.margins(Q, P)
    good = ~(stick & on_A) | (margin_A >= -force)
    good &= ~(stick & on_B) | (margin_B >= -force)
    good &= ~(~open_ & can_open) | (P >= -force)
    good &= ~forward | (v >= -way)
    good &= ~backward | (v <= way)
    good &= ~open_ | (w >= -way)
    solved = np.flatnonzero(good.all(axis=1) & (balance <= force[:, 0]))
    return states[solved], u[solved]
