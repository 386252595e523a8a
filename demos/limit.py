"""Limit of infinitely many cycles: found early in the cycles, against playing thousands.

**Problem.** The paper's block under its cyclic load, with other friction, Poisson's ratios, minimum
loads and meshes. Its steady state comes slowly: nodes drift, less in every cycle.

**Equations.** As long as the events of a cycle keep their order, their places s_n and the change
delta_n of the displacements over cycle n follow from the cycle before,

    T ds_n = -l_n,   l_n+1 = l_n + C ds_n,   delta_n+1 = delta_n + W^T ds_n,   ds_n = s_n+1 - s_n .

``until = "limit"`` plays until all cycles to come are known to keep it, sums them up, and plays one
cycle from the limit under the full contact law.

**What to look for.** The cycles played, and the differences of dissipation and displacements from
2000 plain cycles, for the paper's values and random ones. Then the kind of steady state and its
dissipation over friction and minimum load.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

BLOCK = Path(__file__).with_name("block.toml")
PLAIN_CYCLES = 2000
"""Cycles that the limit is compared with."""
PAPER = (0.35, 0.3, 1.0 / 3.0)
"""Friction, Poisson's ratio and minimum load of the paper."""
KINDS = {"cyclic slip": "#e69f00", "shakedown": "#c3cad3", "ratchetting": "#cc79a7"}
"""Kinds of steady state and their colours; white where none was found."""


def scene_of(nodes: int, f: float, poisson: float, minimum: float) -> rf.Scene:
    """Return the block with so many contact nodes in its half."""
    changes = [f"mesh.contact_elements={nodes - 1}", f"contact.friction={f}"]
    changes += [f"material.poisson={poisson}", f"history.minimum={minimum}"]
    changes += ['history.until="limit"', "history.cycles=5000"]
    return rf.read_scene(BLOCK, [*changes, "output.samples_per_leg=1", "output.cycles=[]"])


def compare(nodes: int, f: float, poisson: float, minimum: float) -> None:
    """Print a row of the table; assert that the limit is that of plain cycles."""
    scene = scene_of(nodes, f, poisson, minimum)
    system = rf.condense(scene)
    if system is None:  # only rank 0 has it
        return
    record = rf.evolve(system, scene)
    all_cycles = replace(scene.history, cycles=PLAIN_CYCLES, until=None)
    plain = rf.evolve(system, replace(scene, history=all_cycles))
    D, E = record.cycles.dissipation, plain.cycles.dissipation
    v, w = (r.turning_points.v[-1] for r in (record, plain))
    limit = rf.given(record.limit)
    errors = abs(D[-1] - E[-1]) / E[0], np.abs(v - w).max() / np.abs(w).max()
    print(
        f"{f:6.3f} {poisson:6.3f} {minimum:6.3f} {record.steady.kind:12}{limit.cycles_played:6} "
        f"{D[-1] / D[0]:14.10f} {errors[0]:9.1e} {errors[1]:9.1e}",
        flush=True,
    )
    assert limit.reached and max(errors) < 1e-8, "the limit differs from plain cycles"


def numbers(record: rf.Record) -> dict[str, object]:
    """Return what the map shows of a case."""
    return {"kind": record.steady.kind, "D": record.cycles.dissipation[-1]}


def draw_map(table: rf.SweepTable, folder: Path) -> None:
    """Draw kind of steady state and dissipation over friction and minimum load."""
    f, minimum = (np.array(values, dtype=float) for values in table.labels)
    kinds, D = table.grid("kind"), table.grid("D")
    number = np.vectorize(lambda kind: list(KINDS).index(kind) if kind in KINDS else np.nan)(kinds)
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.PAGE, 3.0)
        left, right = figure.subplots(1, 2, sharey=True)
        colours = mpl.colors.ListedColormap(list(KINDS.values()))
        left.pcolormesh(f, minimum, number.T, cmap=colours, vmin=-0.5, vmax=2.5, rasterized=True)
        for kind, colour in KINDS.items():
            if np.any(kinds == kind):
                left.plot([], [], "s", color=colour, mec="black", label=kind)
        left.legend(loc="upper left", framealpha=1.0)
        left.set(title="kind of steady state", xlabel="$f$", ylabel="minimum load over $p_0$")
        alive = np.where(kinds == "cyclic slip", D, np.nan)
        right.set_facecolor(KINDS["shakedown"])
        image = right.pcolormesh(f, minimum, alive.T, cmap="viridis", vmin=0.0, rasterized=True)
        figure.colorbar(image, ax=right, label=r"$D_\infty$ per cycle $\times E/(p_0 h)^2$")
        right.set(title="dissipation of the limit cycle", xlabel="$f$")
        for axes in (left, right):
            axes.plot(PAPER[0], PAPER[2], "k+", ms=7)
    rf.figures.save(figure, folder / "limit_map.png")


def main() -> None:
    """Print the table of cases and draw the map."""
    parser = argparse.ArgumentParser(description="Limits of infinitely many cycles of the block.")
    parser.add_argument("--out", type=Path, default=Path("results/limit"))
    parser.add_argument("--nodes", type=int, default=81, help="contact nodes of the half body")
    parser.add_argument("--random", type=int, default=5, help="cases beside the paper's")
    parser.add_argument("--map", type=int, nargs=2, default=(20, 20), metavar=("F", "MINIMUM"))
    parser.add_argument("--workers", type=int, default=None, help="processes of the map")
    options = parser.parse_args()
    print("     f     nu    min kind        played     D/D1 of limit        dD        dv")
    rng = np.random.default_rng(2008)
    random = rng.uniform((0.1, 0.0, 0.0), (1.2, 0.49, 0.9), (options.random, 3)).round(4)
    for case in (PAPER, *random.tolist()):
        compare(options.nodes, *case)
    cells = {
        "contact.friction": np.linspace(0.1, 1.05, options.map[0]),
        "history.minimum": np.linspace(0.0, 0.9, options.map[1]),
    }
    scene, again = scene_of(options.nodes, *PAPER), rf.StudyOptions(overwrite=True)
    table = rf.sweep(scene, cells, options.out, options.workers, numbers, again)
    if table is not None:
        draw_map(table, options.out)
        print(f"{len(table.failed)} of {len(table.rows)} cells failed; figure in {options.out}")


if __name__ == "__main__":
    main()
