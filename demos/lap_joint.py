"""Clamped lap joint pulled to and fro: slip from both ends of the overlap, against shear lag.

**Problem.** Strap and plate of equal stiffness E A overlap on a length L and are clamped by the
pressure p. A force between 0 and F < f p L pulls them apart. (Half of a double lap joint, whose
middle plane stays straight.)

**Equations.** Shear lag: each bar is stretched uniformly over its height. Slip starts at both ends
of the overlap, where one bar carries F and the other nothing; friction q = f p passes half of F
over to the other bar along each slip zone, until both stretch alike and stick:

    slip length  s = F / (2 q),    slip  (q / (E A)) (s - x)^2  at x from the end of the overlap,
    extension    u = F (a + L / 2) / (E A) + F^2 / (4 q E A),       a: free lengths of both bars,
    dissipation  2 q int_0^s slip dx = F^3 / (12 q E A)             on first loading.

After the reversal friction changes by 2 q (Masing's rule): the extension falls by
dF (a + L / 2) / (E A) + dF^2 / (8 q E A), and a cycle dissipates F^3 / (24 q E A).

**What to look for.** The error falls with the second power of height over slip length, E A kept:
halving the height takes away three quarters of it. The figure has the loop of pull and extension,
the elastic part taken away: dots at samples, lines from the equations.

    bash demos/run.sh lap_joint
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import ArrayLike

import receding_fenicsx as rf

HERE = Path(__file__).parent
F, q, EA, L, ARMS = 60.0, 3.0, 1000.0, 40.0, 40.0
"""Pull, friction f p, stiffness, overlap, free lengths of both bars: those of the scene."""
SLIP_LENGTH, DISSIPATION = F / (2.0 * q), F**3 / (24.0 * q * EA)
TOLERANCE = {"dissipation": 0.01, "extension": 1e-3, "slip length": 0.03}
"""Relative errors allowed at the smallest height."""


def solve(height: float) -> rf.Record | None:
    """Run the scene with bars of some height and the same E A; the record on rank 0."""
    changes = [f"material.young={EA / height}", f"body.strap.position=[0, {height}]"]
    changes += [f"body.{name}.height={height}" for name in ("strap", "plate")]
    return rf.run(rf.read_scene(HERE / "lap_joint.toml", changes))


def slip_part(force: ArrayLike, leg: str) -> np.ndarray:
    """Return the extension beyond the elastic one on a leg, from shear lag."""
    part, most = np.asarray(force) / F, F**2 / (4.0 * q * EA)
    if leg == "loading":
        return most * part**2
    reloaded = 0.5 * most * (1.0 + part**2)
    return reloaded if leg == "reloading" else most - 0.5 * most * (1.0 - part) ** 2


def compare(record: rf.Record) -> dict[str, float]:
    """Return the relative errors of dissipation, extension and slip length."""
    table = record.turning_points
    u = table.load_displacement[:, 1] / F  # the work-conjugate one is that of a unit load, F
    known = F * (ARMS + 0.5 * L) / EA + slip_part(F, "loading")
    left, _, right = rf.zones(record.x, table.state[1])
    slip = 0.5 * (left[2] - left[1] + right[2] - right[1])
    return {
        "dissipation": record.cycles.dissipation[0] / DISSIPATION - 1.0,
        "extension": (u[1] - u[0]) / known - 1.0,
        "slip length": slip / SLIP_LENGTH - 1.0,
    }


def figure(record: rf.Record, folder: Path) -> None:
    """Draw pull against extension, less the elastic part: dots here, lines from shear lag."""
    samples = record.samples
    with mpl.rc_context(rf.style.RC):
        drawn = rf.style.new_figure(rf.style.COLUMN, 2.6)
        axes = drawn.subplots()
        legs = {(0, 1): "loading", (1, 0): "unloading", (1, 1): "reloading"}
        for colour, ((cycle, leg), name) in zip(
            rf.style.SERIES_COLOURS, legs.items(), strict=False
        ):
            rows = (samples.cycle == cycle) & (samples.leg == leg)
            force, u = F * samples.load[rows, 1], samples.load_displacement[rows, 1] / F
            start = record.turning_points.load_displacement[0, 1] / F
            here = u - start - force * (ARMS + 0.5 * L) / EA
            fine = np.linspace(0.0, F, 101)
            axes.plot(slip_part(fine, name), fine, color=colour, lw=0.8)
            axes.plot(here, force, ".", ms=4, color=colour, label=name)
        axes.set(xlabel="extension less elastic part", ylabel="pull", ylim=(0.0, None))
        drawn.legend(loc="outside lower center", ncols=3)
        folder.mkdir(parents=True, exist_ok=True)
        for suffix in ("png", "pdf"):
            drawn.savefig(folder / f"lap_joint.{suffix}")
    print(f"figure written to {folder}")


def main() -> None:
    """Print the errors at three heights; assert those of the smallest, and their order."""
    parser = argparse.ArgumentParser(description="A lap joint.")
    parser.add_argument("--out", default="results/lap_joint", help="folder of the figure")
    folder, errors = Path(parser.parse_args().out), []
    for height in (1.0, 0.5, 0.25):
        record = solve(height)
        if record is not None:
            errors.append(compare(record))
            found = ", ".join(f"{name} {error:+.1e}" for name, error in errors[-1].items())
            print(f"height {height / SLIP_LENGTH:5.3f} of the slip length: errors of {found}")
    if record is None:
        return
    figure(record, folder)
    off = [abs(error["dissipation"]) for error in errors]
    assert all(abs(errors[-1][name]) < most for name, most in TOLERANCE.items()), "shear lag"
    assert off[0] > 3.5 * off[1] > 12.0 * off[2], "the error has to fall with the second power"


if __name__ == "__main__":
    main()
