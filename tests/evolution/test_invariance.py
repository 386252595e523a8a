"""What may not depend on units, sides, parts of loads, the order of nodes, or a second contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from problems import FAMILIES, Problem, play, problem

import receding_fenicsx as rf

pytestmark = [pytest.mark.one_rank, pytest.mark.once]

Image = Callable[[Problem], tuple[Problem, np.ndarray, float, float]]
"""Returns the other problem, its nodes that are the given ones, and the factors of force and
displacement."""


def in_other_units(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """Forces of 2^40, displacements of 2^-30, factors of the last load of 2^50.

    Each is a change of the exponent of all numbers.
    """
    force, length, s, h = 2.0**40, 2.0**-30, p.system, p.history
    factor = np.where(np.arange(len(s.load_names)) == len(s.load_names) - 1, 2.0**50, 1.0)
    r_star = s.r_star * (force / factor[:, None])
    system = replace(s, K=s.K * (force / length), r_star=r_star, g0=s.g0 * length)
    history = replace(h, path=h.path * factor, loop=h.loop * factor)
    return replace(p, system=system, history=history), np.arange(s.n), force, length


def written_otherwise(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """Newtons for giganewtons, metres for nanometres, forward for backward; all up to round-off.

    The last load is in two parts that act together, and the nodes are the other way round.
    """
    s, h, n, force, length = p.system, p.history, p.system.n, 1e-9, 1e9
    order, names = np.arange(n)[::-1], (*p.system.load_names, "part")
    both, sign = np.concatenate([order, n + order]), np.repeat([-1.0, 1.0], n)
    parts = force * np.vstack([s.r_star[:-1], 0.3 * s.r_star[-1], 0.7 * s.r_star[-1]])
    path, loop = (np.hstack([line, line[:, -1:]]) for line in (h.path, h.loop))
    system = replace(
        s,
        K=force / length * (sign[:, None] * s.K * sign)[np.ix_(both, both)],
        r_star=(sign * parts)[:, both],
        load_names=names,
        rigid=(sign[:, None] * s.rigid)[both],
        held=s.held[both],
        f=s.friction.backward[order],
        f_backward=s.f[order],
        g0=length * s.g0[order],
    )
    history = replace(h, load_names=names, path=path, loop=loop)
    return replace(p, system=system, history=history), order, force, length


def beside_itself(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """Two copies of the contact that have nothing in common but the loads."""
    s, n = p.system, p.system.n
    twice = np.concatenate([np.arange(n), np.arange(n)])
    both = np.concatenate([twice, n + twice])
    own = np.concatenate([np.zeros(n), np.ones(n)])
    same = np.tile(own[:, None] == own, (2, 2))
    rigid = [s.rigid[both] * np.tile(own == k, 2)[:, None] for k in (0, 1)]
    system = replace(
        s,
        x=np.arange(2.0 * n),
        points=np.stack([np.arange(2.0 * n), np.zeros(2 * n)], axis=1),
        weight=s.weight[twice],
        K=np.where(same, s.K[np.ix_(both, both)], 0.0),
        r_star=s.r_star[:, both],
        rigid=np.hstack(rigid),
        held=s.held[both],
        f=s.f[twice],
        f_backward=None if s.f_backward is None else s.f_backward[twice],
        g0=s.g0[twice],
    )
    return replace(p, system=system), np.arange(n), 1.0, 1.0


def outcome(p: Problem) -> rf.Record | rf.SolveError:
    """Return the record of a problem, or why there is none."""
    try:
        return play(p)
    except rf.SolveError as error:
        return error


@pytest.mark.parametrize("image", [in_other_units, written_otherwise, beside_itself])
@pytest.mark.parametrize("family", ["plain", "directed", "limit"])
def test_the_image_of_a_contact_does_what_the_contact_does(family: str, image: Image) -> None:
    for number in range(4100, 4110):
        p = FAMILIES[family](problem(number))
        other, nodes, force, length = image(p)
        a, b = outcome(p), outcome(other)
        if not isinstance(a, rf.Record) or not isinstance(b, rf.Record):
            assert type(a) is type(b), number
            continue
        bits, u = image is in_other_units, a.uniqueness
        assert u is not None and b.uniqueness is not None
        if bits:
            assert (a.sweeps, a.n_events, a.residual_max) == (b.sweeps, b.n_events, b.residual_max)
        if image is not beside_itself:
            assert u.certified == b.uniqueness.certified
            assert u.margin == pytest.approx(b.uniqueness.margin, rel=1e-9)
        if not (bits or u.certified):
            continue  # of several continuations the order of nodes may decide
        assert (a.jumps, a.steady.kind, a.steady.cycle) == (b.jumps, b.steady.kind, b.steady.cycle)
        scales = np.zeros(2)
        for name, k in (("P", 0), ("Q", 0), ("v", 1), ("w", 1)):
            scales[k] = max(scales[k], np.abs(getattr(a.turning_points, name)).max())
        scales *= (force, length)
        for name, k in (("P", 0), ("Q", 0), ("v", 1), ("w", 1)):
            side = -1.0 if image is written_otherwise and name in "Qv" else 1.0
            x = side * (force, length)[k] * getattr(a.turning_points, name)
            y = getattr(b.turning_points, name)[:, nodes]
            np.testing.assert_allclose(y, x, atol=(0.0 if bits else 1e-8) * scales[k], rtol=0.0)
        D = a.cycles.dissipation_density * force * length
        mine = b.cycles.dissipation_density[:, nodes]
        np.testing.assert_allclose(mine, D, atol=1e-8 * scales.prod(), rtol=0.0)
