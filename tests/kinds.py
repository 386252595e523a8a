"""A small scene of every kind."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bodies import block

import receding_fenicsx as rf

CYCLE = rf.HistoryOptions("cyclic", load="T", minimum=-1.0, cycles=2, constant={"P": 1.0})
PRESS = rf.Load("P", "top", pressure=0.2)
PROBES = (
    rf.Probe("s", points=((-0.75, 0.4), (0.3, 0.25), (1.1, 0.75))),
    rf.Probe("e", edge="bottom"),
)
CRACKED: Any = {
    "probes": (*PROBES, rf.Probe("c", segment=((0.6, 0.0), (0.4, 0.6)), count=6)),
    "fatigue": rf.FatigueOptions(yield_stress=0.5, threshold=0.02, fatigue_limit=0.05),
}


OUTWARD: Any = {"forward": "0.2 + 0.05*x", "backward": "0.2 - 0.05*x"}
UNLIKE: Any = {"forward": 0.25, "backward": "0.3 + 0.05*x"}


def simple(*loads: rf.Load, **parts: Any) -> rf.Scene:
    """A block under a constant pressure, and loads to and fro."""
    chosen: dict[str, Any] = {"contacts": (rf.Contact(friction=0.3),), "probes": PROBES}
    chosen |= {"history": CYCLE, "loads": (PRESS, *loads), "degree": 2, "elements": 8}
    return block(**(chosen | parts))


def pair(*loads: rf.Load, **parts: Any) -> rf.Scene:
    """A layer of other material on a wider one that is held."""
    bodies: tuple[rf.Body, ...] = (rf.Body("a", width=4.0, height=0.5, position=(0.0, 0.75)),)
    bodies += (rf.Body("b", width=6.0, height=0.75),)
    given: dict[str, Any] = {
        "body": bodies[0],
        "others": bodies[1:],
        "materials": (rf.Material(3.0, 0.2, name="b"),),
        "contacts": (rf.Contact("a.bottom", friction=0.3, against="b.top"),),
        "supports": (rf.Support("xy", edge="b.bottom"),),
        "loads": (replace(PRESS, edge="a.top"), *loads),
        "probes": (rf.Probe("s", points=((0.25, 0.4),), body="b"),),
        "degree": 1,
    }
    return simple(**(given | parts))


EVEN: dict[str, rf.Scene] = {
    "traction": simple(
        rf.Load("T", "top", (-1.0, 1.0), traction=("0.3*x", "0.25 - 0.05*x**2")), **CRACKED
    ),
    "gap": simple(
        rf.Load("T", "top", (-1.0, 1.0), traction=("0.1*x", 0.15)),
        contacts=(
            rf.Contact(span=(-1.5, 1.5), friction="0.3 + 0.1*x**2", initial_gap="0.01*x**2"),
        ),
    ),
    "limits": simple(
        rf.Load("T", "top", (-1.0, 1.0), traction=("0.1*x", 0.0)),
        contacts=(rf.Contact(friction=0.3, cohesion=0.01, shear_limit="0.05 - 0.005*x**2"),),
    ),
    "directions": simple(
        rf.Load("T", "top", (-1.0, 1.0), traction=("0.05*x", "0.2 - 0.05*x**2")),
        contacts=(rf.Contact(friction=OUTWARD),),
        history=replace(CYCLE, initial_slip="0.01*x"),
    ),
    "displacement": simple(
        rf.Load("T", "top", (-1.0, 1.0), displacement=("0.02*x", "free")),
        loads=(
            rf.Load("P", body_force=(0.0, -0.2)),
            rf.Load("T", "top", (-1.0, 1.0), displacement=("0.4*x", "0.02*(2 - x**2)")),
        ),
    ),
    "platen": simple(
        loads=(
            rf.Load("P", "top", platen=True, force=(0.0, -0.6)),
            rf.Load("T", body_force=("0.2*x", 0.0)),
        ),
    ),
    "heat": simple(rf.Load("T", thermal_strain="0.02*(1 + x**2)*(2 - y)")),
    "body force": simple(rf.Load("T", body_force=("0.2*x", "0.03*y"))),
    "interference": simple(
        loads=(rf.Load("T", "top", (-1.0, 1.0), traction=("0.06*x", 0.0)),),
        contacts=(rf.Contact(friction=0.3, interference="0.01*(1 - 0.1*x**2)"),),
        supports=(rf.Support("y", edge="top"),),
        history=replace(CYCLE, constant={}),
    ),
    "moved gap": simple(
        loads=(rf.Load("P", "top", pressure=0.2), rf.Load("T", "bottom", gap="0.02*(1 + x**2)")),
    ),
    "springs": simple(
        rf.Load("T", "top", (-1.0, 1.0), traction=("0.3*x", 0.3)),
        springs=(
            rf.Spring("top", (-1.0, 1.0), 0.2, 0.1),
            *(rf.Spring(edge, (0.0, 0.5), 0.3) for edge in ("left", "right")),
        ),
    ),
    "two edges": simple(
        rf.Load("T", "bottom", (-0.5, 0.5), traction=("0.04*x", -0.02)),
        contacts=(
            rf.Contact(span=(-2.0, -1.0), friction=0.3),
            rf.Contact(span=(1.0, 2.0), friction=0.3),
        ),
    ),
    "above and below": simple(
        loads=(
            rf.Load("P", body_force=(0.0, -0.2)),
            rf.Load("T", thermal_strain="0.02*(1 + x**2)*(2 - y)"),
        ),
        contacts=(rf.Contact(friction=0.3), rf.Contact("top", (-0.5, 0.5), initial_gap=0.01)),
    ),
    "pair": pair(rf.Load("T", "a.top", (-1.0, 1.0), traction=("0.2*x", 0.2))),
    "stack": pair(
        rf.Load("T", "a.top", (-1.0, 1.0), traction=("0.3*x", 0.2)),
        supports=(),
        contacts=(
            rf.Contact("a.bottom", friction=0.3, against="b.top"),
            rf.Contact("b.bottom", friction=0.2),
        ),
    ),
    "cylinder": simple(
        rf.Load("T", "top", (0.0, 1.0), traction=("0.3*x", -0.3)),
        material=rf.Material(2.0, 0.3, "axisymmetric"),
        springs=(rf.Spring("top", (0.0, 1.0), 0.2, 0.1),),
        degree=1,
        probes=(replace(PROBES[0], points=((0.3, 0.25), (1.1, 0.75))), PROBES[1]),
        fatigue=rf.FatigueOptions(yield_stress=0.5),
    ),
}
"""Scenes of which half is modelled, or a section from the axis."""

SIDE = rf.Load("T", "right", (0.0, 0.5), traction=(0.08, 0.01))
UNEVEN: dict[str, rf.Scene] = {
    "shear": simple(
        SIDE,
        **CRACKED,
        loads=(replace(PRESS, pressure={"x": [-2.0, 0.5, 2.0], "value": [0.1, 0.3, 0.2]}), SIDE),
        contacts=(
            rf.Contact(
                span=(-2.0, 1.5),
                friction=UNLIKE,
                initial_gap={"x": [-2.0, 0.0, 1.5], "value": [0.01, 0.0, 0.02]},
            ),
        ),
    ),
    "slipped": simple(
        replace(SIDE, edge="left"), history=replace(CYCLE, initial_slip="0.02*(1 + x)*x")
    ),
    "rig": simple(
        loads=(
            rf.Load("P", "top", platen=True, force=(0.01, -0.6)),
            rf.Load("T", "top", platen=True, displacement=(0.3, "free")),
        ),
    ),
    "moved side": simple(rf.Load("T", "left", (0.0, 0.5), displacement=(0.1, "0.02*y"))),
    "weight": simple(
        rf.Load("T", body_force=("0.05 + 0.01*x", "0.02*x")),
        material=rf.Material(2.0, 0.3, "plane stress"),
    ),
    "warm side": simple(rf.Load("T", thermal_strain="0.03*(1 + 0.5*x)*(2 - y)"), degree=1),
    "held": simple(
        rf.Load("T", "top", (0.0, 1.0), traction=(0.2, 0.0)),
        supports=(rf.Support("x", point=(-2.0, 0.5)), rf.Support("y", point=(1.5, 1.0))),
        springs=(rf.Spring("left", (-0.25, 0.25), 0.2, 0.1), rf.Spring(point=(2.0, 1.0), y=0.1)),
        mesh=rf.MeshOptions(
            8, growth=1.3, refine=(rf.Refinement(0.1, 1.0, 1.5), rf.Refinement(0.2))
        ),
    ),
    "pinned": simple(
        SIDE,
        supports=tuple(
            rf.Support(fix, point=(x, 0.0)) for fix, x in (("x", 2.0), ("y", 0.5), ("xy", -1.0))
        ),
    ),
    "driven": pair(
        loads=(rf.Load("T", "a.left", displacement=(0.02, "free")),),
        contacts=(rf.Contact("a.bottom", None, 0.3, 0.0, "b.top", "0.005 + 0.001*x"),),
        supports=(rf.Support("xy", edge="b.bottom"), rf.Support("y", edge="a.top")),
        history=replace(CYCLE, constant={}),
    ),
    "wheel": simple(
        loads=(
            PRESS,
            rf.Load("T", "top", (-0.5, 0.5), pressure="0.3 + 0.1*x", travel=(-1.0, 0.75), steps=3),
        ),
        history=rf.HistoryOptions("travel", cycles=2, constant={"P": 1.0}),
    ),
    "fibres": simple(
        rf.Load("T", "top", (-1.0, 0.5), traction=(0.1, 0.0)),
        material=rf.Material(8.0, 0.25, "plane stress", young_2=2.0, shear=0.7, angle=30.0),
    ),
    "bolts": pair(
        rf.Load("T", "a.left", traction=(0.02, 0.0)),
        bolts=(
            rf.Bolt("one", "a.top", "b.bottom", 0.02, (-1.0, 0.0), (-1.5, 0.0), stiffness=2.0),
            rf.Bolt("two", "a.top", "b.bottom", None, (0.5, 1.5), (0.0, 1.5), preload=0.01),
        ),
        loads=(rf.Load("T", "a.left", traction=(0.006, 0.0)),),
        supports=(rf.Support("xy", edge="b.right"),),
        history=replace(CYCLE, constant={}),
    ),
    "between bodies": pair(
        rf.Load("T", "a.bottom", (1.0, 2.0), platen=True, force=(0.08, 0.005)),
        springs=(rf.Spring("a.bottom", (1.0, 2.0), 0.4, 0.3, against="b.top"),),
        contacts=(rf.Contact("a.bottom", (-2.0, 0.5), friction=0.3, against="b.top"),),
    ),
    "tied": pair(
        rf.Load("T", "a.right", traction=(0.15, 0.01)),
        ties=(rf.Tie("a.bottom", against="b.top"),),
        contacts=(rf.Contact("b.bottom", friction=0.2),),
        supports=(),
    ),
    "half-planes": rf.Scene(
        body=rf.Body("a", shape="half-plane", width=2.5),
        others=(rf.Body("b", shape="half-plane", width=2.5),),
        material=rf.Material(200.0, 0.3),
        materials=(rf.Material(100.0, 0.2, name="b"),),
        mesh=rf.MeshOptions(20, refine=(rf.Refinement(0.05, 0.6),)),
        contacts=(rf.Contact("a.bottom", None, 0.4, "x**2/200", "b.top"),),
        loads=(
            rf.Load("P", "a.far", platen=True, force=(0.0, -1.0)),
            rf.Load("T", "a.far", platen=True, force=(0.2, 0.0)),
            rf.Load("S", "b.far", tension=0.5),
        ),
        supports=(rf.Support("xy", edge="b.far"),),
        history=replace(CYCLE, constant={"P": 1.0, "S": 1.0}),
        probes=(rf.Probe("s", points=((0.3, -0.4), (-0.2, -0.7)), body="b"),),
    ),
}
