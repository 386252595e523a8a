"""Press fit: assembly by interference, press-out force, and a taper that locks.

**Problem.** A shaft is fitted into a hub with the interference delta of the radius, pushed through
the hub until it slides, and pulled back. Then a plug is pushed into a tapered hole, and the push
taken off.

**Equations.** Of a solid shaft of radius R in an equally long hub of the outer radius C, both of
one material, without friction, the pressure is Lame's at every point,

    p = E delta / (2 R) (1 - R^2 / C^2).

In the middle of a long fit with friction both have one axial strain and no axial force together:
sigma_z is -2 nu p in the shaft and 2 nu p R^2 / (C^2 - R^2) in the hub, the axial strain is zero,
and the pressure is higher by 1 / (1 - nu^2). When all of the fit of length L slides, the force is
f p 2 pi R L with the mean pressure, which pushing raises, as it thickens the shaft, and pulling
lowers. A taper of angle alpha that slides takes N (sin alpha + f cos alpha) inwards, and
N (f cos alpha - sin alpha) outwards: it locks where f > tan alpha, and the two forces of a rigid
one have the ratio (f - tan alpha) / (f + tan alpha).

**What to look for.** Lame's pressure at every node; the middle of a long fit; the force to push the
shaft out against f p 2 pi R L by Lame's p: ends and Poisson's effect count up to 9 percent. Without
a push, a taper below the angle of friction keeps its pressure; a steeper one keeps none.

The demo shows an interference, a fit on a .geo file with parameters, and forces of a driven edge.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

SCENE = Path(__file__).with_suffix(".toml")
R, C, YOUNG, NU, F, DEPTH = 20.0, 40.0, 210000.0, 0.3, 0.15, 0.02
LAME = YOUNG * DEPTH / (2.0 * R) * (1.0 - R**2 / C**2)


def scene_of(elements: int, **parameters: float) -> rf.Scene:
    """Return the scene with parameters of the .geo file."""
    changes = [f"mesh.contact_elements={elements}"]
    for key, value in parameters.items():
        changes += [f"body.{body}.parameters.{key}={value}" for body in ("shaft", "hub")]
    return rf.read_scene(SCENE, changes)


def fitted(elements: int, length: float, overhang: float) -> None:
    """Print pressures and forces of a fit; assert what closed forms say."""
    scene = scene_of(elements, length=length, overhang=overhang)
    stroke = (length / 40.0) ** 2  # longer fits slide later
    history = replace(scene.history, maximum=stroke, minimum=-stroke)
    record = rf.run(replace(scene, history=history))
    if record is None:
        return
    table = record.turning_points
    mean = table.P.sum(axis=1) / record.weight.sum()
    middle = np.interp(0.0, record.x, table.p[0]) / LAME
    force = table.load_displacement[:, 0] / 0.06  # work over the stroke of the scene
    area = 2.0 * np.pi * R * length
    print(
        f"  {length / R:4.1f}  {overhang / R:8.1f}  {mean[0] / LAME:9.4f}  {middle:8.4f}  "
        f"{force[1] / (F * LAME * area):12.4f}  {-force[2] / (F * LAME * area):12.4f}  "
        f"{record.cycles.dissipation[-1]:11.4g}"
    )
    sliding = F * mean[1:3] * area * [1.0, -1.0]
    assert np.allclose(force[1:3], sliding, rtol=1e-9), "all of the fit slides"
    assert length < 12.0 * R or abs(middle * (1.0 - NU**2) - 1.0) < 1e-3
    assert record.energy_error_max < 1e-10


def pressed(taper: float) -> None:
    """Print the forces of a taper pushed in and drawn back, and what it keeps; assert that."""
    scene = scene_of(40, taper=taper)
    scene = replace(
        scene,
        contacts=(replace(scene.contacts[0], interference=None),),
        loads=(rf.Load("push", "shaft.high", platen=True, displacement=(0.0, -0.3)),),
        supports=(rf.Support("y", edge="hub.bed"),),
        history=rf.HistoryOptions(kind="table", columns=("push",), rows=((1.0,), (0.0,))),
        output=rf.OutputOptions(samples_per_leg=400),
    )
    record = rf.run(scene)
    if record is None:
        return
    table = record.samples
    top = int(np.argmax(table.load[:, 0]))
    N = table.P.sum(axis=1)
    force = table.load_displacement[:, 0] / 0.3
    out = max(-force[top:].min(), 0.0)
    free = N[top + int(np.argmax(np.append(force[top:-1] <= 1e-9 * force[top], True)))]
    rigid, ratio = max(F - taper, 0.0) / (F + taper), out / force[top]
    print(f"  {taper:5.2f}  {force[top]:9.0f}  {ratio:9.3f}  {rigid:5.3f}  {free / N[top]:z6.3f}")
    sliding = N[top] * (taper + F) / np.hypot(1.0, taper)
    assert abs(force[top] / sliding - 1.0) < 1e-9
    assert (free > 0.5 * N[top]) == (taper < F), "it locks below the angle of friction"


def main() -> None:
    """Print two tables."""
    scene = scene_of(20, overhang=0.0)
    smooth = tuple(replace(contact, friction=0.0) for contact in scene.contacts)
    once = rf.HistoryOptions(kind="monotonic", load="push")
    record = rf.run(replace(scene, contacts=smooth, history=once))
    if record is not None:
        error = np.abs(record.turning_points.p[0] / LAME - 1.0).max()
        print(f"equally long, no friction: {LAME:g} MPa (Lame) within {error:.1e} at every node")
        assert error < 2e-3
    print(f"f = {F:g}, pressures and forces over those of Lame's pressure")
    print("   L/R  overhang  mean p     middle        push out     pull back     loss of a cycle")
    for elements, length, overhang in ((40, 40.0, 0.0), (40, 40.0, 20.0), (80, 240.0, 20.0)):
        fitted(elements, length, overhang)
    print(f"in the middle of a long fit: {1.0 / (1.0 - NU**2):.4f}")
    print(f"taper pushed in by 0.3 mm, f = {F:g}")
    print("  tan a    push, N  pull/push  rigid  N left without force, over N")
    for taper in (0.05, 0.10, 0.14, 0.16, 0.20):
        pressed(taper)


if __name__ == "__main__":
    main()
