"""Hard cases: what is expected of each is written here before it is run.

Every answer that the package accepts is replayed (``replay.py``). Only overturning, gross sliding,
a pulling load, a body that touches nowhere, and a jump that enumeration of all states confirms
(``ways.py``) may be refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from equations import Body
from models import grid_system
from replay import HELD_SHARE, objections
from small import cyclic, table
from ways import choices, rates

import receding_fenicsx as rf
from receding_fenicsx.interface.system import eliminate_tangential

SOLVED, SLIDES, PULLS, TIPS = "solved", "gross sliding", "pull the body off", "overturning"
JUMPS, HOVERS = "no quasi-static continuation", "is not held"
MAY_JUMP = f"{SOLVED} or {JUMPS}"

HERE = Path(__file__).parent
DEMOS, TRIALS = HERE.parent / "demos", HERE / "trials"

Played = tuple[rf.ContactSystem, rf.History]
Check = Callable[[rf.Record], bool]


@dataclass(frozen=True)
class Case:
    """One hard case."""

    name: str
    expected: str
    """"solved", or words of the refusals that are right, joined by " or "."""
    make: Callable[[], Played]
    """Returns the contact, of kind "frictional", and its history."""
    fast: bool = True
    """It takes about a second."""
    check: Check = lambda _: True
    """What the record of the modelled part has to show besides the laws."""


def judge(case: Case) -> tuple[str, str, bool]:
    """Play a case; return the outcome, what is said of it, and whether that was expected.

    Halves and radians are played as bodies of their own. Of fewer than 60 nodes all that happens in
    the first cycle is replayed, of more its samples.
    """
    allowed, (system, history) = case.expected.split(" or "), case.make()
    system = replace(system, half=False, axisymmetric=False)
    played = system if np.any(system.f) else eliminate_tangential(system)
    output = rf.OutputOptions(samples_per_leg=24, cycles=(min(1, history.cycles),))
    try:
        record = rf.evolve(played, history, output=output)
    except rf.RecedingError as error:
        jumps = isinstance(error, rf.NoQuasiStaticContinuation)
        if jumps and not confirmed(system, history, error):
            return "WRONG", str(error), False
        return "refused", str(error), any(word in str(error) for word in allowed)
    found = objections(system, history, record, between=system.n < 60)
    if found or record.energy_error_max > 1e-8 or not case.check(record):
        return "WRONG", "; ".join(found[:3]), False
    return SOLVED, f"energy error {record.energy_error_max:.0e}", SOLVED in allowed


def confirmed(system: rf.ContactSystem, history: rf.History, error: rf.RecedingError) -> bool:
    """Return whether no rates of any kind satisfy the law where the error says that none do.

    The exact path is followed to just before that place, all states are tried there.
    """
    found = re.search(r"cycle (\d+), leg (\d+): .* \(s = (\S+) of the leg\)", str(error))
    assert found is not None, str(error)
    cycle, leg, s = int(found[1]), int(found[2]), float(found[3])
    line = history.path if cycle == 0 else history.loop
    before = [*history.path[:-1]] + [*history.loop[:-1]] * (cycle - 1) if cycle else []
    corners, (a, b) = [*before, *line[: leg + 1]], line[leg : leg + 2]
    if s > 1e-8:
        corners.append((1.0 - s + 1e-8) * a + (s - 1e-8) * b)
    end = rf.evolve(system, table(system, corners)).turning_points
    r, u = np.concatenate([end.Q[-1], end.P[-1]]), np.concatenate([end.v[-1], end.w[-1]])
    force = max(np.abs(r).max(), HELD_SHARE * np.abs(system.r_star).max())
    # on a limit within 1e-4 of the largest force
    body, near = Body(system), np.full(2 * system.n, 1e-4 * force)
    return not rates(body, b - a, choices(body, r, u, end.state[-1], near), 4**8)


ELEMENTS = (("triangle", 2), ("quadrilateral", 1))


@cache
def block(*overrides: str) -> rf.ContactSystem:
    """Condense the paper's block, 25 nodes of half of it, with friction."""
    scene = rf.read_scene(DEMOS / "block.toml", ["mesh.contact_elements=24", *overrides])
    return rf.given(rf.condense(scene, MPI.COMM_SELF))


def cycled(*overrides: str, f: float | None = None, low: float = 1.0 / 3.0) -> Played:
    """Return the block and three cycles."""
    system = block(*overrides)
    system = system if f is None else replace(system, f=np.full(system.n, f))
    return system, cyclic(3, low)


def meshed(nu: float, cell: str, degree: int) -> tuple[str, ...]:
    """Return the overrides of a Poisson's ratio and an element, with as many nodes."""
    mesh = f'mesh.cell="{cell}"', f"mesh.degree={degree}", f"mesh.contact_elements={48 // degree}"
    return f"material.poisson={nu}", *mesh


def on_grid(nx: int, ny: int) -> Played:
    """Use cells of aspect 1:50."""
    return grid_system(np.linspace(0.0, 2.0, nx + 1), np.linspace(0.0, 1.0, ny + 1)), cyclic(3)


Path_ = tuple[tuple[float, ...], ...]
PRESSED = rf.Load("p", "top", (-1.0, 1.0), pressure=1.0)
SHEAR = rf.Load("t", "top", None, traction=(1.0, 0.0))
LOWERED = rf.Load("d", "top", (-1.0, 1.0), displacement=("free", -0.01))
PLATEN = (
    rf.Load("n", "top", None, platen=True, force=(0.0, -1.0)),
    rf.Load("t", "top", None, platen=True, force=(1.0, 0.0)),
)
DRAGGED = (PLATEN[0], replace(PLATEN[1], force=None, displacement=(1.0, "free")))
CYCLE: tuple[Path_, Path_] = (((1.0,),), ((1.0 / 3.0,), (1.0,)))
TO_ZERO: tuple[Path_, Path_] = (((1.0,),), ((0.0,), (1.0,)))


def played(scene: rf.Scene) -> Played:
    """Condense a scene; a frictionless one with its tangential freedoms."""
    smooth = all(contact.friction == 0.0 for contact in scene.contacts)
    rough = tuple(replace(c, friction=1.0 if smooth else c.friction) for c in scene.contacts)
    system = rf.given(rf.condense(replace(scene, contacts=rough), MPI.COMM_SELF))
    history = rf.history_from_scene(scene)
    return (replace(system, f=np.zeros(system.n)) if smooth else system), history


def scene_of(loads: tuple[rf.Load, ...], path: tuple[Path_, Path_], **parts: Any) -> Played:
    """Play a block of 4 by 1 of 24 quadratic elements under a table of loads, three cycles."""
    names = tuple(dict.fromkeys(load.name for load in loads))
    cycles = 3 if path[1] else 0
    history = rf.HistoryOptions(
        "table", columns=names, rows=path[0], cycle_rows=path[1], cycles=cycles
    )
    scene = rf.Scene(mesh=rf.MeshOptions(contact_elements=24), loads=loads, history=history)
    return played(replace(scene, **parts))


def cylinder(f: float, degree: int, nu: float, path: tuple[Path_, Path_]) -> Played:
    """Press a cylinder on 0 <= r <= 1 of its top."""
    return scene_of(
        (replace(PRESSED, span=(0.0, 1.0)),),
        path,
        material=rf.Material(1.0, nu, "axisymmetric"),
        mesh=rf.MeshOptions(contact_elements=24, degree=degree),
        contacts=(rf.Contact(friction=f),),
    )


def walls(f: float, both: bool) -> Played:
    """Press a block into a corner, or between two walls."""
    side = rf.Contact("left", friction=f, span=(-0.4, 0.5))
    floor = rf.Contact("bottom", friction=f, span=(-1.9, 1.9 if both else 2.0))
    mesh = rf.MeshOptions(contact_elements=40)
    if both:
        contacts = (floor, side, replace(side, edge="right"))
        return scene_of((PRESSED,), CYCLE, contacts=contacts, mesh=mesh)
    push = rf.Load("q", "right", None, traction=(-0.5, 0.0))
    path = (((1.0, 1.0),), ((1.0, 0.2), (0.3, 1.0), (1.0, 1.0)))
    return scene_of((PRESSED, push), path, contacts=(floor, side), mesh=mesh)


def gapped(gap: str | float, whole: bool, path: tuple[Path_, Path_] = CYCLE) -> Played:
    """Start above the plane, here and there or everywhere."""
    contacts = (rf.Contact(friction=0.3, initial_gap=gap),)
    solver = rf.SolverOptions(symmetry="none" if whole else "auto")
    return scene_of((PRESSED,), path, contacts=contacts, solver=solver)


def pair(young: float, f: float) -> Played:
    """Press a block on another one; two that are alike and loaded alike do not slip."""
    return scene_of(
        (replace(PRESSED, edge="a.top"), replace(PRESSED, edge="b.bottom")),
        CYCLE,
        body=rf.Body("a"),
        others=(rf.Body("b", position=(0.0, -1.0)),),
        materials=(rf.Material(young, 0.2 if young != 1.0 else 0.3, name="b"),),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=f),),
    )


def trial(path: Path, elements: int, *overrides: str) -> Played:
    """Play a scene file at a number of elements."""
    return played(rf.read_scene(path, [f"mesh.contact_elements={elements}", *overrides]))


def rests(record: rf.Record, row: int) -> bool:
    """No force is left on an open contact."""
    return bool(np.abs(record.turning_points.P[row]).max() <= 1e-14)


def shear_lag(record: rf.Record) -> bool:
    """A cycle of a strip on a frictional wall dissipates F^3 / (12 q E A).

    The traction limit is q = f p, the slip length F / q = 6; what is left is of the order of the
    square of height over slip length.
    """
    height, pull, limit = 0.125, 0.024 * 0.125, 0.5 * 0.001
    exact = pull**3 / (12.0 * limit * height)
    return bool(np.abs(record.cycles.dissipation / exact - 1.0).max() <= 0.005)


def hertz(record: rf.Record) -> bool:
    """A round body that balances on one node: p_0 = 2 P / (pi a), a^2 = 4 P R / pi."""
    known = 2.0 / (np.pi * np.sqrt(4.0 * 0.3848 / np.pi))
    return bool(abs(record.turning_points.p[-1].max() / known - 1.0) <= 1e-3)


def alike(record: rf.Record) -> bool:
    """Every cycle of two clamped beams is like the first (Goodman & Klumpp 1956)."""
    D = record.cycles.dissipation
    return bool(np.abs(D / D[0] - 1.0).max() <= 1e-9) and record.steady.kind == "cyclic slip"


CASES: tuple[Case, ...] = (
    *(Case(f"f = {f:g}, load range 1 to {low:.2g}", SOLVED, partial(cycled, f=f, low=low))
      for f in (0.0, 1e-6, 0.05, 0.5, 2.0, 1e3) for low in (1.0 / 3.0, 0.01)),
    *(Case(f"nu = {nu:g}, {cell}s of order {degree}", SOLVED,
           partial(cycled, *meshed(nu, cell, degree)),
           check=lambda record: abs(record.turning_points.P[0].sum() - 1.0) <= 1e-8)
      for nu in (0.0, 0.4999) for cell, degree in ELEMENTS),
    *(Case(f"nu = 0.499, f = {f:g}, triangles of order {degree}, to {low:.2g}", MAY_JUMP,
           partial(cycled, *meshed(0.499, "triangle", degree), f=f, low=low), fast=low > 0.0)
      for f, low in ((1.0, 1.0 / 3.0), (3.0, 1.0 / 3.0), (3.0, 0.0)) for degree in (1, 2)),
    # without refined rates, or with the round-off of the unloaded end alone, most are refused
    *(Case(f"nu = 0.4999, f = {f:g}, {cell}s of order {degree}, load range 1 to {low:g}", SOLVED,
           partial(cycled, *meshed(0.4999, cell, degree), f=f, low=low))
      for cell, degree in ELEMENTS for f, low in ((0.05, 0.0), (0.2, 0.0), (0.2, 0.1))),
    *(Case(name, SOLVED, partial(cycled, *overrides)) for name, overrides in (
        ("growth 3", ["mesh.growth=3.0"]),
        ("growth 3, quadrilaterals", ["mesh.growth=3.0", 'mesh.cell="quadrilateral"']),
        ("four contact elements", ["mesh.contact_elements=4"]),
        ("load on one element", ["load.p0.span=[-0.05, 0.05]"]),
        ("load beside the middle", ["load.p0.span=[0.2, 1.0]"]),
        ("thin layer, 40 by 1", ["body.width=40.0", "mesh.contact_elements=160"]),
        ("tower, 1 by 10", ["body.width=1.0", "body.height=10.0", "load.p0.span=[-0.25, 0.25]"]),
        ("corner that sticks", ["load.p0.span=[-2.0, 2.0]", "contact.friction=1.0"]),
    )),
    Case("cells 50 times as high as wide", SOLVED, partial(on_grid, 50, 1)),
    Case("cells 50 times as wide as high", SOLVED, partial(on_grid, 4, 25)),
    *(Case(f"cylinder, f = {f:g}, order {degree}, nu = {nu:g}", SOLVED,
           partial(cylinder, f, degree, nu, path),
           check=lambda record: abs(record.turning_points.P[0].sum() - 0.5) <= 1e-10)
      for f, degree, nu, path in ((0.0, 1, 0.3, CYCLE), (0.35, 1, 0.3, CYCLE), (3.0, 2, 0.3, CYCLE),
                                  (0.35, 2, 0.499, CYCLE), (0.35, 2, 0.3, TO_ZERO))),
    *(Case(f"top {name}", SOLVED, partial(scene_of, (LOWERED,), path), check=check)
      for name, path, check in (
        ("lowered and raised", CYCLE, lambda _: True),
        ("raised through no load", (((1.0,),), ((-0.5,), (1.0,))), partial(rests, row=1)),
        ("raised from the start", (((-1.0,),), ()), partial(rests, row=0)),
    )),
    Case("platen to and fro", SOLVED,
         partial(scene_of, PLATEN, (((1.0, 0.0),), ((1.0, 0.3), (1.0, -0.3), (1.0, 0.0))))),
    Case("platen pushed along", f"{SLIDES} at n = 1, t = 0.35",
         partial(scene_of, PLATEN, (((1.0, 0.0), (1.0, 0.5)), ()))),
    Case("platen pulled off", PULLS, partial(scene_of, PLATEN, (((1.0, 0.0), (-1.0, 0.0)), ()))),
    # the body slides as a whole: Q is f P all over
    Case("platen dragged along", SOLVED,
         partial(scene_of, DRAGGED, (((1.0, 0.0), (1.0, 0.5)), ((1.0, -1.0), (1.0, 0.5)))),
         check=lambda record: bool(
             np.abs(np.abs(record.turning_points.Q[1:].sum(axis=1)) - 0.35).max() <= 1e-12)),
    *(Case(f"flat part of an edge, f = {f:g}", SOLVED,
           partial(scene_of, (replace(PRESSED, span=None),), CYCLE,
                   contacts=(rf.Contact(friction=f, span=(-0.5, 0.5)),))) for f in (0.35, 3.0)),
    *(Case(f"floor and wall, f = {f:g}", MAY_JUMP if f >= 1.0 else SOLVED, partial(walls, f, False))
      for f in (0.0, 0.3, 1.0, 2.0)),
    *(Case(f"between two walls, f = {f:g}", SOLVED, partial(walls, f, True)) for f in (0.1, 1.0)),
    Case("held on its right side", SOLVED, partial(
        scene_of, (PRESSED,), CYCLE, supports=(rf.Support("xy", edge="right"),))),
    Case("sheared to and fro", SOLVED, partial(
        scene_of, (PRESSED, SHEAR), (((1.0, 0.0), (1.0, 0.1)), ((1.0, -0.1), (1.0, 0.1))))),
    *(Case(f"gap {gap}{', whole' if whole else ''}", SOLVED, partial(gapped, gap, whole))
      for gap in ("0.05*x**2", "1e-14*x**2", "0.01*max(abs(x)-1,0)", "0.1*max(1-abs(x),0)")
      for whole in (False, True)),
    Case("gap unloaded completely", SOLVED, partial(gapped, "0.05*x**2", False, TO_ZERO)),
    Case("gap 0.01 everywhere, whole", HOVERS, partial(gapped, 0.01, True)),
    # the centre of pressure reaches the other end
    Case("tipped over by its left side", f"{TIPS} at p = 1, l = 1", partial(
        scene_of, (PRESSED, rf.Load("l", "left", None, traction=(0.0, 1.0))),
        (((1.0, 0.0), (1.0, 3.0)), ()))),
    Case("tipped over by its top", f"{TIPS} at p = 1, l = 1.1428", partial(
        scene_of, (PRESSED, rf.Load("l", "top", (1.0, 2.0), pressure=-1.0)),
        (((1.0, 0.0), (1.0, 3.0)), ()))),
    *(Case(f"two blocks, E_b = {young:g} E_a, f = {f:g}", SOLVED, partial(pair, young, f),
           check=lambda record, same=young == 1.0: (  # type: ignore[misc]
               bool(np.abs(record.turning_points.Q).max() <= 1e-12) or not same))
      for young in (1.0, 3.0, 100.0) for f in (0.1, 1.0)),
    # scene files, each at several sizes; the first is for the suite
    *(Case(f"{path.stem}, {elements} elements", SOLVED, partial(trial, path, elements, *more),
           fast=elements == sizes[0], check=check)
      for path, sizes, more, check in (
        (TRIALS / "roller.toml", (80, 160, 280, 320), (), lambda _: True),
        (TRIALS / "ring.toml", (20, 40, 80, 160), (), lambda _: True),
        (TRIALS / "lap_joint.toml", (60, 120, 240, 480), (), lambda _: True),
        (TRIALS / "fretting_out_of_phase.toml", (40, 80, 160, 320), (), lambda _: True),
        (DEMOS / "sheared_polygon.toml", (40, 80, 160, 320), (), lambda _: True),
        (TRIALS / "strip_on_wall.toml", (100, 200, 400, 600), (), shear_lag),
        (TRIALS / "rock.toml", (80, 40, 160, 320), (), hertz),
        (TRIALS / "goodman_klumpp.toml", (80, 40, 160, 320), ("history.cycles=6",), alike),
    ) for elements in sizes),
)  # fmt: skip
