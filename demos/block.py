"""Ahn & Barber's block under cyclic loading: the study of the 2008 paper.

**Problem.** An elastic block of height h and width 4h (nu = 0.3) lies on a rigid plane with
friction f = 0.35. A uniform pressure p0(t) acts on |x| < h of its top: first loading from 0 to the
maximum, then cycles between the maximum and one third of it.

**Equations.** The body is condensed to its contact nodes once. With v, w the tangential and normal
displacements, Q, P the reactions on the body and lambda the load factor,

    [Q; P] = lambda r_star + K [v; w]                                             (eq. 11)

and each node sticks, separates or slips by Coulomb's law |Q| <= f P (eqs. 4 to 10). The exact path
solves this from one change of state to the next; Gauss-Seidel solves it in load steps (section 2).

**What to look for.** Zones that do not depend on the load while it grows; a steady cycle that is
approached slowly; its dissipation, about 56 % of that of cycle 1 (Fig. 10). The printed table has
the paper's statements beside the computed ones; ``report.html`` has Figs. 4 to 10.

The demo shows how to run a scene on any number of ranks, apply another history to the same
condensed system, and compare two methods.

    bash demos/run.sh                          # or: mpirun -n 2 python demos/block.py
"""

import argparse
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
GAUSS_SEIDEL_CYCLES = 20
STEPS_PER_LEG = 40


def main() -> None:
    """Run the study into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Study of the block of Ahn & Barber (2008).")
    parser.add_argument("--out", default="results/block", help="folder of the results")
    folder = Path(parser.parse_args().out)
    comm = MPI.COMM_WORLD

    # 1. First loading, then cycles between p0 and p0/3 until the state is steady
    scene = rf.read_scene(HERE / "block.toml")
    rf.run(scene, folder, rf.RunOptions(overwrite=True, all_pictures=True, progress=show))
    rf.on_root(comm, lambda: compare(scene, folder))


def show(stage: str) -> None:
    """Print the stages of the run, but not every cycle and picture."""
    if ":" not in stage:
        print(f"  {stage} ...", flush=True)


def compare(scene: rf.Scene, folder: Path) -> None:
    """Apply two more histories to the condensed system, print the tables, check the numbers."""
    system = rf.read_system(folder / "system.h5", scene)
    record = rf.read_record(folder / "record.h5")

    # 2. Complete unloading (section 3.1 of the paper)
    unloading = rf.evolve(system, rf.read_scene(HERE / "unloading.toml"))

    # 3. The first cycles again by the paper's Gauss-Seidel method, in load steps
    cycles = replace(scene.history, cycles=GAUSS_SEIDEL_CYCLES, until=None)
    load_steps = replace(scene.solver, method="gauss-seidel", steps_per_leg=STEPS_PER_LEG)
    stepped = rf.evolve(system, replace(scene, history=cycles, solver=load_steps))

    # 4. Figures of all three, and the tables
    drawn = rf.figures.plot_all(record, folder / "figures", unloading=unloading, stepped=stepped)
    page = rf.write_report(folder, record.scene_toml)
    print(rf.run_table(rf.read_summary(folder / "summary.json")))
    exact, steps = record.cycles.dissipation, stepped.cycles.dissipation
    print(
        f"Gauss-Seidel, {STEPS_PER_LEG} steps a leg, against the exact path: dissipation of cycle "
        f"1 differs by {abs(steps[0] / exact[0] - 1.0):.1e}, of cycle {len(steps)} by "
        f"{abs(steps[-1] / exact[len(steps) - 1] - 1.0):.1e}"
    )
    print(f"{len(drawn)} figures and the pictures are in {folder}, all on one page in {page}")

    ratio = exact[-1] / exact[0]
    assert np.all(np.diff(exact) <= 1e-12 * exact[0]), "dissipation must fall from cycle to cycle"
    assert 0.55 <= ratio <= 0.56, f"steady dissipation is {ratio:.4f} of cycle 1, not about 56 %"
    assert abs(steps[0] / exact[0] - 1.0) < 1e-2, "Gauss-Seidel differs from the exact path"


if __name__ == "__main__":
    main()
