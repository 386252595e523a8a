"""A frictionless block and long layers on a rigid plane, against values found without meshes.

You will see, for three refinements each, the errors of the pressure at the centre and of the
contact half width, and their orders of convergence. The pressure comes from the elements' mean
tractions; the half width is fitted below node spacing, and the interval that goes with it must
hold the known value. The demo shows how to

* change a scene by overrides and run it without files;
* read tractions between the nodes and half widths between them from a record.

The pressure at the centre converges by order 2.5 to 3. The error of the half width is some
hundredths of the node spacing and depends on where between two nodes the contact ends: it falls,
but not smoothly.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
REFINEMENTS = ((80, 1.4), (160, 1.2), (320, 1.1))
"""Contact elements on a width of 4h, and growth: all sizes are halved from one to the next."""
LAYER_WIDTH = 8.0
"""Width over h that stands for an endless layer: the lifted ends are without stress."""
PRESSURE_TOLERANCE, WIDTH_TOLERANCE = 5e-5, 1e-3
"""Relative errors allowed at 40 quadratic elements on h: 321 nodes under the block."""


def solve(
    known: rf.reference.closed_forms.Pressed,
    width: float,
    elements: int,
    growth: float,
    *others: str,
) -> rf.Record | None:
    """Run the scene of a known contact, with other changes; the record on rank 0."""
    scene = rf.read_scene(
        HERE / "frictionless_block.toml",
        [
            f"body.width={width}",
            f"mesh.contact_elements={int(elements * width / 4.0)}",
            f"mesh.growth={growth}",
            f"load.p0.span=[{-known.load}, {known.load}]",
            *others,
        ],
    )
    return rf.run(scene)


def errors(
    known: rf.reference.closed_forms.Pressed, record: rf.Record
) -> tuple[float, float, float]:
    """Relative errors: pressure at the centre, of the profile up to 0.9 c, half width."""
    at = np.array(known.x[:-1]) * known.half_width
    p = rf.traction_at(record.x, record.weight, record.turning_points.P[-1], at)
    off = np.abs(p - known.p[:-1]) / known.p[0]
    found = rf.half_width_estimates(record, -1)["contact_half_width_estimate"]
    low, high = found["interval"]
    assert low <= known.half_width <= high, f"{known.half_width} is not in {found['interval']}"
    return float(off[0]), float(off.max()), abs(found["value"] / known.half_width - 1.0)


def main() -> None:
    """Print the tables; assert the errors at 40 elements on h, and the order."""
    root = MPI.COMM_WORLD.rank == 0
    for known in (rf.reference.closed_forms.BLOCK, *rf.reference.closed_forms.LAYERS):
        width = 4.0 if known is rf.reference.closed_forms.BLOCK else LAYER_WIDTH
        if root:
            name = "block 4h by h" if known is rf.reference.closed_forms.BLOCK else "endless layer"
            print(f"{name}, loaded on |x| < {known.load} h: c = {known.half_width} h")
            print("  nodes  centre pressure  profile  half width   (relative errors)")
        table = []
        for elements, growth in REFINEMENTS:
            record = solve(known, width, elements, growth)
            if record is None:
                continue
            table.append(errors(known, record))
            print("  {:5d}  {:15.1e}  {:7.1e}  {:10.1e}".format(len(record.x), *table[-1]))
        if root:
            order = np.log2(table[0][0] / table[-1][0]) / (len(table) - 1)
            order_c = np.log2(table[0][2] / table[-1][2]) / (len(table) - 1)
            print(f"  order of convergence: pressure {order:.1f}, half width {order_c:.1f}")
            assert table[1][0] < PRESSURE_TOLERANCE, "centre pressure"
            assert table[1][2] < WIDTH_TOLERANCE, "half width"
            assert order > 2.0, f"the centre pressure converges by order {order:.1f} only"
            assert table[-1][2] < table[0][2], "the half width does not converge"


if __name__ == "__main__":
    main()
