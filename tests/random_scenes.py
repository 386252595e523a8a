"""Random scenes of one to three rectangles, and the same scenes written otherwise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import receding_fenicsx as rf


def random_scene(seed: int) -> rf.Scene:
    """A pile of rectangles that are pressed by the load "p" and moved to and fro by "q"."""
    rng = np.random.default_rng(seed)

    def chance(probability: float) -> bool:
        return bool(rng.random() < probability)

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(*values: Any) -> Any:
        return values[rng.integers(len(values))]

    ring, count = chance(0.2), one_of(1, 2, 2, 3)
    kinematics = "axisymmetric" if ring else one_of("plane strain", "plane stress")
    bodies: list[rf.Body] = []
    middle, width, y = 0.0, one_of(2.0, 3.0, 4.0), 0.0
    for k in range(count):
        name = f"b{k}" if count > 1 else ""
        bodies.append(rf.Body(name, width=width, height=one_of(0.5, 0.75), position=(middle, y)))
        y += bodies[-1].height
        if width > 2.0 and chance(0.5):
            width, middle = width - 1.0, middle + (0.0 if ring else one_of(0.0, -0.25, 0.5))

    def edge(body: int, side: str) -> str:
        return f"b{body}.{side}" if count > 1 else side

    def material(name: str) -> rf.Material:
        return rf.Material(between(0.5, 3.0), between(0.0, 0.45), kinematics, name)

    def joint(k: int) -> rf.Contact | rf.Tie:
        against = edge(k - 1, "top") if k else None
        if k > first and chance(0.3):
            return rf.Tie(edge(k, "bottom"), against=against)
        frictions: list[Any] = [between(0.1, 0.8), "0.35 + 0.1*x"]
        frictions += [{"forward": between(0.1, 0.8), "backward": "0.3 + 0.05*x**2"}]
        choices: list[dict[str, Any]] = [
            *({}, {"initial_gap": "0.01*x**2"}, {"cohesion": 0.05}, {"shear_limit": 0.2}),
            {"initial_gap": {"x": [-1.0, 0.0, 0.5], "value": [0.01, 0.0, 0.004]}},
        ]
        choices += [{"interference": 0.003}] if k and not grounded else []
        parts = choices[rng.integers(2 if ring else len(choices))]
        friction = frictions[0] if ring else one_of(*frictions)
        return rf.Contact(edge(k, "bottom"), friction=friction, against=against, **parts)

    grounded = count == 1 or chance(0.6)
    first = 0 if grounded else 1
    joints = [joint(k) for k in range(first, count)]

    top, wide = count - 1, bodies[-1].width
    over, on = edge(top, "top"), bodies[-1].name or None
    side = edge(top, "right" if ring else one_of("left", "right"))
    span = None if ring or count > 1 else (-wide / 4, wide / 4)
    presses = [
        rf.Load("p", over, span, pressure=1.0),
        rf.Load("p", over, pressure=1.0 if ring else "1 + 0.2*x"),
        rf.Load("p", over, platen=True, force=(0.0, -wide)),
        rf.Load("p", over, displacement=("free", -0.05)),
    ]
    press = one_of(*presses)
    drives = [
        rf.Load("q", body=on, thermal_strain="0.01 + 0.004*x**2 - 0.002*y"),
        rf.Load("q", body=on, body_force=("0.1*x", 0.0 if ring else "-0.1 - 0.02*x")),
        rf.Load("q", side, pressure=between(0.05, 0.3)),
        rf.Load("q", side, traction=(between(-0.2, 0.2), "0.05 + 0.01*y")),
    ]
    drive = one_of(*drives[: 3 if ring else 4])
    if press.platen and not ring and chance(0.5):
        drive = rf.Load("q", over, platen=True, force=(between(0.1, 0.3) * wide, 0.0))

    supports, springs, bolts = [], [], []
    if not grounded:
        fix = "y" if ring else one_of("xy", "y")
        supports = [rf.Support(fix, edge=edge(0, "bottom"))]
        if fix == "y" and not ring:
            springs = [rf.Spring(edge(0, "left"), (-0.25, 0.25), 0.5)]
        if chance(0.6):
            spans: Any = (
                {} if ring else {"head_span": (-wide / 4, 0.0), "nut_span": (0.0, wide / 4)}
            )
            tight = one_of({"shortening": 0.05}, {"preload": 0.02})
            bolts = [rf.Bolt("b", over, edge(0, "bottom"), stiffness=0.3, **spans, **tight)]
    if chance(0.3):
        springs += [rf.Spring(side, None, 0.1, 0.05)]
    if chance(0.3) and not ring:
        corner = (bodies[-1].position[0] + wide / 2, y)
        springs += [rf.Spring(point=corner, body=on, x=0.05, y=0.02)]

    loop = ((between(0.5, 1.0), between(-1.0, 0.0)), (1.0, 1.0))
    harmonic = {"p": rf.Harmonic(1.0, 0.2), "q": rf.Harmonic(0.0, 0.7, one_of(0.0, 45.0, 90.0))}
    rows = ((1.0, 0.0), (1.0, 1.0))
    history: rf.HistoryOptions = one_of(
        *2 * [rf.HistoryOptions("table", columns=("p", "q"), rows=rows, cycle_rows=loop, cycles=2)],
        rf.HistoryOptions("cyclic", "q", minimum=between(-1, 0.5), cycles=2, constant={"p": 1.0}),
        rf.HistoryOptions("harmonic", corners=8, cycles=1, harmonic=harmonic),
    )
    unlike = count > 1 and chance(0.4)
    probed = bodies[rng.integers(count)]
    off = 0.15 if ring else 0.17
    x, y = probed.position
    point = (x + off * probed.width, y + 0.4 * probed.height)
    return rf.Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        material=rf.Material(kinematics=kinematics) if unlike else material(""),
        materials=tuple(material(b.name) for b in bodies) if unlike else (),
        mesh=rf.MeshOptions(
            one_of(8, 12, 16), one_of("triangle", "quadrilateral"), one_of(1, 2), 1.5
        ),
        contacts=tuple(each for each in joints if isinstance(each, rf.Contact)),
        ties=tuple(each for each in joints if isinstance(each, rf.Tie)),
        loads=(press, drive),
        supports=tuple(supports),
        springs=tuple(springs),
        bolts=tuple(bolts),
        history=history,
        probes=(rf.Probe("s", point, body=probed.name or None),),
        output=rf.OutputOptions(3, "all"),
    )


def rewritten(scene: rf.Scene) -> rf.Scene:
    """Other names, tables in another order, legs of two halves, twice "q" by half its factor."""
    text = rf.to_toml(scene)
    for k, body in enumerate(scene.bodies if scene.others else ()):
        for form in ('"%s.', '"%s"', "[material.%s]"):
            text = text.replace(form % body.name, form % f"z{len(scene.others) - k}")
    scene = rf.from_toml(text)
    history = scene.history
    press, drive = scene.loads
    twice = {
        key: doubled(getattr(drive, key))
        for key in ("pressure", "traction", "body_force", "thermal_strain", "force")
        if getattr(drive, key) is not None
    }
    if history.kind == "table":

        def cut(*rows: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
            ends = np.array(rows)
            middles = 0.5 * (ends[:-1] + ends[1:])
            pieces = np.stack([middles, ends[1:]], 1).reshape(-1, 2) * [1.0, 0.5]
            return tuple(map(tuple, pieces[:, ::-1].tolist()))

        rows, loop = cut((0.0, 0.0), *history.rows), cut(history.rows[-1], *history.cycle_rows)
        history = replace(history, columns=("q", "p"), rows=rows, cycle_rows=loop)
    elif history.kind == "cyclic":
        history = replace(history, maximum=0.5, minimum=0.5 * history.minimum)
    else:
        half = replace(history.harmonic["q"], amplitude=0.5 * history.harmonic["q"].amplitude)
        history = replace(history, harmonic=history.harmonic | {"q": half})
    # a harmonic cycle begins where its first load is largest
    loads = (press, replace(drive, **twice))
    return replace(
        scene,
        body=scene.bodies[-1],
        others=scene.bodies[-2::-1] if scene.others else (),
        loads=loads if history.kind == "harmonic" else loads[::-1],
        history=history,
        **{k: getattr(scene, k)[::-1] for k in ("materials", "ties", "supports", "springs")},
    )


def doubled(value: Any) -> Any:
    """Twice a number, a profile or a vector of them."""
    if isinstance(value, tuple):
        return tuple(doubled(part) for part in value)
    return f"2*({value})" if isinstance(value, str) else 2.0 * value
