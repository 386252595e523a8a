"""Flat punch with friction on a half-space: stick zone on loading, reverse slip on unloading.

You will see that

* on loading the punch sticks on |x| < c (r < c), whatever the load: c / a over Poisson's ratio and
  friction, in the plane and round the axis, against values of coupled integral equations;
* a half-space cannot be meshed, and a large body disturbs c. Here the stresses that a half-space
  has at the radius R act on a half-disc (half-ball), so the body is wrong only by what falls off
  faster than the force's own field: by 1/R^2 in the plane, 1/R^3 round the axis. Three radii show
  it, and two of them give the limit. A uniform pressure on the arc, of the same resultant, is
  wrong by 1/R: its lateral strain shifts the stick zone at first order;
* on unloading the stick zone shrinks, the slip zone sticks from the edge, and from the edge reverse
  slip grows inwards over the whole contact, as Turner found.

The demo shows how to give numbers to a .geo file, and loads as expressions.
"""

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
RADII = (10.0, 20.0, 40.0)
"""Radii of the body over the punch's half width."""
FALL = {"plane strain": 4.0, "axisymmetric": 8.0}
"""By how much the error of truncation falls when the radius is doubled."""
FILES = {"plane strain": "punch.toml", "axisymmetric": "punch_axisymmetric.toml"}
FINER = ("mesh.contact_elements=320", "mesh.growth=1.075")
"""Elements half as large as the scenes'."""
TOLERANCE = 0.01
"""Relative error allowed of the stick half width (radius)."""


def boussinesq(nu: float) -> str:
    """Tractions of a point force on a half-space at the distance R, as they stand in the scene."""
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
    """Stick half width (radius) at full load; the body lies above the punch, so beta > 0."""
    beta = rf.dundurs_beta((1.0, nu, "plane strain"))
    found = rf.half_width_estimates(record, 0, betas=(beta,))["stick_half_width_estimate"]
    return float(found["value"])


def widths(
    kinematics: str, nu: float, f: float, radii: tuple[float, ...], *others: str
) -> list[float]:
    """Stick half widths in bodies of some radii, on rank 0."""
    records = [solve(kinematics, nu, f, radius, *others) for radius in radii]
    return [stick(record, nu) for record in records if record is not None]


def limit(kinematics: str, near: float, far: float) -> float:
    """Value at an infinite radius, from two of which the second is twice the first."""
    return far + (far - near) / (FALL[kinematics] - 1.0)


def patterns(record: rf.Record, leg: int) -> list[tuple[float, list[tuple[str, float, float]]]]:
    """Load and zones at the samples of a leg."""
    s = record.samples
    rows = np.flatnonzero(s.leg == leg)
    return [(s.load[i, 0], rf.zones(record.x, s.state[i], record.axisymmetric)) for i in rows]


def main() -> None:
    """Print the tables; assert the extrapolated stick zones and the course of unloading."""
    root = MPI.COMM_WORLD.rank == 0
    for kinematics, values in rf.reference.closed_forms.PUNCH_STICK.items():
        if root:
            heads = "".join(f"     R = {radius:2.0f} a" for radius in RADII)
            print(f"{kinematics}: stick half width over a")
            print(f"   nu    f {heads}    limit    known  error (twice as fine)")
        errors = []
        for (nu, f), known in values.items():
            found = widths(kinematics, nu, f, RADII)
            finer = widths(kinematics, nu, f, RADII[1:], *FINER)
            if not root:
                continue
            limits = [limit(kinematics, *pair[-2:]) for pair in (found, finer)]
            errors.append([abs(value / known - 1.0) for value in limits])
            shown = "".join(f"  {c:9.5f}" for c in [*found, limits[0], known])
            print(f"  {nu:.1f}  {f:.1f} {shown}  {errors[-1][0]:.1e} ({errors[-1][1]:.1e})")
        if root:
            coarse, fine = np.max(errors, axis=0)
            assert fine < coarse < TOLERANCE, f"{kinematics}: stick zones"
    uniform = solve("plane strain", 0.3, 0.2, RADII[-1], f"load.P.pressure={0.5 / RADII[-1]}")
    if uniform is not None:
        error = abs(
            stick(uniform, 0.3) / rf.reference.closed_forms.PUNCH_STICK["plane strain"][0.3, 0.2]
            - 1.0
        )
        print(f"plane, nu = 0.3, f = 0.2, uniform pressure on the arc at R = {RADII[-1]:.0f} a:")
        print(f"  error {error:.1e}")
    record = solve("axisymmetric", 0.3, 0.2, RADII[-1])
    if record is None:
        return
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
    assert reverse[0] == 1.0 and reverse[-1] == 0.0, (
        "reverse slip must start at the edge and end all"
    )


if __name__ == "__main__":
    main()
