"""Block on a platen under two loads: hysteresis loops, and a block that walks.

**Problem.** A block is held by a platen that carries a normal force P and a shear force Q. Three
histories: Q to and fro at constant P; a polygon of P and Q out of phase; the same polygon run
backwards.

**Equations.** In a steady cycle the dissipation D equals the work of the loads on their own
displacements, the area of the hysteresis loops, which needs no look at the contact:

    D = - integral of Q dv over the contact = sum over loads of integral of lambda dU.

**What to look for.** The area over D is 1 to the error of sampling. Under constant pressure the
block returns to its place. When P is low on the way back and high on the way forth it walks: each
cycle moves it by the same small step, and by the opposite step when the polygon is run backwards.

The demo shows how to load a platen by several forces, drive each by a column of a table, reverse
the table by an override, and evaluate the loops of a cycle.
"""

import argparse
from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
BACKWARDS = "history.cycle_rows=[[2.0, 0.0], [1.0, -0.98], [0.4, 0.0], [1.0, 0.98]]"
RUNS = {
    "to and fro": ("sheared_block", ()),
    "polygon": ("sheared_polygon", ()),
    "polygon, backwards": ("sheared_polygon", (BACKWARDS,)),
}
"""Scene file and overrides of each history."""
AREA_TOLERANCE = 1e-3
"""Relative error allowed of the loops' area: samples are joined by straight lines."""


def numbers(record: rf.Record) -> tuple[float, float, float]:
    """Return steady dissipation, loop area over it, and the step of the last cycle."""
    D = record.cycles.dissipation
    area = rf.loop_of(record, len(D)).area().sum() / D[-1]
    return float(D[-1]), float(area), float(record.cycles.slip_increment[-1].mean())


def main() -> None:
    """Run the three histories; write loops and pictures into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Histories in two loads.")
    parser.add_argument("--out", default="results/sheared_block", help="folder of the results")
    parser.add_argument("--no-pictures", action="store_true", help="only the numbers")
    options = parser.parse_args()
    root = MPI.COMM_WORLD.rank == 0
    found: dict[str, tuple[float, float, float]] = {}
    if root:
        print("history             cycles  kind         dissipation  loops' area  step a cycle")
    for name, (file, overrides) in RUNS.items():
        scene = rf.read_scene(HERE / f"{file}.toml", overrides)
        folder = Path(options.out) / name.replace(", ", "_").replace(" ", "_")
        chosen = rf.RunOptions(overwrite=True, pictures=not options.no_pictures)
        record = rf.run(scene, folder, chosen)
        if record is None:
            continue
        found[name] = D, area, step = numbers(record)
        kind, cycles = record.steady.kind, len(record.cycles.dissipation)
        print(f"{name:18}  {cycles:6d}  {kind:11}  {D:11.4e}  {area:11.6f}  {step:12.2e}")
    if not root:
        return
    print(f"the loops are in {options.out}/*/figures")
    for name, (_, area, _) in found.items():
        assert abs(area - 1.0) < AREA_TOLERANCE, f"{name}: the loops' area is {area} of D"
    steps = np.array([step for _, _, step in found.values()])
    assert abs(steps[0]) < 1e-6 * abs(steps[1]), f"it walks by {steps[0]} under constant pressure"
    assert abs(steps[1] + steps[2]) < 1e-6 * abs(steps[1]), f"steps {steps[1]} and {steps[2]}"


if __name__ == "__main__":
    main()
