"""Dependence of the steady state on the initial slip, and its map over friction and load range.

**Problem.** The paper's block, started not from rest but with a tangential displacement v0 at its
contact nodes, from which the first slip is counted.

**Equations.** Coulomb friction remembers: stick fixes v where it is. If normal and tangential
displacements are coupled (K_tn != 0), different initial slips may lead to different steady cycles;
without coupling all lead to the same dissipation.

**What to look for.** For many initial slips at the paper's values (``rf.steady_states``): the
dissipation of the limit of infinitely many cycles, and the states of the nodes there. Over friction
and minimum load (hundreds of cells): the same dissipation, and its spread over random slips.

The map is a sweep (``rf.sweep``) with a function that takes numbers from each record. Under mpirun
rank 0 hands out the cases; a stopped sweep continues when the demo is started again with the same
--out. ``initial_slip.sbatch`` is a batch script for a cluster.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

BLOCK = Path(__file__).with_name("block.toml")
FRICTION, MINIMUM = 0.35, 1.0 / 3.0
"""Values of the paper."""


def numbers(record: rf.Record) -> dict[str, object]:
    """Return the dissipation of cycle 1 and of the last one, and how many nodes always stick."""
    D, density = record.cycles.dissipation, record.cycles.dissipation_density
    touching = np.all(record.turning_points.state[-2:] != rf.State.SEPARATION, axis=0)
    stuck = touching & (density[-1] <= 1e-9 * density[0].max())
    return {"first": D[0], "last": D[-1], "stuck": int(stuck.sum()), "nodes": len(stuck)}


def random_slips(record: rf.Record, count: int) -> dict[str, object]:
    """Return no slip, and random ones over x, of twice the largest slip of the first loading."""
    size = 2.0 * np.abs(record.turning_points.v[0]).max()
    slips: dict[str, object] = {"none": 0.0}
    for seed in range(1, count):
        random = np.random.default_rng(seed).uniform(-1.0, 1.0, len(record.x))
        slips[f"seed {seed}"] = {"x": record.x.tolist(), "value": (size * random).tolist()}
    return slips


def draw_map(table: rf.SweepTable, folder: Path) -> None:
    """Draw the steady dissipation and its spread over friction and minimum load."""
    D, first = table.grid("last"), table.grid("first")[:, :, 0]
    largest = D.max(axis=2)
    alive = np.where(largest > 1e-6 * np.nanmax(first), 1.0, np.nan)  # less is shakedown
    panels = {
        "steady dissipation over cycle 1 (grey: none)": alive * D[:, :, 0] / first,
        "spread of steady dissipation": np.ptp(D, axis=2) / (alive * largest),
        "spread of permanent stick": np.ptp(table.grid("stuck") / table.grid("nodes"), axis=2),
    }
    f, minimum = (np.array(values, dtype=float) for values in table.labels[:2])
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.PAGE, 2.7)
        for panel, (title, values) in zip(figure.subplots(1, 3), panels.items(), strict=True):
            panel.set_facecolor(rf.style.STATE_COLOURS[rf.State.STICK])
            image = panel.pcolormesh(f, minimum, values.T, cmap="viridis", vmin=0, rasterized=True)
            figure.colorbar(image, ax=panel)
            panel.plot(FRICTION, MINIMUM, "k+", ms=6)
            panel.set(title=title, xlabel="$f$")
        figure.axes[0].set_ylabel("minimum load over $p_0$")
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"initial_slip_map.{suffix}")


def main() -> None:
    """Find the limits from many initial slips, sweep the map, and draw both."""
    parser = argparse.ArgumentParser(description="Steady states from random initial slips.")
    parser.add_argument("--out", type=Path, default=Path("results/initial_slip"))
    parser.add_argument("--nodes", type=int, default=81, help="contact nodes of the whole block")
    parser.add_argument("--samples", type=int, default=200, help="initial slips at the paper's f")
    parser.add_argument("--map", type=int, nargs=2, default=(20, 15), metavar=("F", "MINIMUM"))
    parser.add_argument("--seeds", type=int, default=5, help="initial slips in a cell of the map")
    options = parser.parse_args()
    folder = options.out
    changes = [f"mesh.contact_elements={(options.nodes - 1) // 2}", "history.cycles=400"]
    changes += ['history.until="limit"']
    changes += [f"contact.friction={FRICTION}", f"history.minimum={MINIMUM!r}"]
    changes += ["output.samples_per_leg=1", "output.cycles=[]"]
    scene = rf.read_scene(BLOCK, changes)

    system = rf.condense(scene)
    cells: dict[str, object] = {
        "contact.friction": np.linspace(0.1, 1.05, options.map[0]),
        "history.minimum": np.linspace(0.05, 0.9, options.map[1]),
    }
    states = None
    if system is not None:  # on rank 0
        states = rf.steady_states(system, scene, options.samples)
        cells["history.initial_slip"] = random_slips(rf.evolve(system, scene), options.seeds)
    again = rf.StudyOptions(resume=True, progress=print)
    table = rf.sweep(scene, cells, folder / "map", measure=numbers, options=again)
    if states is None or table is None:
        return
    figure = rf.steady_states_figure(states)
    for suffix in ("png", "pdf"):
        figure.savefig(folder / f"initial_slip.{suffix}")
    draw_map(table, folder)
    low, high = np.array(states.interval) / states.dissipation[0]
    print(
        f"{options.samples} initial slips at f = {FRICTION}: steady dissipation "
        f"{low:.3f} to {high:.3f} of that without; "
        f"{len(table.failed)} of {len(table.rows)} cells of the map failed; figures in {folder}"
    )
    assert states.counts == {"cyclic slip": options.samples}, "a start leads elsewhere"
    assert high - low > 0.05, "the steady state hardly depends on the initial slip"


if __name__ == "__main__":
    main()
