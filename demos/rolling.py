"""Rolling with traction: Carter's creep and stick zone.

**Problem.** Two equal cylinders of half width of contact a are pressed together by P and sheared by
Q = 0.75 f P; then they roll. Surfaces stick in front, and slip behind.

**Equations.** The gap of a parabola that rolls by s, over surfaces whose points stay opposite each
other, is

    (x - s)^2 / 2R = x^2 / 2R - s x / R + s^2 / 2R,

an initial gap, a gap with the load factor s, and a translation, which the free body finds itself.
In the steady state (Carter 1926) the stick zone has the half width a' and touches the front,

    a' = a sqrt(1 - Q / f P),

and the body creeps along the surface by xi = f (a - a') / R of the way.

**What to look for.** The creep and the zone against both formulas, on three meshes.

The demo shows the load ``gap`` and a body without a mesh.
"""

from pathlib import Path

import numpy as np

import receding_fenicsx as rf

SCENE = Path(__file__).with_suffix(".toml")
F, R, A, STICK = 0.3, 100.0, 1.0, 0.5
CREEP = F * (A - STICK) / R


def rolled(elements: int) -> tuple[rf.Record, float, tuple[float, float]] | None:
    """Return the record, the mean creep on the last leg, and the ends of the stick zone."""
    record = rf.run(rf.read_scene(SCENE, [f"mesh.contact_elements={elements}"]))
    if record is None:
        return None
    ends = record.turning_points
    force = 0.75 * F * np.pi * 200.0 / (2.0 * (1.0 - 0.3**2)) / (4.0 * R)
    # displacement along the surface: the conjugate of Q over the force Q
    creep = np.diff(ends.load_displacement[-2:, record.load_names.index("Q")])[0] / force
    stuck = record.x[ends.state[-1] == rf.State.STICK]
    # zones end midway between two nodes
    half = 0.5 * float(record.x[1] - record.x[0])
    return record, float(creep), (stuck[0] - half, stuck[-1] + half)


def main() -> None:
    """Print creep and stick zone on three meshes; assert both."""
    # all ranks run all meshes; rank 0 has the records
    runs = {elements: rolled(elements) for elements in (80, 160, 320)}
    for elements, found in runs.items():
        if found is None:
            return
        record, creep, (back, front) = found
        spacing = float(record.x[1] - record.x[0])
        print(
            f"{elements + 1:3d} nodes: creep {creep:.6e}, Carter {CREEP:.6e}, error "
            f"{creep / CREEP - 1.0:+.1e}; sticks from {back:.3f} to {front:.3f}, Carter 2 to 3"
        )
        assert abs(creep / CREEP - 1.0) < 2e-3
        assert abs(back - 2.0) <= spacing and abs(front - 3.0) <= spacing


if __name__ == "__main__":
    main()
