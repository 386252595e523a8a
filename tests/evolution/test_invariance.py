"""What may not depend on units, sides, parts of loads, the order of nodes, or a second contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from problems import FAMILIES, Problem, play, problem

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

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


def in_decimal_units(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """Newtons for giganewtons, metres for nanometres: up to round-off."""
    s = p.system
    system = replace(s, K=s.K * 1e-18, r_star=s.r_star * 1e-9, g0=s.g0 * 1e9)
    return replace(p, system=system), np.arange(s.n), 1e-9, 1e9


def mirrored(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """Forward is backward: Q and v change their sign, the coefficients of friction their places."""
    s, n = p.system, p.system.n
    sign = np.repeat([-1.0, 1.0], n)
    system = replace(
        s,
        K=sign[:, None] * s.K * sign,
        r_star=s.r_star * sign,
        rigid=sign[:, None] * s.rigid,
        f=s.friction.backward.copy(),
        f_backward=s.f,
    )
    return replace(p, system=system), np.arange(n), 1.0, 1.0


def under_one_load_more(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """The last load in two parts that act together."""
    s, h = p.system, p.history
    names = (*s.load_names, "part")
    parts = np.vstack([s.r_star[:-1], 0.3 * s.r_star[-1], 0.7 * s.r_star[-1]])
    path, loop = (np.hstack([line, line[:, -1:]]) for line in (h.path, h.loop))
    history = replace(h, load_names=names, path=path, loop=loop)
    system = replace(s, load_names=names, r_star=parts)
    return replace(p, system=system, history=history), np.arange(s.n), 1.0, 1.0


def in_another_order(p: Problem) -> tuple[Problem, np.ndarray, float, float]:
    """The nodes the other way round."""
    s, n = p.system, p.system.n
    order = np.arange(n)[::-1]
    both = np.concatenate([order, n + order])
    system = replace(
        s,
        K=s.K[np.ix_(both, both)],
        r_star=s.r_star[:, both],
        rigid=s.rigid[both],
        held=s.held[both],
        f=s.f[order],
        f_backward=None if s.f_backward is None else s.f_backward[order],
        g0=s.g0[order],
    )
    return replace(p, system=system), order, 1.0, 1.0


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


IMAGES = (
    *(in_other_units, in_decimal_units, mirrored),
    *(under_one_load_more, in_another_order, beside_itself),
)


@pytest.mark.parametrize("image", IMAGES)
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
            side = -1.0 if image is mirrored and name in "Qv" else 1.0
            x = side * (force, length)[k] * getattr(a.turning_points, name)
            y = getattr(b.turning_points, name)[:, nodes]
            np.testing.assert_allclose(y, x, atol=(0.0 if bits else 1e-8) * scales[k], rtol=0.0)
        D = a.cycles.dissipation_density * force * length
        mine = b.cycles.dissipation_density[:, nodes]
        np.testing.assert_allclose(mine, D, atol=1e-8 * scales.prod(), rtol=0.0)
