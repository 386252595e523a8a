"""The block of Ahn & Barber (2008) under cyclic loading: the paper's study, whole.

You will see the paper's statements beside ours in a table, its Figs. 4 to 10, and pictures of the
stress field. The demo shows how to

* read a scene and go the whole way from it to a record, on any number of ranks;
* evolve another history on the condensed system without touching the bulk again;
* lay the paper's Gauss-Seidel method over the exact path.

Run it by ``bash demos/run.sh``, or by ``mpirun -n 2 python demos/block.py`` where all is installed.
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
    parser = argparse.ArgumentParser(description="The paper's study of the block.")
    parser.add_argument("--out", default="results/block", help="folder for what is found")
    folder = Path(parser.parse_args().out)
    comm = MPI.COMM_WORLD

    def say(stage: str) -> None:
        if "cycle" not in stage:
            print(f"  {stage} ...", flush=True)

    # exact evolution: first loading, then cycles between p0 and p0/3 until they repeat themselves
    scene = rf.read_scene(HERE / "block.toml")
    rf.run(scene, folder, rf.RunOptions(overwrite=True, progress=say))
    rf.on_root(comm, lambda: compare(scene, folder))


def compare(scene: rf.Scene, folder: Path) -> None:
    """Unload completely, repeat the first cycles by Gauss-Seidel, print the tables."""
    system = rf.read_system(folder / "system.h5", scene)
    record = rf.read_record(folder / "record.h5")

    # section 3.1 of the paper: complete unloading, on the same condensed system
    unloading = rf.evolve(system, rf.read_scene(HERE / "unloading.toml"))
    # the paper's own method, step by step
    cycles = replace(scene.history, cycles=GAUSS_SEIDEL_CYCLES, until=None)
    steps_of_load = replace(scene.solver, method="gauss-seidel", steps_per_leg=STEPS_PER_LEG)
    stepped = rf.evolve(system, replace(scene, history=cycles, solver=steps_of_load))
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
    assert abs(steps[0] / exact[0] - 1.0) < 1e-2, "Gauss-Seidel strays from the exact path"


if __name__ == "__main__":
    main()
