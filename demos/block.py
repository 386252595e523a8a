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
the paper's statements beside the computed ones; the folder ``paper`` has Figs. 4 to 10.

The demo shows how to run a scene on any number of ranks, apply another history to the same
condensed system, compare two methods, and draw figures of one's own.

    bash demos/run.sh                          # or: mpirun -n 2 python demos/block.py
"""

import argparse
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
GAUSS_SEIDEL_CYCLES = 20
STEPS_PER_LEG = 40
PAPER = "Ahn & Barber (2008)"
DISSIPATION_RATIO, RATIO_TOLERANCE = 0.56, 0.01
"""Section 3.2: steady dissipation per cycle is "approximately 56%" of that of the first cycle."""
SLIP_EXPONENT, EXPONENT_TOLERANCE = -3.1, 0.1
"""Section 3.2, Fig. 8: slip increment per cycle ~ N^-3.1 at a representative node."""
FITTED = np.arange(4, 21)
"""Cycles N of the fit: earlier ones follow no power law, increments of later ones are small."""


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

    # 4. The table of the run, the paper's statements beside it, and the paper's figures
    compared = comparison(record)
    print(rf.run_table(rf.read_summary(folder / "summary.json")))
    for statement, agrees in compared:
        print(f"{statement}: {'agrees' if agrees else 'DIFFERS'}")
    exact, steps = record.cycles.dissipation, stepped.cycles.dissipation
    print(
        f"Gauss-Seidel, {STEPS_PER_LEG} steps a leg: dissipation of cycle 1 differs by "
        f"{abs(steps[0] / exact[0] - 1.0):.1e}, of cycle {len(steps)} by "
        f"{abs(steps[-1] / exact[len(steps) - 1] - 1.0):.1e}"
    )
    draw(record, unloading, stepped, folder / "paper")
    print(f"Figs. 4 to 10 are in {folder / 'paper'}, everything else in {folder / 'report.html'}")

    assert all(agrees for _, agrees in compared), "a statement of the paper is not met"
    assert np.all(np.diff(exact) <= 1e-12 * exact[0]), "dissipation must fall from cycle to cycle"
    assert abs(steps[0] / exact[0] - 1.0) < 1e-2, "Gauss-Seidel differs from the exact path"


def comparison(record: rf.Record) -> list[tuple[str, bool]]:
    """Return statements of the paper with what the record has instead, and whether they agree."""
    # section 3, Fig. 4: both slips are outwards
    loading = [name for name, *_ in record.at(0).zones]
    # section 3.1, Fig. 5: the states on x < 0 mirror those on x > 0
    unloading = [name for name, *_ in record.at(1, leg=0).zones]
    left = ["separation", "forward slip", "stick", "backward slip"]
    right = ["stick", "forward slip", "stick", "backward slip", "separation"]
    # section 3.2, Fig. 10
    ratio = record.cycles.dissipation[-1] / record.cycles.dissipation[0]
    # section 3.2, Fig. 8: nodes at 0.5 h to 0.8 h that slip in each of the fitted cycles
    slip = np.abs(record.cycles.slip_increment)
    distance = np.abs(record.x) / (0.5 * record.x[-1])
    nodes = (distance >= 0.5) & (distance <= 0.8)
    nodes &= np.all(slip[FITTED - 1] > 1e-9 * slip.max(), axis=0)
    exponent = np.median(np.polyfit(np.log(FITTED), np.log(slip[FITTED - 1][:, nodes]), 1)[0])
    return [
        (
            f"zones on first loading (Fig. 4): {', '.join(loading)}",
            loading == ["separation", "backward slip", "stick", "forward slip", "separation"],
        ),
        (
            f"zones on first unloading, x > 0 (Fig. 5): {', '.join(unloading[len(left) :])}",
            unloading == left + right,
        ),
        (
            "dissipation of the last cycle over that of the first: "
            f"{ratio:.4f} (paper: {DISSIPATION_RATIO})",
            bool(abs(ratio - DISSIPATION_RATIO) <= RATIO_TOLERANCE),
        ),
        (
            "exponent of the slip increment per cycle over N, median of the nodes: "
            f"{exponent:.3f} (paper: {SLIP_EXPONENT})",
            bool(abs(exponent - SLIP_EXPONENT) <= EXPONENT_TOLERANCE),
        ),
    ]


def draw(record: rf.Record, unloading: rf.Record, stepped: rf.Record, folder: Path) -> None:
    """Draw Figs. 4 to 10 of the paper; Figs. 8 and 10 with its values."""
    folder.mkdir(exist_ok=True)
    last = len(record.cycles.dissipation)
    figures = {
        "fig04_tractions_first_loading": rf.figures.tractions(record, record.at(0)),
        "fig05_zones_first_unloading": rf.figures.zone_maps(unloading, [(0, 1)]),
        "fig06_tractions_first_unloading": rf.figures.tractions(
            unloading, unloading.at(0, leg=1, s=2.0 / 3.0)
        ),
        "fig07_zones_cycle_9": rf.figures.zone_maps(record, 9),
        "fig08_slip_per_cycle": rf.figures.slip_per_cycle(record),
        "fig09_zones_last_cycle": rf.figures.zone_maps(record, last),
        "fig10_dissipation_per_cycle": rf.figures.dissipation_per_cycle(record, stepped=stepped),
    }
    with mpl.rc_context(rf.style.RC):
        axes = figures["fig08_slip_per_cycle"].axes[0]
        # drawn above the points, of which each line has one a cycle
        top = 4.0 * max(float(np.asarray(line.get_ydata())[3]) for line in axes.lines[::2])
        axes.loglog(FITTED, top * (FITTED / FITTED[0]) ** SLIP_EXPONENT, "k--", lw=0.9)
        axes.text(FITTED[3], top, f"{PAPER}: $N^{{{SLIP_EXPONENT}}}$", fontsize=8.0)
        axes = figures["fig10_dissipation_per_cycle"].axes[0]
        axes.axhline(DISSIPATION_RATIO, **rf.style.GUIDE)
        words = f"{100 * DISSIPATION_RATIO:.0f} %, {PAPER}"
        axes.text(last, DISSIPATION_RATIO - 0.03, words, fontsize=8.0, ha="right", va="top")
    for name, figure in figures.items():
        rf.figures.save(figure, folder / f"{name}.png")
        rf.figures.save(figure, folder / f"{name}.pdf")


if __name__ == "__main__":
    main()
