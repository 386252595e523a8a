"""Fretting wear: a published scar in gross slip, and the limit of partial slip.

**Problem.** A steel cylinder slides to and fro on a flat and wears a scar into both (McColl, Ding
and Leen, Wear 256 (2004) 1114-1127: depth and width over the cycles, from a finite element program
in which each step of 100 cycles is a whole analysis). Then cylinders that only slip at the edges of
their contact: wear takes the pressure from the slip zones until nothing wears any more.

**Equations.** The depth grows by c E / m in a cycle, with the dissipation E and the weight m of a
node; in gross slip this is Archard's k p |ds|. With the stick zone |x| < b kept, the limit of
partial slip is p = 0 outside it and, inside,

    p = (E* / 2R) sqrt(b^2 - x^2) + [P - pi E* b^2 / (4R)] / (pi sqrt(b^2 - x^2)).

**What to look for.** The table beside the published one; the flat's scar is wider than the
cylinder's, which is always in contact. The stick zone stays the same to a node, and the pressure in
it meets the closed form to first order in the mesh.

The demo shows the table [wear], and how to read the record over the cycles.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
PUBLISHED = {1000: (0.378, 0.22), 5000: (1.131, 0.35), 10000: (1.815, 0.43), 18000: (2.713, 0.52)}
"""Depth in um and width of the scar in mm over the cycles, by McColl, Ding and Leen."""
MESHES = (80, 160, 320)
"""Contact elements of the cylinders in partial slip."""


def published_scar(study: rf.WearStudy) -> float:
    """Print depth and scar beside the published ones; return the largest relative difference."""
    print("cycles   depth, um: cylinder  flat  mean  published   scar, mm: flat  published")
    worst = 0.0
    for cycles, (depth, width) in PUBLISHED.items():
        bodies = [
            [np.interp(cycles, study.cycles, column) for column in body.T]
            for body in np.moveaxis(study.depth_of_bodies, 1, 0)
        ]
        cylinder, flat = (1e3 * np.max(body) for body in bodies)
        scar = np.ptp(study.x[np.array(bodies[1]) > 1e-3 * np.max(bodies[1])])
        mean = 0.5 * (cylinder + flat)
        print(
            f"{cycles:6d}   {cylinder:19.3f} {flat:5.3f} {mean:5.3f} {depth:10.3f} {scar:16.3f} "
            f"{width:10.2f}"
        )
        worst = max(worst, abs(mean / depth - 1.0), abs(scar / width - 1.0))
    return float(worst)


def partial_slip(elements: int) -> tuple[rf.WearStudy | None, float]:
    """Wear cylinders in partial slip to the limit; return the error of the pressure."""
    changes = [f"mesh.contact_elements={elements}", "wear.coefficient=1e-3"]
    changes += [f"body.{name}.width=2.9" for name in ("upper", "lower")]
    study = rf.wear(rf.read_scene(HERE / "half_planes.toml", changes))
    if study is None:
        return None, np.nan
    R, modulus = 100.0, 100.0 / (1.0 - 0.3**2)
    b = np.sqrt(4.0 * R / (np.pi * modulus) * (1.0 - 0.6))
    inside = np.abs(study.x) < 0.8 * b
    root = np.sqrt(b**2 - study.x[inside] ** 2)
    rest = 1.0 - np.pi * modulus * b**2 / (4.0 * R)
    known = modulus / (2.0 * R) * root + rest / (np.pi * root)
    error = float(np.abs(study.pressure[-1][inside] / known - 1.0).max())
    print(
        f"partial slip, {elements + 1} nodes: {study.end} in {len(study.cycles) - 1} steps, stick "
        f"half width {study.stick_half_width.min():.4f} to {study.stick_half_width.max():.4f} "
        f"(closed {b:.4f}), pressure {error:.1e} off"
    )
    return study, error


def figure(scar: rf.WearStudy, slip: rf.WearStudy, path: Path) -> None:
    """Draw the scar of the flat, and the pressures of partial slip."""
    with mpl.rc_context(rf.style.RC):
        drawn = rf.style.new_figure(rf.style.COLUMN, 4.4)
        upper, lower = drawn.subplots(2, 1)
        for cycles, colour in zip(PUBLISHED, rf.style.SERIES_COLOURS, strict=False):
            row = int(np.argmin(np.abs(scar.cycles - cycles)))
            label = f"{scar.cycles[row]:,.0f} cycles"
            upper.plot(scar.x, -1e3 * scar.depth_of_bodies[row, 1], color=colour, label=label)
        upper.set(xlabel="$x$ (mm)", ylabel="scar of the flat (um)")
        upper.legend(loc="lower left")
        deepest = slip.depth.max(axis=1)
        for part, colour in zip((0.0, 0.25, 0.5, 1.0), rf.style.SERIES_COLOURS, strict=False):
            row = int(np.argmin(np.abs(deepest - part * deepest[-1])))
            label = f"{slip.cycles[row]:,.0f} cycles"
            lower.plot(slip.x, slip.pressure[row], color=colour, label=label)
        lower.set(xlabel="$x$", ylabel="$p$ in partial slip", ylim=(0.0, 1.2))
        lower.legend(loc="upper left")
        path.parent.mkdir(parents=True, exist_ok=True)
        drawn.savefig(path)


def main() -> None:
    """Print both tables; assert the published scar and the closed limit."""
    parser = argparse.ArgumentParser(description="Fretting wear.")
    parser.add_argument("--out", default="results/wear", help="folder of the figure")
    out = Path(parser.parse_args().out)
    scar = rf.wear(rf.read_scene(HERE / "wear.toml"))
    slips = [partial_slip(elements) for elements in MESHES]
    if scar is None:  # on the other ranks
        return
    worst = published_scar(scar)
    print(f"depth +- {1e3 * scar.depth_estimate[-1]:.2g} um by steps and mesh")
    assert worst < 0.08, "depth or scar is more than 8 % off the published ones"
    study, error = slips[-1]
    assert error < 0.01, "the pressure of the limit is more than 1 % off"
    assert study is not None
    figure(scar, study, out / "wear.png")


if __name__ == "__main__":
    main()
