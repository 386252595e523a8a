"""Limit of infinitely many cycles: found early in the cycles, against playing thousands.

**Problem.** The paper's block under its cyclic load, with other friction, Poisson's ratios, minimum
loads and meshes. Its steady state comes slowly: nodes drift, less in every cycle.

**Equations.** As long as the events of a cycle keep their order, their places s_n and the change
delta_n of the displacements over cycle n follow from the cycle before,

    T ds_n = -l_n,   l_n+1 = l_n + C ds_n,   delta_n+1 = delta_n + W^T ds_n,   ds_n = s_n+1 - s_n .

``until = "limit"`` plays until all cycles to come are known to keep it, sums them up, and plays one
cycle from the limit under the full contact law.

**What to look for.** A table of cases: cycles played, differences of dissipation and displacements
from plain cycles, and the time over that of playing until the forces repeat as well. Then the kind
of steady state and its dissipation over friction and minimum load.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

BLOCK = Path(__file__).with_name("block.toml")
PAPER = {"f": 0.35, "poisson": 0.3, "minimum": 1.0 / 3.0}
"""Values of the paper."""
TOLERANCE = 1e-10
"""Change of the forces over a cycle, relative, at which both ways end."""
KINDS = {"cyclic slip": "#e69f00", "shakedown": "#c3cad3", "ratchetting": "#cc79a7"}
"""Kinds of steady state and their colours; white where none was found."""
HEAD = (
    "nodes      f     nu    min kind        played  plain        D/D1 of the limit      dD"
    "        dv  faster"
)
"""Columns of the table."""
Case = dict[str, float]


def scene_of(nodes: int, case: Case) -> rf.Scene:
    """Return the block with so many contact nodes in its half and the values of a case."""
    changes = {
        "mesh.contact_elements": nodes - 1,
        "contact.friction": case["f"],
        "material.poisson": case["poisson"],
        "history.minimum": case["minimum"],
        "output.samples_per_leg": 1,
        "output.cycles": "[]",
        "history.cycles": 5000,
    }
    return rf.read_scene(BLOCK, [f"{key}={value}" for key, value in changes.items()])


def cases_of(count: int) -> list[Case]:
    """Return the paper's case, and random ones."""
    rng, low, high = np.random.default_rng(2008), (0.1, 0.0, 0.0), (1.2, 0.49, 0.9)
    random = rng.uniform(low, high, (count - 1, 3)).round(4)
    return [PAPER, *(dict(zip(PAPER, row, strict=True)) for row in random.tolist())]


def timed(system: rf.ContactSystem, scene: rf.Scene, until: str) -> tuple[rf.Record, float]:
    """Return a record and the processor time it took."""
    begin = time.process_time()
    return rf.evolve(system, scene, until=until), time.process_time() - begin


def compare(nodes: int, case: Case, plain_cycles: int) -> list[float]:
    """Return a row of the table: cycles played, differences, time over time."""
    scene = scene_of(nodes, case)
    system = rf.condense(scene)
    if system is None:  # only rank 0 has it
        return []
    steady = replace(scene, solver=replace(scene.solver, steady_tolerance=TOLERANCE))
    record, seconds = timed(system, scene, "limit")
    settled, longer = timed(system, steady, "steady")
    reference = settled
    if plain_cycles:
        many = replace(scene, history=replace(scene.history, cycles=plain_cycles, until=None))
        reference = rf.evolve(system, many)
    D, E = record.cycles.dissipation, reference.cycles.dissipation
    v, w = (r.turning_points.v[-1] for r in (record, reference))
    limit = record.limit
    assert limit is not None
    row: list[float] = [limit.cycles_played, settled.steady.cycle]
    row += [D[-1] / D[0], abs(D[-1] - E[-1]) / E[0], np.abs(v - w).max() / np.abs(w).max()]
    print(
        f"{nodes:5} {case['f']:6.3f} {case['poisson']:6.3f} {case['minimum']:6.3f} "
        f"{record.steady.kind:12}"
        f"{row[0]:6} {row[1]:6} {row[2]:14.10f} {row[3]:9.1e} {row[4]:9.1e} "
        f"{longer / seconds:6.1f} {'found' if limit.jumped else limit.reason}",
        flush=True,
    )
    return [*row, longer / seconds, limit.reached, limit.jumped]


def numbers(record: rf.Record) -> dict[str, object]:
    """Return what the map shows of a case."""
    D, limit = record.cycles.dissipation, record.limit
    assert limit is not None
    return {
        "kind": record.steady.kind,
        "ratio": D[-1] / D[0],
        "D": D[-1],
        "played": limit.cycles_played,
        "jumped": limit.jumped,
    }


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
            axes.plot(PAPER["f"], PAPER["minimum"], "k+", ms=7)
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"limit_map.{suffix}")


def main() -> None:
    """Print the table of cases and draw the map."""
    parser = argparse.ArgumentParser(description="Limits of infinitely many cycles of the block.")
    parser.add_argument("--out", type=Path, default=Path("results/limit"))
    parser.add_argument("--cases", type=int, nargs="*", default=[81, 12, 161, 3], metavar="N")
    parser.add_argument(
        "--plain", type=int, default=2000, help="plain cycles; 0: until they repeat"
    )
    parser.add_argument("--map", type=int, nargs=2, default=(20, 20), metavar=("F", "MINIMUM"))
    parser.add_argument("--nodes", type=int, default=81, help="nodes of the half body in the map")
    parser.add_argument("--processes", type=int, default=None)
    options = parser.parse_args()
    print(HEAD)
    for nodes, count in zip(options.cases[::2], options.cases[1::2], strict=True):
        rows = np.array([compare(nodes, c, options.plain) for c in cases_of(count)], dtype=float)
        if not rows.size:
            continue
        found = rows[:, 7] == 1.0
        print(
            f"{nodes} nodes: {int(rows[:, 6].sum())} of {count} limits reached, "
            f"{int(found.sum())} found by a search; largest dD {rows[:, 3].max():.1e}, dv "
            f"{rows[:, 4].max():.1e}; at most {int(rows[found, 0].max(initial=0))} cycles played; "
            f"{np.median(rows[:, 5]):.1f} times faster (median)"
        )
        # cycles that end where they repeat to TOLERANCE have not come to their limit
        assert rows[:, 3].max() < (1e-8 if options.plain else 1e-6), "a limit differs"
    scene = scene_of(options.nodes, PAPER)
    scene = replace(scene, history=replace(scene.history, until="limit"))
    cells = {
        "contact.friction": np.linspace(0.1, 1.05, options.map[0]),
        "history.minimum": np.linspace(0.0, 0.9, options.map[1]),
    }
    begin = time.monotonic()
    again = rf.StudyOptions(overwrite=True)
    table = rf.sweep(scene, cells, options.out, options.processes, measure=numbers, options=again)
    if table is None:
        return
    draw_map(table, options.out)
    jumped = sum(bool(j) for j in table["jumped"])
    print(
        f"map of {len(table.rows)} limits: {time.monotonic() - begin:.0f} s on "
        f"{options.processes or 1} processes; {jumped} found by a search, {len(table.failed)} "
        f"failed; figure in {options.out}"
    )


if __name__ == "__main__":
    main()
