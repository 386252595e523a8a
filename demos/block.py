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
approached slowly; its dissipation, about 56 % of that of cycle 1 (Fig. 10). The paper's numbers are
printed beside the computed ones; ``paper`` has Figs. 5 to 8 and 10, ``figures`` Figs. 4 and 9.

The demo shows how to run a scene on any number of ranks, apply another history to the same
condensed system, compare two methods, and add to figures.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
PAPER = "Ahn & Barber (2008)"
RATIO, EXPONENT = 0.56, -3.1
"""Section 3.2: dissipation of the steady cycle over that of cycle 1; slip per cycle ~ N^-3.1."""
FITTED = np.arange(4, 21)
"""Cycles N of the fit: earlier ones follow no power law, increments of later ones are small."""
STEPPED = 20
"""Cycles that are followed in load steps too."""


def main() -> None:
    """Run the study into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Study of the block of Ahn & Barber (2008).")
    parser.add_argument("--out", default="results/block", help="folder of the results")
    folder = Path(parser.parse_args().out)

    # 1. First loading, then cycles between p0 and p0/3 until the state is steady
    scene = rf.read_scene(HERE / "block.toml")
    rf.run(scene, folder, rf.RunOptions(overwrite=True, all_pictures=True, progress=show))
    rf.on_root(MPI.COMM_WORLD, lambda: compare(scene, folder))


def show(stage: str) -> None:
    """Print the stages of the run, but not every cycle and picture."""
    if ":" not in stage:
        print(f"  {stage} ...", flush=True)


def compare(scene: rf.Scene, folder: Path) -> None:
    """Apply two more histories to the condensed system, draw, and check the paper's numbers."""
    system = rf.read_system(folder / "system.h5", scene)
    record = rf.read_record(folder / "record.h5")

    # 2. Complete unloading (section 3.1 of the paper)
    unloading = rf.evolve(system, rf.read_scene(HERE / "unloading.toml"))

    # 3. The first cycles again by the paper's Gauss-Seidel method, in load steps
    cycles = replace(scene.history, cycles=STEPPED, until=None)
    load_steps = replace(scene.solver, method="gauss-seidel", steps_per_leg=40)
    stepped = rf.evolve(system, replace(scene, history=cycles, solver=load_steps))

    # 4. The table of the run, the paper's figures and numbers
    print(rf.run_table(rf.read_summary(folder / "summary.json")))
    draw(record, unloading, stepped, folder / "paper")
    D, by_steps = record.cycles.dissipation, stepped.cycles.dissipation
    ratio, exponent, error = D[-1] / D[0], slip_exponent(record), abs(by_steps[0] / D[0] - 1.0)
    print(f"dissipation of the last cycle over that of the first: {ratio:.4f} (paper: {RATIO})")
    print(f"slip per cycle ~ N^n, median n of the nodes: {exponent:.3f} (paper: {EXPONENT})")
    print(f"dissipation of cycle 1 by Gauss-Seidel, 40 steps a leg: differs by {error:.1e}")

    # Figs. 4 and 5, on x > 0: slip is outwards on loading
    zones = [
        [name for name, left, _ in now.zones if left > 0]
        for now in (record.at(0), record.at(1, leg=0))
    ]
    assert zones[0] == ["forward slip", "separation"], "zones on first loading"
    assert zones[1] == ["forward slip", "stick", "backward slip", "separation"], "on unloading"
    assert abs(ratio - RATIO) <= 0.01, "dissipation of the steady cycle"
    assert abs(exponent - EXPONENT) <= 0.1, "slip per cycle"
    assert np.all(np.diff(D) <= 1e-12 * D[0]), "dissipation must fall from cycle to cycle"
    assert error < 1e-2, "Gauss-Seidel differs from the exact path"


def slip_exponent(record: rf.Record) -> float:
    """Fit a power of N to the slip per cycle of nodes at 0.5 h to 0.8 h; return the median."""
    slip = np.abs(record.cycles.slip_increment)
    distance = np.abs(record.x) / (0.5 * record.x[-1])
    nodes = (distance >= 0.5) & (distance <= 0.8)
    nodes &= np.all(slip[FITTED - 1] > 1e-9 * slip.max(), axis=0)
    return float(np.median(np.polyfit(np.log(FITTED), np.log(slip[FITTED - 1][:, nodes]), 1)[0]))


def draw(record: rf.Record, unloading: rf.Record, stepped: rf.Record, folder: Path) -> None:
    """Draw Figs. 5 to 8 and 10 of the paper; Figs. 8 and 10 with its values."""
    folder.mkdir(exist_ok=True)
    third = unloading.at(0, leg=1, s=2.0 / 3.0)
    slip = rf.figures.slip_per_cycle(record)
    dissipation = rf.figures.dissipation_per_cycle(record, stepped=stepped)
    with mpl.rc_context(rf.style.RC):
        axes = slip.axes[0]
        top = 0.2 * axes.get_ylim()[1]
        axes.loglog(FITTED, top * (FITTED / FITTED[0]) ** EXPONENT, "k--", lw=0.9)
        axes.text(FITTED[3], top, f"{PAPER}: $N^{{{EXPONENT}}}$", fontsize=8.0)
        axes = dissipation.axes[0]
        axes.axhline(RATIO, **rf.style.GUIDE)
        axes.text(1.0, RATIO - 0.03, f"{100 * RATIO:.0f} %, {PAPER}", fontsize=8.0, va="top")
    rf.figures.save(rf.figures.zone_maps(unloading, [(0, 1)]), folder / "fig05.png")
    rf.figures.save(rf.figures.tractions(unloading, third), folder / "fig06.png")
    rf.figures.save(rf.figures.zone_maps(record, 9), folder / "fig07.png")
    rf.figures.save(slip, folder / "fig08.png")
    rf.figures.save(dissipation, folder / "fig10.png")


if __name__ == "__main__":
    main()
