"""How fast the interface is: Gauss-Seidel steps and exact cycles, one core, one BLAS thread.

You will see the median time of a Gauss-Seidel load step with and without over-relaxation and polish
and their ratio, then for more and more contact nodes the time of exact cycles, the events in them,
the time of an event and how it grows. Nothing here is asserted: times are the machine's.
"""

import argparse
import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import time
from pathlib import Path

import numpy as np

from receding_fenicsx import ContactSystem, read_scene
from receding_fenicsx.interface.contact import ContactState, Leg, State
from receding_fenicsx.interface.events import EventPath
from receding_fenicsx.interface.gauss_seidel import GaussSeidelOptions, solve_step
from receding_fenicsx.study import condense

HERE = Path(__file__).parent
RESIDUAL = 1e-8
STEPS = 10
SETTLED = 40
"""Cycles after which most sets of states have been met before."""


def block(contact_elements: int) -> ContactSystem:
    """Return half of the paper's block, condensed."""
    text = [f"mesh.contact_elements={contact_elements}"]
    system = condense(read_scene(HERE / "block.toml", text))
    assert system is not None
    return system


def rest(system: ContactSystem) -> ContactState:
    """Return the unloaded body on the plane."""
    n = system.n
    return ContactState(np.zeros(2 * n), np.zeros(2 * n), np.full(n, State.STICK, dtype=np.int8))


def gauss_seidel() -> None:
    """Time the load steps of a first loading and a cycle, with and without the accelerations."""
    system = block(160)
    third = np.linspace(1.0, 1.0 / 3.0, STEPS + 1)
    loads = np.concatenate([[0.5, 1.0], third[1:], third[::-1][1:]])
    medians = []
    for name, options in (
        ("over-relaxation and polish", GaussSeidelOptions(1.5, True, RESIDUAL, RESIDUAL)),
        ("plain", GaussSeidelOptions(1.0, False, RESIDUAL, RESIDUAL)),
    ):
        now, scale, seconds, sweeps = rest(system), 0.0, [], []
        for load in loads:
            begin = time.perf_counter()
            step = solve_step(system, now, np.array([load]), options, scale)
            seconds.append(time.perf_counter() - begin)
            now, scale = step.end, step.force_scale
            sweeps.append(step.sweeps)
        medians.append(float(np.median(seconds)))
        print(
            f"Gauss-Seidel, {system.n} nodes, residual {RESIDUAL:.0e}, {name}: median "
            f"{1e3 * medians[-1]:.0f} ms a step, {np.median(sweeps):.0f} sweeps"
        )
    print(f"accelerations: {medians[1] / medians[0]:.1f} times faster in the median")


def cycle(path: EventPath, leg: Leg) -> tuple[Leg, int, float]:
    """Trace one cycle; return its last leg, the events in it and the seconds."""
    begin, events = time.perf_counter(), 0
    for a, b in ((1.0, 1.0 / 3.0), (1.0 / 3.0, 1.0)):
        leg = path.trace_leg(leg.end, (np.array([a]), np.array([b])), leg.force_scale)
        events += len(leg.events)
    return leg, events, time.perf_counter() - begin


def exact(elements: list[int]) -> None:
    """Time exact cycles over the number of nodes."""
    print("nodes  events  trials  cycle 2, ms  us an event  settled, ms  residual")
    sizes, costs = [], []
    for number in elements:
        system = block(number)
        path = EventPath(system)
        leg = path.trace_leg(rest(system), (np.zeros(1), np.ones(1)), 0.0)
        leg, _, _ = cycle(path, leg)
        before = path.segments.trials
        leg, events, second = cycle(path, leg)
        trials = path.segments.trials - before
        settled: list[float] = []
        residual = leg.residual
        for _ in range(SETTLED if system.n <= 400 else 0):
            leg, _, seconds = cycle(path, leg)
            settled.append(seconds)
            residual = max(residual, leg.residual)
        last = f"{1e3 * np.median(settled[-10:]):11.1f}" if settled else f"{'-':>11s}"
        sizes.append(system.n)
        costs.append(second / events)
        print(
            f"{system.n:5d}  {events:6d}  {trials:6d}  {1e3 * second:11.1f}  "
            f"{1e6 * costs[-1]:11.0f}  {last}  {residual:.0e}",
            flush=True,
        )
    if len(sizes) > 1:
        slope = np.polyfit(np.log(sizes), np.log(costs), 1)[0]
        print(f"time of an event grows as nodes^{slope:.2f}")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="How fast the interface is.")
    parser.add_argument(
        "--elements", type=int, nargs="+", default=[160, 320, 640, 1280],
        help="elements on the contact edge; the half body has one node more",
    )  # fmt: skip
    options = parser.parse_args()
    gauss_seidel()
    exact(options.elements)


if __name__ == "__main__":
    main()
