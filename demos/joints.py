"""Damping of joints: a blade root under centrifugal load, a lap joint with two bolts.

**Problem.** The root of a rotating blade is pulled in its slot by its own centrifugal load, a body
force rho omega^2 r, and shaken sideways. A strap is drawn on a plate by two bolts, whose forces
follow the load, and pulled to and fro. How much do they dissipate in a cycle, how stiff are they?

**Equations.** Under the preload and a load between plus and minus an amplitude alpha, each joint is
followed to its limit cycle. Its dissipation D(alpha) is compared with Masing's rule, which takes
each branch of the loop for the first loading at twice its size,

    D_Masing(alpha) = 8 W(alpha) - 4 alpha q(alpha),

W being the work of the first loading and q the displacement. The force of a bolt of stiffness k,
tightened by s, is k (s - D), where D is how much its patches have approached.

**What to look for.** A root that has slid under the centrifugal load slips further than its first
loading by the shaking force shows: Masing's rule is of no use. The bolted joint dissipates about
alpha^3 by slip at the edges of the closed zones around the bolts, less than Masing's rule, up to
macroslip. Bars are the change of D from half as many elements. The bolts keep their forces within
one per cent.

    bash demos/run.sh joints                   # or: mpirun -n 2 python demos/joints.py
"""

import argparse
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
JOINTS = {"blade_root": ("shake", 0.08, 0.3), "bolted_joint": ("pull", 0.001, 0.009)}
"""Driven load, smallest and largest amplitude."""
BOLT_RANGE = 0.02
"""Largest change of a bolt's force over a cycle, relative."""


def check(name: str, curve: rf.JointCurve) -> None:
    """Print a curve; assert what is known of it."""
    print(f"\n{name}: amplitude, D per cycle, estimate of its error, Masing's rule, stiffness")
    rows = (curve.amplitude, curve.dissipation, curve.estimate, curve.masing, curve.stiffness)
    for row in zip(*rows, strict=True):
        print(" ".join(f"{value:11.4g}" for value in row))
    assert np.all(np.diff(curve.dissipation) > 0.0), "dissipation has to grow with the amplitude"
    assert np.all(np.diff(curve.stiffness) < 0.0), "stiffness has to fall with the amplitude"
    assert curve.estimate[-1] < 0.1 * curve.dissipation[-1], "the mesh is too coarse"
    less = curve.dissipation < curve.masing
    assert np.all(less == (name == "bolted_joint")), "Masing's rule errs to the other side"


def forces(record: rf.Record) -> None:
    """Print the forces of the bolts at the turning points of the limit cycle."""
    table = record.turning_points
    last = table.cycle == table.cycle[-1]
    for name in ("left bolt", "right bolt"):
        force = table.load_displacement[last, record.load_names.index(name)]
        print(f"{name}: force {force.min():.5g} to {force.max():.5g}")
        assert np.ptp(force) < BOLT_RANGE * force.max(), "the bolt loses its force"


def main() -> None:
    """Find both curves; with --out draw them, and the bolted joint in its limit cycle."""
    parser = argparse.ArgumentParser(description="Damping of a blade root and a bolted joint.")
    parser.add_argument("--out", type=Path, help="folder for curves, figures and pictures")
    parser.add_argument("--count", type=int, default=8, help="amplitudes of each curve")
    options = parser.parse_args()
    out, again = options.out, rf.StudyOptions(overwrite=True)
    for name, (drive, low, high) in JOINTS.items():
        scene = rf.read_scene(HERE / f"{name}.toml")
        amplitudes = np.geomspace(low, high, options.count)
        folder = None if out is None else out / name
        curve = rf.joint_curve(scene, drive, amplitudes, folder, options=again)
        if curve is not None:
            check(name, curve)
        if out is not None or name == "bolted_joint":
            cycle = None if out is None else out / f"{name}_cycle"
            record = rf.run(scene, cycle, rf.RunOptions(overwrite=True))
            if record is not None and name == "bolted_joint":
                forces(record)


if __name__ == "__main__":
    main()
