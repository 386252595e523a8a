"""Hard cases on the paper's block, on grids assembled without the package, on small systems."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
from hard import JUMPS, LIFTS, PULLS, SLIDES, SOLVED, UNRESOLVED, Case, Tally, require
from law import random_system
from models import block_system, grid_system
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.studies import run as study

BLOCK = Path(__file__).parent.parent / "demos" / "block.toml"

# -- bodies ---------------------------------------------------------------------------------------


@cache
def body(*overrides: str) -> rf.ContactSystem:
    """Condense the paper's block, 41 nodes of half of it, with friction."""
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=40", *overrides])
    system = rf.given(study.condense(scene, MPI.COMM_SELF))
    return system


WHOLE = 'solver.symmetry="none"'


@cache
def pushed_block(pull: bool = False) -> rf.ContactSystem:
    """Condense the block with a second load: shear on its left side, or a pull on its top."""
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=40"])
    second = (
        rf.Load("second", "top", (-1.0, 1.0), pressure=-1.0)
        if pull
        else rf.Load("second", "left", None, traction=(1.0, 0.0))
    )
    history = replace(scene.history, load="p0")
    scene = replace(scene, loads=(*scene.loads, second), history=history)
    scene = replace(
        scene,
        history=replace(
            history, kind="table", load=None, columns=("p0", "second"), rows=((1.0, 1.0),)
        ),
    )
    system = rf.given(study.condense(scene, MPI.COMM_SELF))
    return system


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


def locking(nu: float, tally: Tally) -> str:
    """Show which elements lock: dissipation and mean pressure, against many of order 2.

    Linear triangles show it more in the pressure, linear quadrilaterals more in the dissipation.
    """
    fine = body(f"material.poisson={nu}", "mesh.contact_elements=160", 'mesh.cell="quadrilateral"')
    limit = tally.solve(fine, cyclic(2))
    p = limit.turning_points.p[0]
    off, words = {}, []
    for cell, degree in ELEMENTS:
        coarse = body(
            f"material.poisson={nu}",
            f'mesh.cell="{cell}"',
            f"mesh.degree={degree}",
            f"mesh.contact_elements={80 // degree}",
        )
        record = tally.solve(coarse, cyclic(2))
        pressure = np.interp(limit.x, record.x, record.turning_points.p[0])
        D = record.cycles.dissipation[0] / limit.cycles.dissipation[0]
        off[cell, degree] = max(abs(D - 1.0), float(np.abs(pressure - p).mean() / p.max()))
        words.append(f"{cell}s of order {degree} {off[cell, degree]:.1%}")
    good = max(error for (_, degree), error in off.items() if degree == 2)
    bad = min(error for (_, degree), error in off.items() if degree == 1)
    require(good <= 0.03, f"order 2 is off by {good:.1%}")
    require(bad >= 2.0 * good, "order 1 does not lock: let its warning go")
    return "dissipation or pressure off by: " + ", ".join(words)


# -- loads and scales -----------------------------------------------------------------------------


def unloading(tally: Tally) -> str:
    """Unload completely and load again, again and again."""
    record = tally.solve(body(), cyclic(4, 0.0))
    ends = record.turning_points
    low = ends.load[:, 0] == 0.0
    require(np.abs(ends.P[low]).max() == 0.0, "forces are left at no load")
    return summed(record.cycles.dissipation)


def scaled(factor: float, tally: Tally) -> str:
    """Multiply the load."""
    one = tally.solve(body(), cyclic(3))
    big = replace(body(), r_star=factor * body().r_star)
    many = tally.solve(big, cyclic(3))
    off = differ(one, many, 1.0 / factor)
    require(off <= 1e-9, f"forces do not scale: {off:.1e}")
    require(np.array_equal(one.turning_points.state, many.turning_points.state), "other states")
    return f"forces differ by {off:.0e}"


def rescaled(key: str, factor: float, tally: Tally) -> str:
    """Multiply Young's modulus, the pressure, or all lengths."""
    numbers = {
        "E": [f"material.young={factor}"],
        "p0": [f"load.p0.pressure={factor}"],
        "h": [
            f"body.width={4.0 * factor}",
            f"body.height={factor}",
            f"load.p0.span=[{-factor}, {factor}]",
        ],
    }
    one, other = body(), body(*numbers[key])
    a, b = tally.solve(one, cyclic(3)), tally.solve(other, cyclic(3))
    force = {"E": 1.0, "p0": factor, "h": factor}[key]
    work = {"E": 1.0 / factor, "p0": factor**2, "h": factor**2}[key]
    off = differ(a, b, 1.0 / force)
    D = abs(b.cycles.dissipation[0] / (work * a.cycles.dissipation[0]) - 1.0)
    require(max(off, D) <= 1e-8, f"forces differ by {off:.1e}, dissipation by {D:.1e}")
    return f"forces differ by {off:.0e}, dissipation by {D:.0e}"


def many_cycles(cycles: int, nodes: int, tally: Tally) -> str:
    """Play very many cycles; the steady state must stay where it is."""
    system = body(f"mesh.contact_elements={nodes - 1}")
    record = tally.solve(system, cyclic(cycles))
    D = record.cycles.dissipation
    drift = float(np.ptp(D[len(D) // 2 :]) / D[0])
    require(drift <= 1e-10, f"the dissipation drifts by {drift:.1e}")
    require(record.steady.reached, "no steady state")
    return f"steady at cycle {record.steady.cycle}, drift of D {drift:.0e}"


def load_range(size: float, tally: Tally) -> str:
    """Cycle between 1 and nearly 1: the dissipation is proportional to so small a range."""
    D = [tally.solve(body(), cyclic(3, 1.0 - r)).cycles.dissipation / r for r in (1e-3, size)]
    off = float(np.abs(D[1] / D[0] - 1.0).max())
    require(
        off <= 2e-3, f"dissipation over range differs from that of a range of 1e-3 by {off:.0e}"
    )
    return f"{summed(D[1])}, differs from a range of 1e-3 by {off:.0e}"


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


def slide(f: float, tally: Tally) -> str:
    """Push the block along until it slides: when the shear on its side is f times the weight."""
    system = with_friction(pushed_block(), f)
    path = table(system, [[0, 0], [1, 0], [1, 3 * f]])
    try:
        tally.solve(system, path)
    except rf.RecedingError as error:
        at = load_named(error, 1)
        require(abs(at - 2.0 * f) <= 1e-7 * f, f"slides at {at:.9g}, not at {2.0 * f:.9g}")
        raise
    return "held for ever"


def almost_slide(tally: Tally) -> str:
    """Push the block almost to sliding and back."""
    system = pushed_block()
    top = 2.0 * 0.35 * (1.0 - 1e-9)
    path = table(system, [[0, 0], [1, 0]], [[1, 0], [1, top], [1, 0]], 3)
    return summed(tally.solve(system, path).cycles.dissipation)


def lift(tally: Tally) -> str:
    """Pull as hard as the pressure pushes: the body leaves the plane just then."""
    system = pushed_block(True)
    try:
        tally.solve(system, table(system, [[0, 0], [1, 0], [1, 2]]))
    except rf.RecedingError as error:
        at = load_named(error, 1)
        require(abs(at - 1.0) <= 1e-7, f"lifts off at {at:.9g}, not at 1")
        raise
    return "held for ever"


def pull(minimum: float, tally: Tally) -> str:
    """Pull from the start, or go through no load into pulling."""
    system = body()
    path = [[0.0], [-1.0]] if minimum == -1.0 else [[0.0], [1.0], [minimum]]
    tally.solve(system, table(system, path))
    return "held for ever"


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


def mirror_ties(f: float, tally: Tally) -> str:
    """Play the whole body, every event a tie of two nodes, against the half body."""
    whole = tally.solve(with_friction(body(WHOLE), f), cyclic(5))
    half = tally.solve(with_friction(body(), f), cyclic(5))
    P, Q = whole.turning_points.P, whole.turning_points.Q
    skew = max(np.abs(P - P[:, ::-1]).max(), np.abs(Q + Q[:, ::-1]).max()) / P.max()
    off = differ(whole, half)
    require(max(skew, off) <= 1e-9, f"skew by {skew:.1e}, half differs by {off:.1e}")
    return f"skew {skew:.0e}, half and whole differ by {off:.0e}"


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


def free_whole(tally: Tally) -> str:
    """Play the whole block without friction: nothing resists sliding."""
    whole = with_friction(body(WHOLE), 0.0)
    half = with_friction(body(), 0.0)
    one, two = tally.solve(whole, cyclic(3)), tally.solve(half, cyclic(3))
    v, w = one.turning_points.v, two.turning_points.v
    off = max(differ(one, two), float(np.abs(v - w).max() / np.abs(w).max()))
    require(off <= 1e-9, f"half differs by {off:.1e}")
    return f"half and whole differ by {off:.0e}"


def uniform_pressure(tally: Tally) -> str:
    """Press the whole top without friction: p = p0 everywhere, all nodes on the verge."""
    system = with_friction(body("load.p0.span=[-2.0, 2.0]", WHOLE), 0.0)
    p = tally.solve(system, cyclic(2)).turning_points.p[0]
    off = float(np.abs(p - 1.0).max())
    require(off <= 1e-9, f"pressure is off by {off:.1e}")
    return f"pressure is p0 to {off:.0e}"


# -- corners, strong friction, gaps, initial slip -------------------------------------------------


def corner(f: float, tally: Tally) -> str:
    """Press the whole top: the corners stick under a singular stress, nothing separates."""
    system = body("load.p0.span=[-2.0, 2.0]")
    record = tally.solve(with_friction(system, f), cyclic(3))
    open_ = float(np.mean(record.turning_points.state[0] == 2))
    return f"{open_:.0%} open, {summed(record.cycles.dissipation)}"


def wedge(coupling: float, tally: Tally) -> str:
    """Push one node whose friction couples so strongly that the rates have two answers or none."""
    K = [[1.0, coupling], [coupling, 1.5 * coupling**2]]
    system = small_system(K, {"press": [0.0, 1.0], "push": [-1.0, 0.0]}, 1.0)
    record = tally.solve(system, table(system, [[0, 0], [1, 0], [1, 1.2], [1, -1.2], [0.2, 0]]))
    return f"{record.n_events} changes of state"


def strong_random(seed: int, tally: Tally, on_jump: str = "stop") -> str:
    """Evolve a small random body with far too much friction for one answer."""
    system = random_system(seed, 4, 8.0)
    rng = np.random.default_rng(seed)
    corners = rng.uniform([0.3, -1.0], [1.5, 1.0], (4, 2))
    history = table(system, np.vstack([np.zeros(2), corners]))
    record = tally.solve(system, history, rf.SolverOptions(on_jump=on_jump))
    return f"{record.n_events} changes of state"


def gapped(whole: bool, tally: Tally) -> str:
    """Press a curved body that first touches at one node."""
    overrides = ['contact.initial_gap="0.05*x**2"', *([WHOLE] if whole else [])]
    record = tally.solve(body(*overrides), cyclic(3))
    return summed(record.cycles.dissipation)


def slipped(seed: int, tally: Tally) -> str:
    """Start from a random slip as large as the block's own displacements."""
    slip = np.random.default_rng(seed).uniform(-1.0, 1.0, body().n)
    record = tally.solve(body(), cyclic(3), initial_slip=slip)
    return summed(record.cycles.dissipation)


def patches(tally: Tally) -> str:
    """Take friction away from parts of the contact, and from single nodes."""
    f = np.where(np.abs(body().x) < 0.5, 0.0, 0.6)
    f[::7] = 0.0
    record = tally.solve(replace(body(), f=f), cyclic(3))
    return summed(record.cycles.dissipation)


def eccentric(tally: Tally) -> str:
    """Press beside the middle: nothing is symmetric, the body tilts."""
    record = tally.solve(body("load.p0.span=[0.2, 1.0]"), cyclic(3))
    return summed(record.cycles.dissipation)


def gauss_seidel(f: float, tally: Tally) -> str:
    """Let both methods play the same cycles."""
    system = with_friction(body(), f)
    exact = tally.solve(system, cyclic(2))
    steps = tally.solve(system, cyclic(2), rf.SolverOptions("gauss-seidel", steps_per_leg=80))
    off = differ(exact, steps)
    require(off <= 5e-3, f"methods differ by {off:.1e}")
    return f"80 steps a leg differ by {off:.0e}"


def own_block(tally: Tally) -> str:
    """Compare the package's block with one assembled and condensed without it."""
    mine = tally.solve(block_system(40, 20), cyclic(3))
    system = body(
        'mesh.cell="quadrilateral"', "mesh.degree=1", "mesh.growth=1.0", "mesh.contact_elements=80"
    )
    theirs = tally.solve(system, cyclic(3))
    off = differ(mine, theirs)
    require(off <= 1e-9, f"forces differ by {off:.1e}")
    return f"forces differ by {off:.0e}"


FRICTIONS = (0.0, 1e-6, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 1e3)
RATIOS = (0.0, 0.45, 0.49, 0.499, 0.4999)
ELEMENTS = (("triangle", 2), ("quadrilateral", 2), ("triangle", 1), ("quadrilateral", 1))

CASES: tuple[Case, ...] = (
    *(
        Case(f"f = {f:g}, load range 1 to {low:.2g}", SOLVED, partial(friction, f, low))
        for f in FRICTIONS
        for low in (1.0 / 3.0, 0.01)
    ),
    *(
        Case(f"nu = {nu:g}, {cell}s of order {degree}", SOLVED,
             partial(poisson, nu, cell, degree, 0.35))
        for nu in RATIOS
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
        for f in (0.05, 0.2)
        for low in (0.0, 0.01, 0.1)
    ),
    *(Case(f"locking, nu = {nu:g}", SOLVED, partial(locking, nu)) for nu in (0.49, 0.499)),
    Case("complete unloading and reloading", SOLVED, unloading),
    *(Case(f"load of {size:g}", SOLVED, partial(scaled, size)) for size in (1e-12, 1e12)),
    *(
        Case(f"{key} times {size:g}", SOLVED, partial(rescaled, key, size))
        for key in ("E", "p0", "h")
        for size in (1e-9, 1e9)
    ),
    Case("500 cycles, 41 nodes", SOLVED, partial(many_cycles, 500, 41)),
    Case("10000 cycles, 81 nodes", SOLVED, partial(many_cycles, 10000, 81), fast=False),
    *(
        Case(f"load range of {size:g}", SOLVED, partial(load_range, size))
        for size in (1e-4, 1e-6, 1e-7)
    ),
    Case("load range of 1e-09", UNRESOLVED, partial(load_range, 1e-9)),
    *(
        Case(f"turning point at an event{text}", SOLVED, partial(turning_at_an_event, shift))
        for text, shift in (("", 0.0), (" + 1e-15", 1e-15), (" - 1e-15", -1e-15))
    ),
    Case("load spiral down to round-off", SOLVED, spiral),
    *(Case(f"pushed along, f = {f:g}", SLIDES, partial(slide, f)) for f in (0.05, 0.35, 1.0)),
    Case("pushed to 1 - 1e-9 of sliding", SOLVED, almost_slide),
    Case("pulled off while pressed", LIFTS, lift),
    Case("pulled from the start", PULLS, partial(pull, -1.0)),
    Case("pulled after unloading", PULLS, partial(pull, -0.5)),
    *(
        Case(name, SOLVED, partial(meshed, overrides))
        for name, overrides in (
            ("growth 3", ["mesh.growth=3.0"]),
            ("growth 3, order 1", ["mesh.growth=3.0", "mesh.degree=1"]),
            ("growth 3, quadrilaterals", ["mesh.growth=3.0", 'mesh.cell="quadrilateral"']),
            ("four contact elements", ["mesh.contact_elements=4"]),
            ("load on one element", ["load.p0.span=[-0.05, 0.05]"]),
            ("thin layer, 40 by 1", ["body.width=40.0", "mesh.contact_elements=160"]),
            ("tower, 1 by 10", ["body.width=1.0", "body.height=10.0",
                                "load.p0.span=[-0.25, 0.25]"]),
        )
    ),
    Case("contact spacing varying by 1000", SOLVED, uneven_spacing),
    Case("cells 50 times as high as wide", SOLVED, partial(slender, 50, 1)),
    Case("cells 50 times as wide as high", SOLVED, partial(slender, 4, 25)),
    *(Case(f"whole body with mirror ties, f = {f:g}", SOLVED, partial(mirror_ties, f))
      for f in (0.1, 0.35, 1.0, 2.0)),
    *(Case(f"symmetric body disturbed by {size:g}", SOLVED, partial(perturbed, size))
      for size in (1e-14, 1e-13, 1e-12, 1e-10)),
    Case("whole block without friction", SOLVED, free_whole),
    Case("frictionless under uniform pressure", SOLVED, uniform_pressure),
    *(Case(f"corner that sticks, f = {f:g}", SOLVED, partial(corner, f)) for f in (0.35, 1.0, 3.0)),
    *(Case(f"one node, f K_tn/K_tt = {c:g}", f"{SOLVED} or {JUMPS}", partial(wedge, c))
      for c in (-0.9, 0.9, -1.5, 1.5, 5.0)),
    *(Case(f"random body {seed}, friction far above uniqueness", f"{SOLVED} or {JUMPS}",
           partial(strong_random, seed)) for seed in (*range(12), 73)),
    *(Case(f"random body {seed}, over its jumps", SOLVED,
           partial(strong_random, seed, on_jump="static")) for seed in (2, 7, 11)),
    Case("curved body, half", SOLVED, partial(gapped, False)),
    Case("curved body, whole", SOLVED, partial(gapped, True)),
    *(Case(f"random initial slip {seed}", SOLVED, partial(slipped, seed)) for seed in range(3)),
    Case("friction in patches", SOLVED, patches),
    Case("load beside the middle", SOLVED, eccentric),
    *(Case(f"Gauss-Seidel against events, f = {f:g}", SOLVED, partial(gauss_seidel, f), fast=False)
      for f in (0.2, 0.35, 1.0)),
    Case("block assembled independently", SOLVED, own_block),
)  # fmt: skip
