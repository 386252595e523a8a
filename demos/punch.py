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

The error of truncation then falls as 1/R^2 in plane strain and 1/R^3 in axisymmetry; two radii give
the limit. A uniform pressure of the same resultant has an error of order 1/R: its lateral strain
shifts the stick zone.

**What to look for.** c / a over nu and f, with the limit and its error on two meshes. On unloading
the central stick zone shrinks, the slip zone sticks again from the edge, and reverse slip grows
from the edge inwards over the whole contact, as Turner found.

The demo shows how to pass parameters to a .geo file and how to write loads as expressions.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
PUNCH_STICK = rf.reference.closed_forms.PUNCH_STICK
"""Stick half width over a, by kinematics, then by (nu, f)."""
RADII = (10.0, 20.0, 40.0)
"""Radii of the body over the punch's half width."""
ERROR_RATIO = {"plane strain": 4.0, "axisymmetric": 8.0}
"""Ratio of the errors of truncation at R and 2 R."""
FILES = {"plane strain": "punch.toml", "axisymmetric": "punch_axisymmetric.toml"}
FINER = ("mesh.contact_elements=320", "mesh.growth=1.075")
"""Elements half as large as the scenes'."""
TOLERANCE = 0.01
"""Relative error allowed of the stick half width (radius)."""


def boussinesq(nu: float) -> str:
    """Return Boussinesq's tractions in global axes, as expressions of a scene file."""
    a, b, rr = 1.0 - 2.0 * nu, 2.0 * (2.0 - nu), "(x**2 + y**2)"
    s, t = f"({a} - {b} * y / sqrt{rr})", f"{a} * x * y / {rr} / (1 + y / sqrt{rr})"
    along = f"({s} * x / sqrt{rr} + {t} * y / sqrt{rr}) / (2 * pi * {rr})"
    down = f"({s} * y / sqrt{rr} - {t} * x / sqrt{rr}) / (2 * pi * {rr})"
    return f'["{along}", "{down}"]'


def solve(kinematics: str, nu: float, f: float, radius: float, *others: str) -> rf.Record | None:
    """Run a punch; the record on rank 0."""
    quarter = int(kinematics == "axisymmetric")
    changes = [
        f"body.parameters={{radius={radius}, quarter={quarter}}}",
        f"material.poisson={nu}",
        f"contact.friction={f}",
        *([f"load.P.traction={boussinesq(nu)}"] if quarter else []),
        *others,
    ]
    return rf.run(rf.read_scene(HERE / FILES[kinematics], changes))


def stick(record: rf.Record, nu: float) -> float:
    """Return the stick half width (radius) at full load; the body is above: beta > 0."""
    beta = rf.dundurs_beta((1.0, nu, "plane strain"))
    found = rf.half_width_estimates(record, 0, betas=(beta,))["stick_half_width_estimate"]
    return float(found["value"])


def limit(kinematics: str, near: float, far: float) -> float:
    """Extrapolate from two radii, the second twice the first, to an infinite one."""
    return far + (far - near) / (ERROR_RATIO[kinematics] - 1.0)


def patterns(record: rf.Record, leg: int) -> list[tuple[float, list[tuple[str, float, float]]]]:
    """Return load and zones at the samples of a leg."""
    s = record.samples
    rows = np.flatnonzero(s.leg == leg)
    return [(s.load[i, 0], rf.zones(record.x, s.state[i], record.axisymmetric)) for i in rows]


def compare_stick_zones(kinematics: str) -> None:
    """Print the table of stick half widths; assert the extrapolated ones."""
    root, errors = MPI.COMM_WORLD.rank == 0, []
    if root:
        heads = "".join(f"     R = {radius:2.0f} a" for radius in RADII)
        print(f"{kinematics}: stick half width over a")
        print(f"   nu    f {heads}    limit    known  error (twice as fine)")
    for (nu, f), known in PUNCH_STICK[kinematics].items():
        coarse = [solve(kinematics, nu, f, radius) for radius in RADII]
        fine = [solve(kinematics, nu, f, radius, *FINER) for radius in RADII[1:]]
        found, finer = ([stick(r, nu) for r in part if r is not None] for part in (coarse, fine))
        if not root:
            continue
        limits = [limit(kinematics, *pair[-2:]) for pair in (found, finer)]
        errors.append([abs(value / known - 1.0) for value in limits])
        shown = "".join(f"  {c:9.5f}" for c in [*found, limits[0], known])
        print(f"  {nu:.1f}  {f:.1f} {shown}  {errors[-1][0]:.1e} ({errors[-1][1]:.1e})")
    if root:
        worst, worst_fine = np.max(errors, axis=0)
        assert worst_fine < worst < TOLERANCE, f"{kinematics}: stick zones"


def show_unloading(record: rf.Record) -> None:
    """Print the zones on unloading; assert how they move."""
    loading = patterns(record, 0)
    assert all(shape == loading[0][1] for _, shape in loading), "zones change on loading"
    print("axisymmetric, nu = 0.3, f = 0.2: on loading the zones are the same at all loads.")
    print("Unloading:")
    reverse, centre = [], []
    for load, shape in patterns(record, 1):
        print(f"  P = {load:.2f}: " + ", ".join(f"{name} to {end:.3f}" for name, _, end in shape))
        outer = shape[-1]
        reverse.append(outer[1] if outer[0] == "forward slip" else 1.0)
        centre.append(shape[0][2] if shape[0][0] == "stick" else 0.0)
    assert np.all(np.diff(reverse) <= 0.0), "reverse slip must grow inwards"
    assert np.all(np.diff(centre) <= 0.0), "the central stick zone must shrink"
    assert reverse[0] == 1.0 and reverse[-1] == 0.0, "reverse slip: from the edge to the centre"


def main() -> None:
    """Compare the stick zones, show the error of a uniform pressure, then unload."""
    for kinematics in PUNCH_STICK:
        compare_stick_zones(kinematics)
    uniform = solve("plane strain", 0.3, 0.2, RADII[-1], f"load.P.pressure={0.5 / RADII[-1]}")
    if uniform is not None:
        error = abs(stick(uniform, 0.3) / PUNCH_STICK["plane strain"][0.3, 0.2] - 1.0)
        print(f"plane, nu = 0.3, f = 0.2, uniform pressure on the arc at R = {RADII[-1]:.0f} a:")
        print(f"  error {error:.1e}")
    record = solve("axisymmetric", 0.3, 0.2, RADII[-1])
    if record is not None:
        show_unloading(record)


if __name__ == "__main__":
    main()
