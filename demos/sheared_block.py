"""A block held by a platen, sheared to and fro, and under a polygon of two loads out of phase.

You will see hysteresis loops, and for each history the dissipation of its steady cycle beside the
area of the loops: the work of the loads on their own displacements, found without any look at the
contact. The demo shows how to

* load one platen by several resultant forces and drive each by a column of a table;
* close the table to a polygon, and run it the other way round by an override;
* read the loops of a cycle from a record.

Sheared to and fro under constant pressure the block comes back to its place. When the pressure
is low on the way back and high on the way forth, it walks: every cycle moves all of it by the same
small step, and by the opposite one when the polygon is run through the other way.
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
"""Error of the loops' area that the samples leave: the path is bent between two of them."""


def numbers(record: rf.Record) -> tuple[float, float, float]:
    """Steady dissipation, loop area over it, and the step of the block in the last cycle."""
    D = record.cycles.dissipation
    area = rf.loop_of(record, len(D)).area().sum() / D[-1]
    return float(D[-1]), float(area), float(record.cycles.slip_increment[-1].mean())


def main() -> None:
    """Run the three histories; the folder given by --out holds their loops and pictures."""
    parser = argparse.ArgumentParser(description="Histories in two loads.")
    parser.add_argument("--out", default="results/sheared_block", help="folder for what is found")
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
