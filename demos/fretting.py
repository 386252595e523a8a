"""Fretting under harmonic loads: dissipation over the phase between normal and shear force.

**Problem.** Two equal elastic cylinders (friction f) are pressed together by P (1 + 0.3 cos t) and
sheared by 0.3 P cos(t - phase).

**Equations.** In phase and opposite, the loads move to and fro on a straight line. Out of phase
they follow an ellipse, which the program replaces by a polygon with as many corners as a tolerance
on the dissipation per cycle needs. The reference follows the memory of the contact: every shear
traction is a sum of differences of Hertz's pressures,

    q(x) = f int_0^P d(P') dp(x; P') / dP' dP',    -1 <= d <= 1,

and d changes from the edge of the contact inwards (`rf.reference.fretting`).

**What to look for.** The dissipation doubles with the phase, at the same amplitudes. The table has
the corners that each phase needs, the error estimate of the polygon, and the difference from the
reference, which hardly depends on the phase: blocks of finite size are not half-planes. The
figure has the dissipation over the phase: dots on the reference.

    bash demos/run.sh fretting
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
HERTZ = rf.reference.closed_forms.Hertz(1.0, 100.0, 0.5 * 200.0 / (1.0 - 0.3**2))
PHASES = (0, 30, 60, 90, 120, 150, 180)
TOLERANCE = 0.01
"""Error allowed of the dissipation."""


def known(phase: float, steps: int = 2000) -> float:
    """Return the dissipation per cycle by the memory of the contact."""
    angle = 2.0 * np.pi * np.arange(steps + 1) / steps
    Q = 0.3 * np.cos(angle - np.radians(phase))
    return rf.reference.fretting.cycle_dissipation(HERTZ, 0.5, 1.0 + 0.3 * np.cos(angle), Q)


def rows(phases: tuple[int, ...], *changes: str) -> list[tuple[float, ...]]:
    """Return phase, corners, error estimate, dissipation here and known, on rank 0."""
    scenes = [
        rf.read_scene(HERE / "fretting.toml", [f"history.harmonic.Q.phase={phase}", *changes])
        for phase in phases
    ]
    # the phase belongs to the history: one condensed body serves all
    system = rf.condense(scenes[0])
    if system is None:
        return []
    found: list[tuple[float, ...]] = []
    for phase, scene in zip(phases, scenes, strict=True):
        record = rf.evolve(system, scene)
        polygon = rf.summarise(record)["harmonic"]
        D = float(record.cycles.dissipation[-1])
        found.append((phase, polygon["corners"], polygon["error_estimate"], D, known(phase)))
    return found


def figure(table: list[tuple[float, ...]], path: Path) -> None:
    """Draw the dissipation over the phase: dots on the reference."""
    phase, _, _, D, _ = np.array(table).T
    fine = np.linspace(0.0, 180.0, 37)
    with mpl.rc_context(rf.style.RC):
        drawn = rf.style.new_figure(rf.style.COLUMN, 2.6)
        axes = drawn.subplots()
        axes.plot(fine, [known(angle, 500) for angle in fine], color="black", lw=0.8)
        axes.plot(phase, D, "o", color=rf.style.SERIES_COLOURS[0])
        axes.set(xlabel="phase of the shear force (degrees)", ylabel="dissipation per cycle")
        axes.set(xticks=PHASES, ylim=(0.0, None))
        axes.ticklabel_format(axis="y", scilimits=(0, 0))
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn.savefig(path)


def main() -> None:
    """Print the table; assert that every dissipation is within 1 % of the reference."""
    parser = argparse.ArgumentParser(description="Fretting under harmonic loads.")
    parser.add_argument("--out", default="results/fretting", help="folder of the figure")
    out = Path(parser.parse_args().out)
    table = rows(PHASES)
    if not table:
        return
    print("phase  corners  polygon's error   dissipation     reference     error")
    for phase, corners, error, D, reference in table:
        print(
            f"{phase:5.0f}  {corners:7.0f}  {error:15.1e}   {D:.5e}   {reference:.5e}  "
            f"{D / reference - 1.0:+.1e}"
        )
    figure(table, out / "fretting.png")
    worst = max(abs(D / reference - 1.0) for *_, D, reference in table)
    assert worst < TOLERANCE, f"a dissipation is off by {worst:.1%}"


if __name__ == "__main__":
    main()
