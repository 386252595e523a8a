"""Error of load steps: Gauss-Seidel against the exact path.

**Problem.** The paper's block, first loading and one cycle, on one condensed system.

**Equations.** Load steps replace the rate form of Coulomb's law by differences over a step (eqs. 14
and 15); the dissipation of a step is -(Q_old + Q_new)/2 (v_new - v_old). The exact path has no
steps, so the difference between both is the time error of the load steps.

**What to look for.** For 10 to 640 steps a leg: the errors of the dissipation of cycle 1 and of the
nodal forces, and the time. The dissipation converges by an order of nearly 2. The figure has
both errors over the number of steps.

The demo shows how to evolve one condensed system by both methods.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
STEPS = (10, 20, 40, 80, 160, 320, 640)
LARGEST_FORCE_ERROR = 1e-4
"""Largest error allowed of a nodal force at 320 steps a leg, over the largest force."""
SLOPES = (0.9, 2.1)
"""Expected range of the order of convergence of the dissipation."""


def main() -> None:
    """Print the table and write the figure into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Load steps against the exact path.")
    parser.add_argument("--out", default="results/time_error", help="folder of the figure")
    folder = Path(parser.parse_args().out)
    scene = rf.read_scene(HERE / "block.toml", ["history.cycles=1"])
    system = rf.condense(scene)
    rf.on_root(MPI.COMM_WORLD, lambda: compare(system, scene, folder))


def compare(system: rf.ContactSystem | None, scene: rf.Scene, folder: Path) -> None:
    """Follow the exact path, then Gauss-Seidel with more and more steps; print and check."""
    assert system is not None
    exact, seconds = timed(system, scene)
    print(f"exact path: {seconds:.2f} s, residual {exact.residual_max:.0e}")
    print("steps a leg  seconds  error of D_1  error of forces")
    errors, forces = [], []
    for steps in STEPS:
        solver = rf.SolverOptions(method="gauss-seidel", steps_per_leg=steps)
        stepped, seconds = timed(system, replace(scene, solver=solver))
        errors.append(abs(stepped.cycles.dissipation[0] / exact.cycles.dissipation[0] - 1.0))
        a, b = stepped.turning_points, exact.turning_points
        difference = max(np.abs(a.P - b.P).max(), np.abs(a.Q - b.Q).max())
        forces.append(difference / np.abs(b.P).max())
        print(f"{steps:11d}  {seconds:7.2f}  {errors[-1]:12.1e}  {forces[-1]:15.1e}", flush=True)
    used = np.array(STEPS) >= 40
    slope = -np.polyfit(np.log(np.array(STEPS)[used]), np.log(np.array(errors)[used]), 1)[0]
    print(f"order of convergence of the dissipation from 40 to 640 steps: {slope:.2f}")
    figure(np.array(errors), np.array(forces), folder)
    assert SLOPES[0] <= slope <= SLOPES[1], f"order {slope:.2f} is not between {SLOPES}"
    assert forces[STEPS.index(320)] < LARGEST_FORCE_ERROR


def timed(system: rf.ContactSystem, scene: rf.Scene) -> tuple[rf.Record, float]:
    """Return the record and the seconds that it took."""
    begin = time.perf_counter()
    record = rf.evolve(system, scene)
    return record, time.perf_counter() - begin


def figure(errors: np.ndarray, forces: np.ndarray, folder: Path) -> None:
    """Draw both errors over the number of steps."""
    colours = rf.style.SERIES_COLOURS
    with mpl.rc_context(rf.style.RC):
        drawn = rf.style.new_figure(rf.style.COLUMN, 2.8)
        axes = drawn.subplots()
        axes.loglog(STEPS, errors, "o-", color=colours[0], label="dissipation of cycle 1")
        axes.loglog(STEPS, forces, "s-", color=colours[1], label="nodal forces")
        second_order = errors[0] * (STEPS[0] / np.array(STEPS)) ** 2
        axes.loglog(STEPS, second_order, "--", color=rf.style.GUIDE_COLOUR, lw=0.8, label="order 2")
        axes.set(xlabel="load steps a leg", ylabel="error against the exact path")
        axes.legend()
        folder.mkdir(parents=True, exist_ok=True)
        for suffix in ("png", "pdf"):
            drawn.savefig(folder / f"time_error.{suffix}")
    print(f"figure written to {folder}")


if __name__ == "__main__":
    main()
