"""Two equal cylinders pressed together and sheared to and fro: Cattaneo and Mindlin.

**Problem.** Two equal elastic cylinders (friction f) are pressed together by P, then sheared by Q
between 0.6 f P and -0.6 f P at constant P. They are modelled as two large blocks with the initial
gap x^2 / (2 R). Each block stands on a platen, which cannot tip: the shear force would turn a block
that only its pressure holds.

**Equations.** Equal bodies have Dundurs' beta = 0: shear does not change the pressure, which is
Hertz's p0 sqrt(1 - x^2 / a^2). With n(s) = f p0 sqrt(1 - x^2 / s^2) on |x| < s, else 0, the shear
traction and the half width c of the stick zone are

    loading:     q = n(a) - (c / a) n(c),                c = a sqrt(1 - Q / (f P)),
    unloading:   q = -n(a) + 2 (d / a) n(d) - (c_max / a) n(c_max),
                                                         d = a sqrt(1 - (Q_max - Q) / (2 f P)).

**What to look for.** The stick half width within one node spacing, and the tractions within 1 % of
the largest one (except at four nodes beside each end of a zone). Blocks are not half-planes: the
table shows an error that falls as (a / size)^2. The figure has dots at nodes on the closed form.

The demo shows how to shear two bodies by a platen, and how to evaluate samples along the legs.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).parent
closed_forms = rf.reference.closed_forms
HERTZ = closed_forms.Hertz(force=1.0, radius=100.0, modulus=0.5 * 200.0 / (1.0 - 0.3**2))
KNOWN = closed_forms.CattaneoMindlin(HERTZ, f=0.5, largest=0.3)
LEGS = {(0, 1): "loading", (1, 0): "unloading", (1, 1): "reloading"}
"""Names of the legs of shear, by cycle and leg."""
LEFT_OUT = 4
"""Nodes on each side of a zone's end whose tractions are not compared."""
TOLERANCE = 0.01
"""Error allowed of a traction, over the largest pressure (times f for shear)."""


def solve(size: float = 30.0, elements: int = 240) -> rf.Record | None:
    """Run the scene with blocks of some size; the record on rank 0."""
    changes = [f"body.{name}.parameters.size={size}" for name in ("upper", "lower")]
    changes.append(f"mesh.contact_elements={elements}")
    return rf.run(rf.read_scene(HERE / "cattaneo_mindlin.toml", changes))


def compare(record: rf.Record) -> list[tuple[str, float, float, float, float, float]]:
    """Return leg, Q, stick half width here and known, errors of q and p at each sample."""
    s, x = record.samples, record.x
    spacing = float(np.diff(x).max())
    rows = []
    for i in range(len(s.s)):
        leg = LEGS.get((int(s.cycle[i]), int(s.leg[i])))
        if leg is None:
            continue
        Q = float(s.load[i, record.load_names.index("Q")])
        known = KNOWN.stick_half_width(Q, leg)
        found = rf.stick_half_width(x, s.state[i], record.f)
        ends = [HERTZ.a, known, KNOWN.stick_half_width(KNOWN.largest, "loading")]
        apart = [np.abs(np.abs(x) - end) > (LEFT_OUT + 0.5) * spacing for end in ends]
        away = np.all(apart, axis=0)
        # the force of the lower body on the upper one is against Q
        differences = -s.q[i] - KNOWN.traction(x, Q, leg), s.p[i] - HERTZ.pressure(x)
        off = [float(np.abs(part[away]).max()) / HERTZ.p0 for part in differences]
        rows.append((leg, Q, found, known, off[0] / KNOWN.f, off[1]))
    return rows


def figure(record: rf.Record, folder: Path) -> None:
    """Draw the shear tractions of half a cycle: dots at the nodes, lines the closed form."""
    s, x = record.samples, record.x
    with mpl.rc_context(rf.style.RC):
        drawn = rf.style.new_figure(rf.style.COLUMN, 2.8)
        axes = drawn.subplots()
        fine = np.linspace(-HERTZ.a, HERTZ.a, 1001)
        for n, (cycle, leg, at) in enumerate(((0, 1, 1.0), (1, 0, 0.2), (1, 0, 0.5), (1, 0, 1.0))):
            i = np.flatnonzero((s.cycle == cycle) & (s.leg == leg) & np.isclose(s.s, at))[0]
            Q, colour = float(s.load[i, 1]), rf.style.SERIES_COLOURS[n]
            known = KNOWN.traction(fine, Q, LEGS[cycle, leg])
            axes.plot(fine / HERTZ.a, known / (KNOWN.f * HERTZ.p0), color=colour, lw=0.8)
            label = f"{LEGS[cycle, leg]}, $Q = {Q / (KNOWN.f * HERTZ.force):.2f}\\,fP$"
            shown = -s.q[i][::4] / (KNOWN.f * HERTZ.p0)
            axes.plot(x[::4] / HERTZ.a, shown, ".", ms=2.5, color=colour, label=label)
        axes.set(xlim=(-1.15, 1.15), xlabel="$x/a$", ylabel="$q/(f p_0)$")
        drawn.legend(loc="outside lower center", ncols=2)
        folder.mkdir(parents=True, exist_ok=True)
        for suffix in ("png", "pdf"):
            drawn.savefig(folder / f"cattaneo_mindlin.{suffix}")
    print(f"figure written to {folder}")


def main() -> None:
    """Print the errors at three sizes; assert those of the largest."""
    parser = argparse.ArgumentParser(description="Cattaneo and Mindlin.")
    parser.add_argument("--out", default="results/cattaneo_mindlin", help="folder of the figure")
    folder = Path(parser.parse_args().out)
    for size in (15.0, 30.0, 60.0):
        record = solve(size)
        if record is None:
            continue
        spacing = float(np.diff(record.x).max())
        a = rf.half_width_estimates(record, 1, betas=(0.0,))["contact_half_width_estimate"]["value"]
        rows = compare(record)
        worst = np.array([[abs(r[2] - r[3]) / spacing, r[4], r[5]] for r in rows]).max(axis=0)
        print(
            f"size {size:2.0f}: a = {a:.4f} (Hertz {HERTZ.a:.4f}); largest errors: stick width "
            f"{worst[0]:.2f} nodes, q {worst[1]:.1e}, p {worst[2]:.1e}"
        )
    if record is not None:
        figure(record, folder)
        assert worst[0] <= 1.0, "stick half width is off by more than one node"
        assert max(worst[1:]) < TOLERANCE, "tractions are off by more than 1 %"


if __name__ == "__main__":
    main()
