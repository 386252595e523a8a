"""Shakedown of a sheared block: how to assemble a joint so that it never slips.

**Problem.** A block is pressed on a plane and sheared to and fro by lambda at its top. Where it
slips in every cycle it wears. Whether it does depends on lambda and on how it was assembled.

**Equations.** A residual slip v is safe at lambda if the friction margins A = Q + f P and
B = f P - Q of no node become negative at the corners k of the range:

    A_ik = [(K_tt + f K_nt) v + Q_m + f P_m + lambda (Q_k + f P_k)]_i >= 0,
    B_ik = [(f K_nt - K_tt) v + f P_m - Q_m + lambda (f P_k - Q_k)]_i >= 0.

The largest lambda with a safe slip is the upper shakedown limit, a linear program. Below the lower
limit the contact stops slipping whatever its past; in between, the start decides.

**What to look for.** From the safe slip, cycles just below the upper limit dissipate exactly
nothing; from other starts the same cycles slip for ever, so that the steady states of many starts
fill an interval of dissipation. Just above the limit all of them slip. The diagram shows both
limits over a mean shear load.

The demo shows how to find the limits of a scene, start a history from the safe slip, and collect
the steady states that a history has from many starts.
"""

import argparse
from pathlib import Path

from mpi4py import MPI

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

SCENE = Path(__file__).with_suffix(".toml")
BELOW, ABOVE = 0.99, 1.02
"""Ranges that are played, over the upper limit."""


def draw_slip(found: rf.ShakedownStudy, file: Path) -> None:
    """Draw the safe slip along the contact."""
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.COLUMN, 2.2)
        axes = figure.subplots()
        axes.plot(found.system.x, found.limits.safe_slip, color=rf.style.SERIES_COLOURS[0])
        axes.set(xlabel="$x$", ylabel="safe residual slip $v$")
        figure.savefig(file)


def main() -> None:
    """Find the limits, play cycles below and above them, and draw the steady states."""
    parser = argparse.ArgumentParser(description="Shakedown limits of a sheared block.")
    parser.add_argument("--out", type=Path, default=Path("results/shakedown"))
    parser.add_argument("--starts", type=int, default=24, help="starts of the steady states")
    options = parser.parse_args()
    scene = rf.read_scene(SCENE)

    found = rf.shakedown(
        scene, options.out, options=rf.StudyOptions(overwrite=True)
    )  # on all ranks
    if found is None:
        return
    limits, system = found.limits, found.system
    print(limits)
    for nodes, lower, upper in found.meshes:
        print(f"{nodes:4d} nodes: lower limit {lower:.6f}, upper limit {upper:.6f}")

    loads = scene.shakedown.mean, scene.shakedown.range
    dissipation = {}
    for factor in (BELOW, ABOVE):
        history = rf.range_history(system, *loads, factor * limits.upper)
        for name, slip in (("safe slip", limits.safe_slip_modelled), ("rest", None)):
            record = rf.evolve(system, history, initial_slip=slip, until="limit")
            dissipation[factor, name] = D = record.cycles.dissipation
            print(
                f"{factor:.2f} of the upper limit from {name:9}: {record.steady.kind}, "
                f"dissipation per cycle {D[-1]:.4e}"
            )
    history = rf.range_history(system, *loads, BELOW * limits.upper)
    states = rf.steady_states(system, history, options.starts, limits.safe_slip_modelled)
    print(states)
    rf.steady_states_figure(states).savefig(options.out / "steady_states.png")
    draw_slip(found, options.out / "safe_slip.png")
    print(f"files and figures in {options.out}")

    assert np.all(dissipation[BELOW, "safe slip"] == 0.0), "the safe slip does not hold"
    assert dissipation[ABOVE, "safe slip"][-1] > 0.0, "it holds above the upper limit"
    low, high = states.interval
    assert low == 0.0 < high, "the start does not decide"


if __name__ == "__main__":
    main()
    MPI.COMM_WORLD.Barrier()
