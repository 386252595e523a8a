"""Elastic layer on an elastic half-plane, without friction: half width over the modulus ratio.

**Problem.** A layer of height h rests on a half-plane under a uniform pressure on |x| < h/2. It
lifts off beyond the contact half width c. Two elastic bodies, matching nodes.

**Equations.** c depends on Dundurs' alpha only,

    alpha = (E'_base - E'_layer) / (E'_base + E'_layer),   E' = E / (1 - nu^2).

A half-disc of radius R stands for the half-plane. Its arc carries the stresses that a line force
F leaves in a half-plane at the distance R, the pressure 2 F |y| / (pi R^2).

**What to look for.** c for layers stiffer than, as stiff as and softer than the half-plane, against
a singular integral equation; a pair with other Poisson's ratios and the same alpha has the same c;
three radii show that the error of truncation is far below that of the mesh.

The demo shows how to define two bodies, one of them from a .geo file with parameters, and a load
whose parts on both bodies balance.
"""

from pathlib import Path

from mpi4py import MPI

import receding_fenicsx as rf

HERE = Path(__file__).parent
ALPHAS = (0.8, 0.5, 0.0, -0.5)
"""Dundurs' alpha; negative: the layer is stiffer."""
RADII = (10.0, 20.0, 40.0)
"""Radii of the half-disc over h."""
TOLERANCE = 2e-3
"""Relative error allowed of the half width."""


def solve(
    alpha: float, radius: float = 20.0, nu: tuple[float, float] = (0.3, 0.3), *others: str
) -> rf.Record | None:
    """Run the scene with Poisson's ratios of layer and base; the record on rank 0."""
    base = (1.0 + alpha) / (1.0 - alpha) * (1.0 - nu[1] ** 2) / (1.0 - nu[0] ** 2)
    changes = [
        f"body.base.parameters={{radius={radius}, half_width=3.0}}",
        f"material.poisson={nu[0]}",
        f"material.base.young={base}",
        f"material.base.poisson={nu[1]}",
        *others,
    ]
    return rf.run(rf.read_scene(HERE / "layer.toml", changes))


def half_width(record: rf.Record) -> float:
    """Return the contact half width, fitted below node spacing."""
    return float(rf.half_width_estimates(record, -1)["contact_half_width_estimate"]["value"])


def main() -> None:
    """Print the table; assert the half widths, and that they depend on alpha only."""
    root = MPI.COMM_WORLD.rank == 0
    if root:
        print("contact half width over h under a uniform pressure on |x| < h/2, frictionless")
        heads = "".join(f"   R = {r:2.0f} h" for r in RADII)
        print(f"alpha{heads}  other nu     known  error")
    for alpha in ALPHAS:
        records = [solve(alpha, radius) for radius in RADII]
        records.append(solve(alpha, RADII[-1], (0.1, 0.45)))
        widths = [half_width(record) for record in records if record is not None]
        if not root:
            continue
        known = rf.reference.layer.contact_half_width(0.5, (1.0 - alpha) / (1.0 + alpha))
        error = abs(widths[2] / known - 1.0)
        print(f"{alpha:5.2f}" + "".join(f"  {w:9.5f}" for w in [*widths, known]) + f"  {error:.1e}")
        assert error < TOLERANCE, f"half width at alpha = {alpha}"
        assert abs(widths[3] / widths[2] - 1.0) < TOLERANCE, "alpha alone must decide"
        assert abs(widths[2] / widths[1] - 1.0) < 0.5 * TOLERANCE, "truncation"


if __name__ == "__main__":
    main()
