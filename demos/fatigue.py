"""Fatigue parameters at the edges of two cylinders sheared to and fro in partial slip.

**Problem.** Cylinders are pressed together and sheared between 0.6 f P and -0.6 f P, as in
``half_planes.py``. Cracks begin at the trailing edge of the contact: where is the parameter of
Smith, Watson and Topper largest, on which plane, and how well does a mesh know it?

**Equations.** At x = a both tractions vanish, and the stress along the surface goes between plus
and minus 2 f p0 sqrt(U), U = Q / (f P). So the parameter there is

    SWT(a) = (1 - nu^2) (2 f p0)^2 U / E

on the plane perpendicular to the surface. The stress has a cusp at a: errors fall with the square
root of the element size only, so that the elements there are small.

**What to look for.** The largest parameter is within two elements of a, on the perpendicular plane,
below the closed form by less than twice its estimate. The mean over a length changes much less with
the mesh: that is what tests at singular or nearly singular edges are compared by.

The demo shows a probe along a contact edge, and the table [fatigue].
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

SCENE = Path(__file__).with_name("fatigue.toml")
HERTZ = rf.reference.closed_forms.Hertz(force=1.0, radius=100.0, modulus=100.0 / (1.0 - 0.3**2))
F, U = 0.5, 0.6
KNOWN = (1.0 - 0.3**2) * (2.0 * F * HERTZ.p0) ** 2 * U / 200.0
"""Parameter of Smith, Watson and Topper at the edge of the contact."""


def main() -> None:
    """Print the parameter over the size of the elements; assert that of the smallest ones."""
    parser = argparse.ArgumentParser(description="Fatigue parameters.")
    parser.add_argument("--out", default="results/fatigue", help="folder of the figure")
    out = Path(parser.parse_args().out)
    scene = rf.read_scene(SCENE)
    print(f"closed form {KNOWN:.6f} at x = {HERTZ.a:.4f}")
    rows, record = [], None
    for size in (4e-3, 1e-3, 2.5e-4):
        places = tuple(replace(place, size=size) for place in scene.mesh.refine or ())
        record = rf.run(replace(scene, mesh=replace(scene.mesh, refine=places)))
        if record is None:  # on the other ranks
            continue
        row = rf.summarise(record)["fatigue"]["parameters"]["swt"]
        rows.append((row["max"] / KNOWN - 1.0, row["averaged"]))
        print(
            f"elements of {size:g}: {row['max']:.6f} ({rows[-1][0]:+.1%}) at x = {row['x']:.4f}, "
            f"mean over 0.05 {row['averaged']:.6f}"
        )
    if record is None:
        return
    off, mean = np.array(rows).T
    assert abs(abs(row["x"]) - HERTZ.a) < 2e-3 and min(row["angle"], 180.0 - row["angle"]) < 3.0
    assert -0.03 < off[-1] < 0.0, "the parameter at the edge is more than 3 % off"
    assert np.all(off[:-1] / off[1:] > 1.5), "it does not come nearer as the elements are smaller"
    assert np.ptp(mean) < 0.01 * mean[-1], "the mean depends on the mesh"
    out.mkdir(parents=True, exist_ok=True)
    rf.figures.fatigue_along(record, "edge").savefig(out / "fatigue.png")


if __name__ == "__main__":
    main()
