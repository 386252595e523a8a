"""Cylinders in contact as half-planes without a mesh, of equal and of different materials.

**Problem.** Two cylinders are pressed together by P and sheared by Q between 0.6 f P and -0.6 f P.
Large bodies are half-planes: their contact stiffness is Flamant's solution, and nothing is meshed.

**Equations.** Equal materials: Dundurs' beta = 0, and the dissipation per cycle is Cattaneo's and
Mindlin's, with U = Q / (f P),

    D = f^2 P^2 / (pi E*) [4 (1 - U) ln(1 - U) + 4 U - 2 U^2].

Different materials: pressing alone makes the surfaces slip, and the stick zone has the same share
c / a of the contact as below a flat punch (Spence), whatever the load. A half-plane of Poisson's
ratio 0 on a nearly rigid one has beta = 1 / 2.

**What to look for.** The error of D against the seconds; c / a of Spence's problem; blocks with a
mesh come near the same D as they grow.

The demo shows the shape "half-plane", its far field, and a change of one body's material.
"""

import time
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
SCENE, BLOCKS = HERE / "half_planes.toml", HERE / "cattaneo_mindlin.toml"
E_STAR, F, U = 0.5 * 200.0 / (1.0 - 0.3**2), 0.5, 0.6
KNOWN = F**2 / (np.pi * E_STAR) * (4.0 * (1.0 - U) * np.log(1.0 - U) + 4.0 * U - 2.0 * U**2)
"""Dissipation per cycle for P = 1."""
SPENCE = rf.reference.closed_forms.PUNCH_STICK["plane strain"][0.0, F]
"""c / a at beta = 1 / 2, f = 0.5."""


def error_and_seconds(scene: rf.Scene) -> tuple[float, float]:
    """Return the error of D and the seconds of a run; NaN on ranks without the record."""
    begin = time.process_time()
    record = rf.run(scene)
    spent = time.process_time() - begin
    return (np.nan if record is None else record.cycles.dissipation[-1] / KNOWN - 1.0), spent


def main() -> None:
    """Print the table; assert D within 1e-4 at 161 nodes, and Spence's c / a."""
    rf.run(rf.read_scene(SCENE))  # loads what the first run needs
    for elements in (80, 160, 320):
        scene = rf.read_scene(SCENE, [f"mesh.contact_elements={elements}"])
        error, spent = error_and_seconds(scene)
        if np.isfinite(error):
            print(f"half-planes, {elements + 1:3d} nodes: error of D {error:+.1e}, {spent:.2f} s")
            assert elements != 160 or abs(error) < 1e-4
    for size in (15.0, 30.0):
        changes = [f"body.{name}.parameters.size={size}" for name in ("upper", "lower")]
        error, spent = error_and_seconds(rf.read_scene(BLOCKS, changes))
        if np.isfinite(error):
            print(f"blocks of size {size:g}, 481 nodes: error of D {error:+.1e}, {spent:.2f} s")
    changes = ["material.upper.poisson=0.0", "material.lower.young=2e9"]
    record = rf.run(rf.read_scene(SCENE, changes))
    if record is None:
        return
    state = record.turning_points.state[0]
    stick = np.abs(record.x[state == rf.State.STICK]).max()
    touching = np.abs(record.x[state != rf.State.SEPARATION]).max()
    print(f"beta = 1/2: c / a = {stick / touching:.3f} (Spence {SPENCE:.3f})")
    assert abs(stick / touching - SPENCE) < 1.5 * (record.x[1] - record.x[0]) / touching


if __name__ == "__main__":
    main()
