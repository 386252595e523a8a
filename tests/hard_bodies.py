"""Hard cases on other bodies, loads and contacts than the paper's: ``hard.py`` judges them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
from hard import HOVERS, JUMPS, PULLS, SLIDES, SOLVED, TIPS, Case, Tally, require
from hard_block import load_named, summed, with_friction

import receding_fenicsx as rf
from receding_fenicsx.studies import run as study

Path_ = tuple[tuple[float, ...], ...]

PRESSED = rf.Load("p", "top", (-1.0, 1.0), pressure=1.0)
CYCLE: tuple[Path_, Path_] = (((1.0,),), ((1.0 / 3.0,), (1.0,)))
TO_ZERO: tuple[Path_, Path_] = (((1.0,),), ((0.0,), (1.0,)))
WHOLE = rf.SolverOptions(symmetry="none")


def scene_of(loads: tuple[rf.Load, ...], path: tuple[Path_, Path_], **parts: Any) -> rf.Scene:
    """A block of 4 by 1 of 40 quadratic elements under a table of loads, three cycles."""
    names = tuple(dict.fromkeys(load.name for load in loads))
    history = rf.HistoryOptions("table", columns=names, rows=path[0], cycle_rows=path[1], cycles=3)
    scene = rf.Scene(mesh=rf.MeshOptions(contact_elements=40), loads=loads, history=history)
    return replace(scene, **parts)


def solve(tally: Tally, scene: rf.Scene) -> tuple[rf.ContactSystem, rf.Record]:
    """Condense and evolve a scene; a frictionless one is checked with its tangential freedoms."""
    smooth = all(contact.friction == 0.0 for contact in scene.contacts)
    rough = tuple(replace(c, friction=1.0 if smooth else c.friction) for c in scene.contacts)
    rf.validate(scene)
    system = rf.given(study.condense(replace(scene, contacts=rough), MPI.COMM_SELF))
    if smooth:
        system = with_friction(system, 0.0)
    return system, tally.solve(system, rf.history_from_scene(scene))


def played(scene: rf.Scene, tally: Tally) -> str:
    """Play a scene that has nothing more to be held against."""
    return summed(solve(tally, scene)[1].cycles.dissipation)


def cylinder(f: float, degree: int, nu: float, path: tuple[Path_, Path_], tally: Tally) -> str:
    """Press a cylinder on 0 <= r <= 1 of its top: the contact carries pi p."""
    scene = scene_of(
        (rf.Load("p", "top", (0.0, 1.0), pressure=1.0),),
        path,
        material=rf.Material(1.0, nu, "axisymmetric"),
        mesh=rf.MeshOptions(contact_elements=40, degree=degree),
        contacts=(rf.Contact(friction=f),),
    )
    _, record = solve(tally, scene)
    carried = float(record.turning_points.P[0].sum())
    require(abs(carried - np.pi) <= 1e-10, f"the contact carries {carried:.9g}, not pi")
    return summed(record.cycles.dissipation)


def lowered(path: tuple[Path_, Path_], open_at: int | None, tally: Tally) -> str:
    """Move the top down and up: an edge that is held may lift the body off its plane."""
    load = rf.Load("d", "top", (-1.0, 1.0), displacement=("free", -0.01))
    _, record = solve(tally, scene_of((load,), path))
    ends = record.turning_points
    if open_at is not None:
        P = float(np.abs(ends.P[open_at]).max())
        require(P <= 1e-12 * 0.01, f"forces of {P:.1e} are left on an open contact")
    return summed(record.cycles.dissipation)


PLATEN = (
    rf.Load("n", "top", None, platen=True, force=(0.0, -1.0)),
    rf.Load("t", "top", None, platen=True, force=(1.0, 0.0)),
)


def platen(path: tuple[Path_, Path_], slides_at: float | None, tally: Tally) -> str:
    """Press and shear by a platen under forces: it slides at f times the pressing force."""
    scene = scene_of(PLATEN, path)
    try:
        return played(scene, tally)
    except rf.RecedingError as error:
        if slides_at is not None:
            at = load_named(error, 1)
            require(abs(at - slides_at) <= 1e-9, f"slides at {at:.12g}, not at {slides_at}")
        raise


def dragged(tally: Tally) -> str:
    """Drag the platen to and fro so far that the body slides as a whole: Q is f P all over."""
    loads = (PLATEN[0], rf.Load("t", "top", None, platen=True, displacement=(1.0, "free")))
    path = (((1.0, 0.0), (1.0, 0.5)), ((1.0, -1.0), (1.0, 0.5)))
    _, record = solve(tally, scene_of(loads, path))
    total = np.abs(record.turning_points.Q[1:].sum(axis=1))
    off = float(np.abs(total - 0.35).max())
    require(off <= 1e-12, f"the shear is not f times the force: {off:.1e}")
    # each way the platen moves 1.5, less what the body gives
    D = record.cycles.dissipation
    require(np.all(D <= 0.35 * 3.0), "more is dissipated than the platen's way allows")
    return summed(D)


def walls(f: float, both: bool, tally: Tally) -> str:
    """Press a block into a corner, or between two walls."""
    side = rf.Contact("left", friction=f, span=(-0.4, 0.5))
    floor = rf.Contact("bottom", friction=f, span=(-1.9, 1.9 if both else 2.0))
    if both:
        contacts = (floor, side, replace(side, edge="right"))
        return played(scene_of((PRESSED,), CYCLE, contacts=contacts), tally)
    push = rf.Load("q", "right", None, traction=(-0.5, 0.0))
    path = (((1.0, 1.0),), ((1.0, 0.2), (0.3, 1.0), (1.0, 1.0)))
    return played(scene_of((PRESSED, push), path, contacts=(floor, side)), tally)


def gapped(gap: str | float, whole: bool, path: tuple[Path_, Path_], tally: Tally) -> str:
    """Start above the plane, here and there or everywhere."""
    scene = scene_of((PRESSED,), path, contacts=(rf.Contact(friction=0.3, initial_gap=gap),))
    record = solve(tally, replace(scene, solver=WHOLE) if whole else scene)[1]
    if whole:
        half = solve(tally, scene)[1]
        off = np.abs(half.turning_points.P - record.turning_points.P).max()
        require(off <= 1e-9 * record.turning_points.P.max(), f"half differs by {off:.1e}")
    return summed(record.cycles.dissipation)


def overturned(load: rf.Load, at: float, tally: Tally) -> str:
    """Lift one end until the centre of pressure reaches the other: the body tips over."""
    scene = scene_of((PRESSED, load), (((1.0, 0.0), (1.0, 3.0)), ()))
    try:
        return played(scene, tally)
    except rf.RecedingError as error:
        named = load_named(error, 1)
        require(abs(named - at) <= 1e-6, f"tips at {named:.9g}, not at {at:.9g}")
        raise


def pair(young: float, f: float, tally: Tally) -> str:
    """Press a block on another one; two that are alike and loaded alike do not slip."""
    scene = scene_of(
        (replace(PRESSED, edge="a.top"), replace(PRESSED, edge="b.bottom")),
        CYCLE,
        body=rf.Body("a"),
        others=(rf.Body("b", position=(0.0, -1.0)),),
        materials=(rf.Material(young, 0.2 if young != 1.0 else 0.3, name="b"),),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=f),),
    )
    _, record = solve(tally, scene)
    D = float(record.dissipation_first_loading)
    if young == 1.0:
        largest = float(np.abs(record.turning_points.Q).max())
        require(largest <= 1e-12, f"two blocks alike are sheared by {largest:.1e}")
        return "no shear"
    require(D > 0.0 or f >= 1.0, "two unlike blocks do not slip")
    return summed(record.cycles.dissipation)


HELD = rf.Support("x", point=(-2.0, 1.0))
SHEAR = rf.Load("t", "top", (-1.0, 1.0), traction=(1.0, 0.0))

CASES: tuple[Case, ...] = (
    *(
        Case(f"cylinder, f = {f:g}, order {degree}", SOLVED,
             partial(cylinder, f, degree, 0.3, CYCLE))
        for f in (0.0, 0.35, 3.0)
        for degree in (1, 2)
    ),
    Case("cylinder, nu = 0.499", SOLVED, partial(cylinder, 0.35, 2, 0.499, CYCLE)),
    Case("cylinder unloaded completely", SOLVED, partial(cylinder, 0.35, 2, 0.3, TO_ZERO)),
    Case("top lowered and raised", SOLVED, partial(lowered, CYCLE, None)),
    Case("top raised to no load", SOLVED, partial(lowered, TO_ZERO, 1)),
    Case("top raised through no load", SOLVED,
         partial(lowered, (((1.0,),), ((-0.5,), (1.0,))), 1)),
    Case("top raised from the start", SOLVED, partial(lowered, (((-1.0,),), ()), 0)),
    Case("platen to and fro", SOLVED,
         partial(platen, (((1.0, 0.0),), ((1.0, 0.3), (1.0, -0.3), (1.0, 0.0))), None)),
    Case("platen pushed along", SLIDES, partial(platen, (((1.0, 0.0), (1.0, 0.5)), ()), 0.35)),
    Case("platen pulled off", PULLS, partial(platen, (((1.0, 0.0), (-1.0, 0.0)), ()), None)),
    Case("platen dragged along", SOLVED, dragged),
    *(
        Case(f"flat part of an edge, f = {f:g}", SOLVED, partial(played, scene_of(
            (replace(PRESSED, span=None),), CYCLE,
            contacts=(rf.Contact(friction=f, span=(-0.5, 0.5)),))))
        for f in (0.35, 3.0)
    ),
    *(Case(f"floor and wall, f = {f:g}", f"{SOLVED} or {JUMPS}" if f >= 1.0 else SOLVED,
           partial(walls, f, False)) for f in (0.0, 0.3, 1.0, 2.0)),
    *(Case(f"between two walls, f = {f:g}", SOLVED, partial(walls, f, True))
      for f in (0.1, 1.0)),
    Case("held on its right side", SOLVED, partial(played, scene_of(
        (PRESSED,), CYCLE, supports=(rf.Support("xy", edge="right"),)))),
    Case("sheared, held at a point", SOLVED, partial(played, scene_of(
        (PRESSED, SHEAR), (((1.0, 0.0), (1.0, 0.3)), ((1.0, -0.3), (1.0, 0.3))),
        supports=(HELD,)))),
    Case("sheared to and fro", SOLVED, partial(played, scene_of(
        (PRESSED, rf.Load("t", "top", None, traction=(1.0, 0.0))),
        (((1.0, 0.0), (1.0, 0.1)), ((1.0, -0.1), (1.0, 0.1)))))),
    *(
        Case(f"gap {gap}{', whole' if whole else ''}", SOLVED, partial(gapped, gap, whole, CYCLE))
        for gap in ("0.05*x**2", "1e-14*x**2", "0.01*max(abs(x)-1,0)", "0.1*max(1-abs(x),0)")
        for whole in (False, True)
    ),
    Case("gap 0.05*x**2, unloaded completely", SOLVED,
         partial(gapped, "0.05*x**2", False, TO_ZERO)),
    Case("gap 0.01 everywhere, whole", HOVERS, partial(gapped, 0.01, True, CYCLE)),
    Case("tipped over by its left side", TIPS, partial(overturned,
         rf.Load("l", "left", None, traction=(0.0, 1.0)), 1.0)),
    Case("tipped over by its top", TIPS, partial(overturned,
         rf.Load("l", "top", (1.0, 2.0), pressure=-1.0), 4.0 / 3.5)),
    *(Case(f"two blocks, E_b = {young:g} E_a, f = {f:g}", SOLVED, partial(pair, young, f))
      for young in (1.0, 3.0, 100.0) for f in (0.1, 1.0)),
)  # fmt: skip
