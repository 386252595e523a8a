"""Two elastic layers on a rigid plane: double receding contact.

**Problem.** A layer of height h rests on a second one of height h_2, and this one on a rigid plane,
under a uniform pressure on |x| < h/2 of the upper layer. Both contacts recede: the layers lift off
each other beyond |x| = c, and the lower one off the plane beyond c_2, at any load.

**Equations.** With E' = E / (1 - nu^2) and r = E'_upper / E'_lower, c / h and c_2 / h depend on r
and h_2 / h only. Without friction they follow from two singular integral equations, one for the
pressure in each contact (``rf.reference.layer``), which take no mesh.

**What to look for.** Both half widths of the finite elements against those of the integral
equations. Friction widens both contacts on loading; the work that it dissipates in a cycle is the
work of the load, to round-off.

The demo shows how to stack bodies: a contact with ``against`` lies between two bodies, one without
it on a rigid plane.
"""

from pathlib import Path

from mpi4py import MPI

import receding_fenicsx as rf

HERE = Path(__file__).parent
CASES = ((1.0, 1.0), (4.0, 1.0), (0.25, 1.0), (1.0, 2.0))
"""r and h_2 / h."""
TOLERANCE = 1e-3
"""Relative error allowed of the half widths."""


def solve(ratio: float, height: float, friction: float, *others: str) -> rf.Record | None:
    """Run the scene with other moduli, height of the lower layer and friction; on rank 0."""
    changes = [
        f"material.lower.young={1.0 / ratio}",
        f"body.lower.height={height}",
        f"body.upper.position=[0.0, {height}]",
        f"contact.1.friction={friction}",
        f"contact.2.friction={friction}",
        *others,
    ]
    return rf.run(rf.read_scene(HERE / "stack.toml", changes))


def half_widths(record: rf.Record) -> list[float]:
    """Return both contact half widths after the first loading, fitted below node spacing."""
    fits = [rf.half_width_estimates(edge, 0) for edge in record.by_edge().values()]
    return [float(fit["contact_half_width_estimate"]["value"]) for fit in fits]


def main() -> None:
    """Print the table; assert the half widths, and the energy balance with friction."""
    root = MPI.COMM_WORLD.rank == 0
    if root:
        print("half widths over h of two layers on a plane, frictionless, and with f = 0.2")
        print("    r  h_2/h        c    known  error      c_2    known  error  with friction")
    for ratio, height in CASES:
        smooth = solve(ratio, height, 0.0, "mesh.contact_elements=256", "history.cycles=1")
        rough = solve(ratio, height, 0.2, "history.cycles=2")
        if smooth is None or rough is None:
            continue
        known = rf.reference.layer.double_half_widths(0.5, ratio, height)
        line = f"{ratio:5.2f}  {height:5.2f}"
        for width, exact in zip(half_widths(smooth), known, strict=True):
            error = abs(width / exact - 1.0)
            line += f"  {width:7.4f}  {exact:7.4f}  {error:.0e}"
            assert error < TOLERANCE, f"half width at r = {ratio}, h_2 = {height} h"
        touching = [
            rf.half_widths(edge, 0)["contact_half_width"] for edge in rough.by_edge().values()
        ]
        print(line, "".join(f" {width:6.3f}" for width in touching))
        assert rough.energy_error_max < 1e-10, "the load's work must be the dissipation"


if __name__ == "__main__":
    main()
