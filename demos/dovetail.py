"""Dovetail root of a blade in its slot: two bodies, two oblique contact edges.

**Problem.** A blade is pulled out of a disc by a force F(t) that goes up and down; its root rubs on
two oblique pads with friction. Both bodies come from one .geo file (``meshes/dovetail.geo``), each
from its own surface. The pads are curves of both, so their nodes match.

**Equations.** Each pad has its own tangent t and normal n = (-t_y, t_x), and positions x run along
t, with the blade on the left. Slip outwards is therefore forward on one pad and backward on the
other. The forces of both pads balance the pull at every instant,

    sum over pads and nodes of (P n + Q t) + F e_y = 0.

**What to look for.** Balance to round-off at every turning point; the two pads alike to the
asymmetry of the mesh; when the pull falls, the pads stick first, then reverse slip grows from their
upper ends; dissipation falls from cycle to cycle.

The demo shows how to evaluate each contact edge of a record (``record.by_edge()``). With ``--out``
it also draws all pictures.

    bash demos/run.sh dovetail                 # or: mpirun -n 2 python demos/dovetail.py
"""

import argparse
from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
BALANCE = 1e-9
"""Largest resultant of pads and pull, over the pull."""
ASYMMETRY = 0.005
"""Largest difference of the two pads, over their force: the mesh is not mirror-symmetric."""


def axes(pad: rf.Record) -> tuple[np.ndarray, np.ndarray]:
    """Return tangent t and normal n of a pad: x runs along t, and t = (n_y, -n_x)."""
    t = pad.points[-1] - pad.points[0]
    t = t / np.hypot(*t)
    return t, np.array([-t[1], t[0]])


def report(record: rf.Record) -> None:
    """Print the pads' forces and zones; assert balance, symmetry and decay of dissipation."""
    pads = record.by_edge()
    table = record.turning_points
    total = np.zeros((len(table.s), 2))
    normal = {}
    for name, pad in pads.items():
        t, n = axes(pad)
        P, Q = pad.turning_points.P.sum(axis=1), pad.turning_points.Q.sum(axis=1)
        total += P[:, None] * n + Q[:, None] * t
        normal[name] = P
        assert np.all(np.abs(pad.turning_points.Q) <= pad.f * pad.turning_points.P + 1e-9)
        for row in range(3):
            found = ", ".join(
                f"{state} to {end:+.3f}"
                for state, _, end in rf.zones(pad.x, pad.turning_points.state[row])
            )
            print(
                f"{name:11s} F = {table.load[row, 0]:.1f}: normal force {P[row]:.4f}, tangential "
                f"{Q[row]:+.4f}; from {pad.x[0]:+.3f} {found}"
            )
    pull = np.outer(table.load[:, 0], [0.0, 1.0])
    error = np.abs(total + pull).max() / table.load.max()
    right, left = normal.values()
    unlike = np.abs(right - left).max() / right.max()
    D = record.cycles.dissipation
    print(f"pads and pull balance to {error:.0e} of the pull; the pads differ by {unlike:.1e}")
    print(f"dissipation of cycle {len(D)} over cycle 1: {D[-1] / D[0]:.4f}")
    assert error < BALANCE, "the pads' forces do not balance the pull"
    assert unlike < ASYMMETRY, "the pads carry different forces"
    assert 0.0 < D[-1] < D[0], "dissipation has to fall from cycle to cycle"


def main() -> None:
    """Run the history, into the folder given by --out if any."""
    parser = argparse.ArgumentParser(description="A dovetail root in its slot.")
    parser.add_argument("--out", help="folder for record, figures and pictures")
    folder = parser.parse_args().out
    comm = MPI.COMM_WORLD
    record = rf.run(rf.read_scene(HERE / "dovetail.toml"), folder, rf.RunOptions(overwrite=True))
    rf.on_root(comm, lambda: report(record) if record is not None else None)


if __name__ == "__main__":
    main()
