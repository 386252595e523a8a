"""Flat punch with friction on a half-space: stick zone on loading, reverse slip on unloading.

**Problem.** A flat rigid punch of half width (radius) a presses an elastic half-space with friction
f, in plane strain and axisymmetric, and is then unloaded.

**Equations.** On loading the punch sticks on |x| < c (r < c) and slips outside, whatever the load;
c / a depends on Poisson's ratio and f only. Known values come from coupled integral equations
(``rf.reference.closed_forms.PUNCH_STICK``). A half-space cannot be meshed: a half-disc (half-ball)
of radius R carries on its arc the stresses that a half-space has there, for axisymmetry those of
Boussinesq's point force P,

    sigma_r = P / (2 pi R^2) ((1 - 2 nu) - 2 (2 - nu) cos theta),
    tau     = P / (2 pi R^2) (1 - 2 nu) sin theta cos theta / (1 + cos theta).

Its error falls as 1/R^2 in plane strain and 1/R^3 in axisymmetry; two radii give the limit.

**What to look for.** c / a with its limit, and the limit's errors on two meshes. On unloading
the central stick zone shrinks, the slip zone sticks again from the edge, and reverse slip grows
from the edge inwards over the whole contact, as Turner found.

The demo shows how to set a parameter of a .geo file and how to write loads as expressions.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
PUNCH_STICK = rf.reference.closed_forms.PUNCH_STICK
"""Stick half width over a, by kinematics, then by (nu, f)."""
RADII = (20.0, 40.0)
"""Radii of the body over the punch's half width."""
ERROR_RATIO = {"plane strain": 4.0, "axisymmetric": 8.0}
"""Ratio of the errors of truncation at both radii."""
FILES = {"plane strain": "punch.toml", "axisymmetric": "punch_axisymmetric.toml"}
FINER = ("mesh.contact_elements=320", "mesh.growth=1.075")
"""Elements half as large as the scenes'."""


def boussinesq(nu: float) -> str:
    """Return Boussinesq's tractions in global axes, as expressions of a scene file."""
    a, b, rr = 1.0 - 2.0 * nu, 2.0 * (2.0 - nu), "(x**2 + y**2)"
    s, t = f"({a} - {b} * y / sqrt{rr})", f"{a} * x * y / {rr} / (1 + y / sqrt{rr})"
    along = f"({s} * x / sqrt{rr} + {t} * y / sqrt{rr}) / (2 * pi * {rr})"
    down = f"({s} * y / sqrt{rr} - {t} * x / sqrt{rr}) / (2 * pi * {rr})"
    return f'["{along}", "{down}"]'


def solve(kinematics: str, nu: float, f: float, radius: float, *others: str) -> rf.Record | None:
    """Run a punch; the record on rank 0."""
    changes = [f"body.parameters.radius={radius}", f"material.poisson={nu}", *others]
    if kinematics == "axisymmetric":
        changes.append(f"load.P.traction={boussinesq(nu)}")
    return rf.run(rf.read_scene(HERE / FILES[kinematics], [*changes, f"contact.friction={f}"]))


def stick(record: rf.Record, nu: float) -> float:
    """Return the stick half width (radius) at full load; the body is above: beta > 0."""
    beta = rf.dundurs_beta((1.0, nu, "plane strain"))
    found = rf.half_width_estimates(record, 0, betas=(beta,))["stick_half_width_estimate"]
    return float(found["value"])


def limit(kinematics: str, near: float, far: float) -> float:
    """Extrapolate from two radii, the second twice the first, to an infinite one."""
    return far + (far - near) / (ERROR_RATIO[kinematics] - 1.0)


def patterns(record: rf.Record, leg: int) -> list[list[tuple[str, float, float]]]:
    """Return the zones at the samples of a leg."""
    states = record.samples.state[record.samples.leg == leg]
    return [rf.zones(record.x, state, record.begins_on_axis) for state in states]


def compare_stick_zones(kinematics: str) -> None:
    """Print the stick half widths (radii); assert the extrapolated ones."""
    for (nu, f), known in PUNCH_STICK[kinematics].items():
        runs = [solve(kinematics, nu, f, R, *mesh) for mesh in ((), FINER) for R in RADII]
        ends = [stick(record, nu) for record in runs if record is not None]
        if not ends:
            continue
        coarse, fine = (limit(kinematics, *pair) for pair in (ends[:2], ends[2:]))
        errors = abs(coarse / known - 1.0), abs(fine / known - 1.0)
        print(
            f"{kinematics:13} {nu:3} {f:4}  {ends[0]:.5f}   {ends[1]:.5f}   {coarse:.5f}  "
            f"{known:.5f}  {errors[0]:.1e}, {errors[1]:.1e}"
        )
        assert max(errors) < 0.01, f"{kinematics}: stick zone"


def show_unloading(record: rf.Record) -> None:
    """Assert that no zone changes on loading, and how they move on unloading."""
    first, *others = patterns(record, 0)
    assert all(shape == first for shape in others), "zones change on loading"
    shapes = patterns(record, 1)
    reverse = [zone[1] if zone[0] == "forward slip" else 1.0 for *_, zone in shapes]
    centre = [zone[2] if zone[0] == "stick" else 0.0 for zone, *_ in shapes]
    assert np.all(np.diff(reverse) <= 0.0), "reverse slip must grow inwards"
    assert np.all(np.diff(centre) <= 0.0), "the central stick zone must shrink"
    assert reverse[0] == 1.0 and reverse[-1] == 0.0, "reverse slip: from the edge to the centre"
    print("on loading no zone changes; unloading, reverse slip grows from the edge to the centre")


def main() -> None:
    """Compare the stick zones, then unload."""
    if MPI.COMM_WORLD.rank == 0:
        print("c / a          nu  f     R = 20 a  R = 40 a  limit    known    errors on two meshes")
    for kinematics in PUNCH_STICK:
        compare_stick_zones(kinematics)
    record = solve("axisymmetric", 0.3, 0.2, RADII[-1])
    if record is not None:
        show_unloading(record)


if __name__ == "__main__":
    main()
