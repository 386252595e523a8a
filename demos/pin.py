"""Pin in a hole of its own size: the contact angle does not depend on the load.

**Problem.** A pin of radius R is pulled against one side of the hole of a lug, which has the same
radius and an elastic modulus equal to the pin's; then the load falls and rises again.

**Equations.** The contact is receding: without clearance there is no length or stress but the load
itself, so that all stresses are proportional to it on first loading, and the arc in contact jumps
to its final size at any load. The tractions p n + q t on the arc carry the force F, and nothing
else holds the pin.

**What to look for.** The same contact and stick angles at a thousandth of the load; the resultant
of the tractions, to round-off although the nodes of rim and hole do not match; on unloading, slip
that runs inwards, with dissipation in each cycle.

The demo shows a curved contact edge, and edges whose nodes do not match.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent


def resultant(record: rf.Record, row: int) -> np.ndarray:
    """Return the force (2,) of the hole on the pin; n points to the pin's middle."""
    normal = -record.points / np.linalg.norm(record.points, axis=1)[:, None]
    tangent = np.column_stack([normal[:, 1], -normal[:, 0]])
    table = record.turning_points
    return np.asarray(table.P[row] @ normal + table.Q[row] @ tangent)


def main() -> None:
    """Print angles, forces and dissipation; assert the first two."""
    full = rf.run(rf.read_scene(HERE / "pin.toml"))
    faint = rf.run(rf.read_scene(HERE / "pin.toml", ["load.F.body_force=[0.0, -3e-6]"]))
    if MPI.COMM_WORLD.rank != 0 or full is None or faint is None:
        return
    angles = []
    for record in (full, faint):
        state, x = record.turning_points.state[0], record.x
        zones = x[state != rf.State.SEPARATION], x[state == rf.State.STICK]
        # the radius is 1
        angles.append([np.degrees(0.5 * np.ptp(zone)) for zone in zones])
    print("half angles of contact and stick on first loading, degrees")
    for load, (contact, stick) in zip((1.0, 1e-3), angles, strict=True):
        print(f"  load {load:g}: {contact:.2f}  {stick:.2f}")
    assert np.allclose(angles[0], angles[1], rtol=1e-9), "the angles must not depend on the load"
    # the polygon of the pin has 160 sides
    area = 0.5 * 160 * np.sin(2.0 * np.pi / 160)
    force = resultant(full, 0)
    print(f"force of the hole on the pin: {force[0]:.1e}, {force[1]:.6e}")
    assert np.allclose(force, [0.0, 0.003 * area], atol=1e-9), "the hole must carry the load"
    cycles = full.cycles.dissipation
    print("dissipation of the cycles:", " ".join(f"{value:.3e}" for value in cycles))
    assert full.energy_error_max < 1e-10, "the load's work must be the dissipation"


if __name__ == "__main__":
    main()
