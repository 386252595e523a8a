"""Hard cases on the paper's block, on grids assembled without the package, on small systems."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
from hard import JUMPS, SOLVED, Case, Tally, require
from models import grid_system, pushed_block
from small import cyclic, table

import receding_fenicsx as rf
from receding_fenicsx.studies import run as study

BLOCK = Path(__file__).parent.parent / "demos" / "block.toml"

ELEMENTS = (("triangle", 2), ("quadrilateral", 2), ("triangle", 1), ("quadrilateral", 1))

# -- bodies ---------------------------------------------------------------------------------------


@cache
def body(*overrides: str) -> rf.ContactSystem:
    """Condense the paper's block, 41 nodes of half of it, with friction."""
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=40", *overrides])
    system = rf.given(study.condense(scene, MPI.COMM_SELF))
    return system


WHOLE = 'solver.symmetry="none"'


def with_friction(system: rf.ContactSystem, f: float) -> rf.ContactSystem:
    """Change the coefficient of friction."""
    return replace(system, f=np.full(system.n, f))


def summed(D: np.ndarray) -> str:
    """Say how much of cycle 1's dissipation is left."""
    return f"D_n/D_1 = {D[-1] / D[0]:.6f}" if len(D) and D[0] > 0.0 else "no dissipation"


def differ(a: rf.Record, b: rf.Record, scale: float = 1.0) -> float:
    """Return the largest difference of nodal forces at turning points, over the largest force.

    The forces of ``b`` are multiplied by ``scale``.
    """
    one, two = a.turning_points, b.turning_points
    difference = max(np.abs(one.P - scale * two.P).max(), np.abs(one.Q - scale * two.Q).max())
    return float(difference / np.abs(one.P).max())


# -- friction and Poisson's ratio -----------------------------------------------------------------


def friction(f: float, minimum: float, tally: Tally) -> str:
    """Play cycles at one coefficient of friction."""
    return summed(tally.solve(with_friction(body(), f), cyclic(4, minimum)).cycles.dissipation)


def poisson(
    nu: float, cell: str, degree: int, f: float, tally: Tally, minimum: float = 1.0 / 3.0
) -> str:
    """Play cycles of a nearly incompressible body."""
    system = body(
        f"material.poisson={nu}",
        f'mesh.cell="{cell}"',
        f"mesh.degree={degree}",
        f"mesh.contact_elements={80 // degree}",
    )
    record = tally.solve(with_friction(system, f), cyclic(3, minimum))
    P = record.turning_points.P[0]
    require(abs(P.sum() - 2.0) <= 1e-8, "the reactions do not carry the load")
    middle = len(P) // 2
    return f"centre pressure {record.turning_points.p[0, middle]:.4f}"


# -- loads and scales -----------------------------------------------------------------------------


def turning_at_an_event(shift: float, tally: Tally) -> str:
    """Turn the load exactly where a node changes its state, or within round-off of it."""
    first = tally.solve(body(), cyclic(1, 0.2))
    e = first.events
    inside = np.flatnonzero((e.cycle == 1) & (e.leg == 0) & (e.s > 0.0))
    low = float(e.load[inside[len(inside) // 2], 0]) * (1.0 + shift)
    near, at = tally.solve(body(), cyclic(3, low * (1 + 1e-7))), tally.solve(body(), cyclic(3, low))
    off = differ(near, at)
    require(off <= 1e-5, f"a turning point moved by 1e-7 moves forces by {off:.1e}")
    return f"forces differ by {off:.0e} from those of a turning point 1e-7 beside it"


def spiral(tally: Tally) -> str:
    """Let the range of the load die away to round-off around a half."""
    corners = [[0.0], [1.0]] + [[0.5 + 0.5 * (-0.5) ** k] for k in range(1, 50)]
    record = tally.solve(body(), table(body(), corners))
    return f"{record.n_events} changes of state"


# -- refusals -------------------------------------------------------------------------------------


def load_named(error: rf.RecedingError, which: int) -> float:
    """Read the load factor out of a refusal."""
    return float(re.findall(r"\w = ([-+.\de]+)", str(error))[which])


def almost_slide(tally: Tally) -> str:
    """Push the block almost to sliding and back."""
    system = pushed_block()
    top = 2.0 * 0.35 * (1.0 - 1e-9)
    path = table(system, [[0, 0], [1, 0]], [[1, 0], [1, top], [1, 0]], 3)
    return summed(tally.solve(system, path).cycles.dissipation)


# -- meshes ---------------------------------------------------------------------------------------


def meshed(overrides: Sequence[str], tally: Tally) -> str:
    """Play cycles on an unusual mesh or body."""
    return summed(tally.solve(body(*overrides), cyclic(3)).cycles.dissipation)


def uneven_spacing(tally: Tally) -> str:
    """Let neighbouring contact elements differ up to a thousandfold over the edge."""
    steps = 1e-4 * 1000.0 ** (np.arange(14) / 13.0)
    right = np.concatenate([[0.0], np.cumsum(steps)])
    right *= 1.0 / right[-1]
    xs = np.concatenate([1.0 - right[::-1], 1.0 + right[1:]])
    xs[0] = 0.0
    spacing = np.diff(xs)
    require(spacing.max() / spacing.min() >= 900.0, "the spacing is not uneven")
    ys = np.concatenate([[0.0], np.cumsum(steps)])
    record = tally.solve(grid_system(xs, ys / ys[-1]), cyclic(3))
    return summed(record.cycles.dissipation)


def slender(nx: int, ny: int, tally: Tally) -> str:
    """Use cells of aspect 1:50."""
    system = grid_system(np.linspace(0.0, 2.0, nx + 1), np.linspace(0.0, 1.0, ny + 1))
    return summed(tally.solve(system, cyclic(3)).cycles.dissipation)


# -- symmetry and near ties -----------------------------------------------------------------------


def perturbed(size: float, tally: Tally) -> str:
    """Disturb the whole body by round-off: ties become events that are nearly equal."""
    whole = body(WHOLE)
    rng = np.random.default_rng(3)
    noise = rng.uniform(-1.0, 1.0, whole.K.shape)
    other = replace(
        whole,
        K=whole.K * (1.0 + 0.5 * size * (noise + noise.T)),
        r_star=whole.r_star * (1.0 + size * rng.uniform(-1.0, 1.0, whole.r_star.shape)),
        f=whole.f * (1.0 + size * rng.uniform(-1.0, 1.0, whole.n)),
    )
    off = differ(tally.solve(whole, cyclic(5)), tally.solve(other, cyclic(5)))
    allowed = 1e5 * size
    require(off <= allowed, f"forces differ by {off:.1e}")
    return f"forces differ by {off:.0e}"


# -- corners, strong friction, gaps, initial slip -------------------------------------------------


def patches(tally: Tally) -> str:
    """Take friction away from parts of the contact, and from single nodes."""
    f = np.where(np.abs(body().x) < 0.5, 0.0, 0.6)
    f[::7] = 0.0
    record = tally.solve(replace(body(), f=f), cyclic(3))
    return summed(record.cycles.dissipation)


CASES: tuple[Case, ...] = (
    *(
        Case(f"f = {f:g}, load range 1 to {low:.2g}", SOLVED, partial(friction, f, low))
        for f in (0.0, 1e-6, 0.05, 0.2, 0.5, 1.0, 2.0, 1e3)
        for low in (1.0 / 3.0, 0.01)
    ),
    *(
        Case(f"nu = {nu:g}, {cell}s of order {degree}", SOLVED,
             partial(poisson, nu, cell, degree, 0.35))
        for nu in (0.0, 0.49, 0.4999)
        for cell, degree in ELEMENTS
    ),
    *(
        Case(f"nu = 0.499, f = {f:g}, triangles of order {degree}", f"{SOLVED} or {JUMPS}",
             partial(poisson, 0.499, "triangle", degree, f))
        for f in (1.0, 3.0)
        for degree in (1, 2)
    ),
    *(
        Case(f"nu = 0.499, f = {f:g}, triangles of order {degree}, to no load",
             f"{SOLVED} or {JUMPS}",
             partial(poisson, 0.499, "triangle", degree, f, minimum=0.0), fast=False)
        for f, degree in ((3.0, 1), (3.0, 2), (5.0, 2))
    ),
    # without refined rates, or with the round-off of the unloaded end alone, most are refused
    *(
        Case(f"nu = 0.4999, f = {f:g}, {cell}s of order {degree}, load range 1 to {low:g}", SOLVED,
             partial(poisson, 0.4999, cell, degree, f, minimum=low))
        for cell, degree in ELEMENTS
        for f, low in ((0.05, 0.0), (0.2, 0.0), (0.2, 0.1))
    ),
    *(
        Case(f"turning point at an event{text}", SOLVED, partial(turning_at_an_event, shift))
        for text, shift in (("", 0.0), (" + 1e-15", 1e-15), (" - 1e-15", -1e-15))
    ),
    Case("load spiral down to round-off", SOLVED, spiral),
    Case("pushed to 1 - 1e-9 of sliding", SOLVED, almost_slide),
    *(
        Case(name, SOLVED, partial(meshed, overrides))
        for name, overrides in (
            ("growth 3", ["mesh.growth=3.0"]),
            ("growth 3, quadrilaterals", ["mesh.growth=3.0", 'mesh.cell="quadrilateral"']),
            ("four contact elements", ["mesh.contact_elements=4"]),
            ("load on one element", ["load.p0.span=[-0.05, 0.05]"]),
            ("load beside the middle", ["load.p0.span=[0.2, 1.0]"]),
            ("thin layer, 40 by 1", ["body.width=40.0", "mesh.contact_elements=160"]),
            ("tower, 1 by 10", ["body.width=1.0", "body.height=10.0",
                                "load.p0.span=[-0.25, 0.25]"]),
            ("corner that sticks", ["load.p0.span=[-2.0, 2.0]", "contact.friction=1.0"]),
        )
    ),
    Case("contact spacing varying by 1000", SOLVED, uneven_spacing),
    Case("cells 50 times as high as wide", SOLVED, partial(slender, 50, 1)),
    Case("cells 50 times as wide as high", SOLVED, partial(slender, 4, 25)),
    *(Case(f"symmetric body disturbed by {size:g}", SOLVED, partial(perturbed, size))
      for size in (1e-14, 1e-12, 1e-10)),
    Case("friction in patches", SOLVED, patches),
)  # fmt: skip
