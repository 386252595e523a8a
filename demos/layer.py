"""An elastic layer on an elastic half-plane, without friction, over ratios of their moduli.

You will see the half width of the contact for layers stiffer than, as stiff as and softer than the
half-plane, against a singular integral equation (and the values in reference.py that it
reproduces). It depends on Dundurs' alpha only: a pair with other Poisson's ratios and the same
alpha touches over the same width. A half-disc of radius R stands for the half-plane, loaded on its
arc as a half-plane would be: three radii show that what is left of the truncation is far below the
error of the mesh.

The demo shows how to put two bodies together, one of them from a .geo file: the contact nodes must
match, and the parts of one load on both bodies must balance.
"""

from pathlib import Path

from mpi4py import MPI

import receding_fenicsx as rf

HERE = Path(__file__).parent
ALPHAS = (0.8, 0.5, 0.0, -0.5)
"""(E'_base - E'_layer) / (E'_base + E'_layer), E' = E / (1 - nu^2)."""
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
    """Half width of the contact below node spacing."""
    return float(rf.half_width_estimates(record, -1)["contact_half_width_estimate"]["value"])


def main() -> None:
    """Print the table; assert the half widths, and that they depend on alpha only."""
    root = MPI.COMM_WORLD.rank == 0
    if root:
        print("contact half width over h under a uniform pressure on |x| < h/2, frictionless")
        print(
            "alpha" + "".join(f"   R = {r:2.0f} h" for r in RADII) + "  other nu     known  error"
        )
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
