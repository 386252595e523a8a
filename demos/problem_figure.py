"""Figure of the problem: a block pressed against a frictional plane (Fig. 2 of Ahn & Barber 2008).

**What to look for.** The block, its load, its dimensions, and the directions of the nodal reactions
P and Q. The demo draws the figure at the head of the README; it needs Matplotlib only.
"""

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

import receding_fenicsx as rf

INK = "#1a1a1a"


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], style: str) -> None:
    """Draw an arrow from start to end."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": style, "lw": 1.0, "color": INK})


def draw() -> plt.Figure:
    """Return the figure; lengths are in units of the height h."""
    figure, axes = plt.subplots(figsize=(6.2, 2.7))
    axes.add_patch(Rectangle((-2.0, 0.0), 4.0, 1.0, facecolor="#e9ecef", edgecolor=INK, lw=1.2))
    axes.add_patch(Rectangle((-2.6, -0.16), 5.2, 0.16, facecolor="none", hatch="////", lw=0.0))
    axes.plot([-2.6, 2.6], [0.0, 0.0], color=INK, lw=1.6)
    for k in range(9):
        x = -1.0 + 0.25 * k
        arrow(axes, (x, 1.34), (x, 1.0), "-|>")
    axes.plot([-1.0, 1.0], [1.34, 1.34], color=INK, lw=1.0)
    axes.text(0.0, 1.4, r"$p_0(t)$ on $|x|<h$", ha="center", va="bottom")
    arrow(axes, (2.25, 0.0), (2.25, 1.0), "<|-|>")
    axes.text(2.33, 0.5, "$h$", va="center")
    arrow(axes, (-2.0, -0.36), (2.0, -0.36), "<|-|>")
    axes.text(0.0, -0.42, "$4h$", ha="center", va="top")
    axes.text(-1.55, 0.55, r"$E,\ \nu$", ha="center")
    arrow(axes, (0.9, 0.02), (0.9, 0.36), "-|>")
    axes.text(0.94, 0.32, r"$P_i,\ w_i$")
    arrow(axes, (0.9, 0.02), (1.3, 0.02), "-|>")
    axes.text(1.34, 0.07, r"$Q_i,\ v_i$")
    axes.text(-2.55, 0.06, "$f$", ha="left", va="bottom")
    arrow(axes, (0.0, 0.0), (0.45, 0.0), "-|>")
    axes.text(0.3, 0.06, "$x$")
    axes.set(xlim=(-2.7, 2.7), ylim=(-0.62, 1.62), aspect="equal")
    axes.axis("off")
    return figure


def main() -> None:
    """Write the figure to the file given by --out."""
    parser = argparse.ArgumentParser(description="Draw the problem.")
    parser.add_argument("--out", default="results/problem.png", help="PNG or PDF file")
    out = Path(parser.parse_args().out)
    out.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(rf.style.RC):
        draw().savefig(out, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    main()
