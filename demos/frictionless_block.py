"""Frictionless receding contact of a block and of long layers on a rigid plane.

**Problem.** A block (width 4h) or a layer (8h wide, in place of an infinite one) of height h lies
on a rigid frictionless plane under a uniform pressure on |x| < b of its top. Its ends lift off; the
half width c of the contact does not depend on the load.

**Equations.** Signorini's conditions at every contact node: gap w >= 0, P >= 0, w P = 0, with the
reactions P = r_star + K w (eq. 11). Known values of c and of the pressure come from boundary
collocation (block) and integral equations (layers); see ``rf.reference.closed_forms``.

**What to look for.** For three refinements each, the relative errors of the pressure at the centre
and of c, with their orders of convergence. The pressure is taken from the mean tractions of the
elements and converges by order 2.5 to 3. The half width is fitted below node spacing, and its
interval must hold the known value; its error is some hundredths of the node spacing and falls, but
not smoothly: it depends on where between two nodes the contact ends.

The demo shows how to change a scene by overrides, run it without files, and evaluate tractions and
half widths between the nodes.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
known_values = rf.reference.closed_forms
Pressed = known_values.Pressed
REFINEMENTS = ((80, 1.4), (160, 1.2), (320, 1.1))
"""Contact elements on a width of 4h, and growth: each halves all sizes of the one before."""
LAYER_WIDTH = 8.0
"""Width over h of the strip in place of an infinite layer: its lifted ends carry no stress."""
PRESSURE_TOLERANCE, WIDTH_TOLERANCE = 5e-5, 1e-3
"""Relative errors allowed at 40 quadratic elements on h: 321 nodes under the block."""


def solve(
    known: Pressed,
    width: float,
    elements: int,
    growth: float,
    *others: str,
) -> rf.Record | None:
    """Run the scene of a known contact, with other changes; the record on rank 0."""
    changes = [
        f"body.width={width}",
        f"mesh.contact_elements={int(elements * width / 4.0)}",
        f"mesh.growth={growth}",
        f"load.p0.span=[{-known.load}, {known.load}]",
        *others,
    ]
    return rf.run(rf.read_scene(HERE / "frictionless_block.toml", changes))


def errors(known: Pressed, record: rf.Record) -> tuple[float, float, float]:
    """Relative errors: pressure at the centre, pressure up to 0.9 c, contact half width."""
    at = np.array(known.x[:-1]) * known.half_width
    p = rf.traction_at(record.x, record.weight, record.turning_points.P[-1], at)
    off = np.abs(p - known.p[:-1]) / known.p[0]
    found = rf.half_width_estimates(record, -1)["contact_half_width_estimate"]
    low, high = found["interval"]
    assert low <= known.half_width <= high, f"{known.half_width} is not in {found['interval']}"
    return float(off[0]), float(off.max()), abs(found["value"] / known.half_width - 1.0)


def main() -> None:
    """Print the tables; assert the errors at 40 elements on h, and the order of convergence."""
    root = MPI.COMM_WORLD.rank == 0
    if root:
        print("  nodes  centre pressure  profile  half width   (relative errors)")
    for known in (known_values.BLOCK, *known_values.LAYERS):
        is_block = known is known_values.BLOCK
        if root:
            name = "block 4h by h" if is_block else "infinite layer"
            print(f"{name}, loaded on |x| < {known.load} h: c = {known.half_width} h")
        table = []
        for elements, growth in REFINEMENTS:
            record = solve(known, 4.0 if is_block else LAYER_WIDTH, elements, growth)
            if record is None:
                continue
            table.append(errors(known, record))
            print("  {:5d}  {:15.1e}  {:7.1e}  {:10.1e}".format(len(record.x), *table[-1]))
        if root:
            (p1, _, c1), (p2, _, c2), (p3, _, c3) = table
            order, order_c = 0.5 * np.log2(p1 / p3), 0.5 * np.log2(c1 / c3)
            print(f"  order of convergence: pressure {order:.1f}, half width {order_c:.1f}")
            assert p2 < PRESSURE_TOLERANCE, "centre pressure"
            assert c2 < WIDTH_TOLERANCE, "half width"
            assert order > 2.0, f"the centre pressure converges by order {order:.1f} only"
            assert c3 < c1, "the half width does not converge"


if __name__ == "__main__":
    main()
