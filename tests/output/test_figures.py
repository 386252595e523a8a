"""Figures: the arrays behind them, what is drawn of them, and which are drawn of which record."""

import io
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import models
import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures, check_words, names_of_colours
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.path import Path as MplPath
from PIL import Image
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.measures.limit_nodes import limit_nodes
from receding_fenicsx.output.plots.figures import _drawings
from receding_fenicsx.output.plots.series import fitted_cycles, representative_nodes, slip_lines
from receding_fenicsx.output.plots.zone_map import timelines_of, zone_map
from receding_fenicsx.output.report.summary import report_html
from receding_fenicsx.scene.history import leg_number
from receding_fenicsx.studies.sweep import measure_record

pytestmark = pytest.mark.one_rank

BLOCK = rf.Scene(loads=(rf.Load("p0", "top", (-1.0, 1.0), pressure=1.0),))

STICK, OPEN, FORWARD, BACKWARD = rf.State


@cache
def record(
    kind: str = "cyclic", method: str = "events", half: bool = True, known: bool = True
) -> rf.Record:
    """Return a record of the paper's block on a coarse mesh."""
    system = models.block_system(40 if half else 80, 20, half=half)
    path = {"unloading": [0.0, 1.0, 0.0], "monotonic": [0.0, 1.0]}
    history = cyclic(10) if kind == "cyclic" else table(system, path[kind])
    found = rf.evolve(system, history, rf.SolverOptions(method=method))
    return replace(found, scene_toml=rf.to_toml(BLOCK)) if known else found


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize(
    ("kind", "cycle", "leg"),
    [("cyclic", 1, 0), ("cyclic", 1, 1), ("cyclic", 9, 0), ("cyclic", 10, 1), ("unloading", 0, 1)],
)
def test_zone_map_from_events_agrees_with_every_sample(
    kind: str, cycle: int, leg: int, half: bool
) -> None:
    found = record(kind, half=half)
    drawn = zone_map(found, cycle, leg)
    table, events = found.samples, found.events
    rows = np.flatnonzero((table.cycle == cycle) & (table.leg == leg) & (table.s < 1.0))
    assert len(rows) > 30
    for row in rows:
        s = float(table.s[row])
        # a sample taken at the very instant of a change may show either state
        changing = events.node[
            (events.cycle == cycle) & (events.leg == leg) & (np.abs(events.s - s) < 1e-9)
        ]
        settled = np.setdiff1d(np.arange(len(found.x)), changing)
        assert np.array_equal(drawn.states(s)[settled], table.state[row][settled])


def test_zones_and_their_boundaries_are_where_nodes_change_their_states() -> None:
    """Pairs of nodes have the same random states: a boundary joins each change of both."""
    found = record(method="gauss-seidel")
    table, x = found.samples, found.x
    rows = np.flatnonzero((table.cycle == 9) & (table.leg == 0))
    state = table.state.copy()
    pairs = np.random.default_rng(1).choice([1, 1, 1, 3, 4], (len(rows), len(x) // 2 + 1))
    state[rows] = np.repeat(pairs, 2, axis=1)[:, : len(x)]
    drawn = zone_map(replace(found, samples=replace(table, state=state)), 9, 0)
    ends = drawn.boundaries.tolist()
    begins, joined = {tuple(point) for line in ends for point in line}, drawn.boundaries[:, :, 0]
    beside, known = [], []
    for i, line in enumerate(drawn.timelines):
        assert {(x[i], s) for s in line.s[1:-1].tolist()} <= begins
        both = np.sum(np.all(joined == [x[i], x[(i + 1) % len(x)]], axis=1))
        assert i % 2 or i + 1 == len(x) or both == len(line.s) - 2 > 5
        for side in (1e-3, -1e-3):
            beside += [(x[i] + side * (x[1] - x[0]), s) for s in 0.5 * (line.s[1:] + line.s[:-1])]
            known += line.state.tolist()
    shown = np.zeros(len(known))
    for zone, polygon in drawn.pieces:
        shown[MplPath(polygon).contains_points(beside)] = zone
    inside = np.abs(np.array(beside)[:, 0]) < x[-1]
    assert np.array_equal(shown[inside], np.array(known)[inside])
    # nodes 3 to 5 begin to slip at the turning point between both legs
    state[:] = 1
    state[(table.cycle == 9) & (table.leg == 1), 3:6] = 3
    drawn = zone_map(replace(found, samples=replace(table, state=state)), 9)
    left, right = 0.5 * (found.x[2] + found.x[3]), 0.5 * (found.x[5] + found.x[6])
    assert [[left, 1.0], [right, 1.0]] in drawn.boundaries.tolist()


def test_slip_lines_find_the_power_that_the_slip_follows() -> None:
    found = record()
    N = np.arange(1.0, 31.0)
    slip = 1e-3 * np.outer(N**-2.5, np.where(np.abs(found.x) < 1.0, 1.0 + found.x, 0.0))
    density = np.zeros_like(slip)
    density[0, 70], density[-1, 50] = 9.0, 1.0
    cycles = replace(found.cycles, slip_increment=slip, dissipation=N, dissipation_density=density)
    made = replace(found, cycles=cycles)
    # paths are drawn of the node that dissipates most in the last cycle
    assert 50 in (nodes := representative_nodes(made)) and 70 not in nodes
    lines = slip_lines(made, unit=2.0)
    assert fitted_cycles(made).tolist() == [*range(4, 21)]
    assert [line.x for line in lines] == pytest.approx([0.5, 0.6, 0.7, 0.8])
    for line in lines:
        assert line.fit.exponent == pytest.approx(-2.5, abs=1e-12)
        assert line.factor * line.N**line.fit.exponent == pytest.approx(line.slip)
        assert line.slip[0] == pytest.approx(0.5e-3 * (1.0 + line.x))


def test_node_at_the_limit_that_never_moves_is_found_where_it_reaches_it() -> None:
    found = record(method="gauss-seidel")
    table = found.samples
    rows = np.flatnonzero(table.cycle == 9)
    node, when = len(found.x) // 2 + 3, rows[len(rows) // 4]
    state, Q, v = table.state.copy(), table.Q.copy(), table.v.copy()
    state[rows[:, None], np.arange(len(found.x))] = rf.State.STICK
    v[rows] = found.turning_points.v[found.turning_points.cycle == 8][-1]
    v[rows, 0] += np.linspace(0.0, 1.0, len(rows))
    v[table.cycle == 10, node] += 1.0  # it slips later
    Q[rows] = 0.5 * found.f * table.P[rows]
    Q[when, node] = found.f[node] * table.P[when, node]
    still = limit_nodes(replace(found, samples=replace(table, state=state, Q=Q, v=v)), 9)
    assert [still.node, still.leg, still.s] == [[node], table.leg[when], table.s[when]]
    assert still.strict and not still.stuck[0]


def test_a_change_between_stick_and_slip_that_is_undone_at_once_is_no_zone() -> None:
    """An opening is one, however short."""
    found = record(method="gauss-seidel")
    rows = np.flatnonzero((found.samples.cycle == 10) & (found.samples.leg == 0))
    state, middle = found.samples.state.copy(), rows[len(rows) // 2]
    state[rows] = STICK
    state[middle, 5], state[middle, 10] = FORWARD, OPEN
    made = replace(found, samples=replace(found.samples, state=state))
    for flicker, alone in ((0.2, [10]), (0.0, [5, 10])):
        lines = timelines_of(made, 10, 0, flicker=flicker)
        assert [i for i, line in enumerate(lines) if len(line.state) > 1] == alone


@pytest.mark.parametrize("force", [True, False])
def test_between_samples_the_end_of_a_zone_passes_its_nodes_one_after_the_other(
    force: bool,
) -> None:
    """Slip spreads from node 9 over 10 to 13; node 14, which was open, slips the other way.

    Nodes 20 to 22 open from 23, which slips all the time, on; 26 and 27 open amid those that stick.
    In a last sample without any force every state is admissible: it has no zones.
    """
    found = record(method="gauss-seidel")
    rows = np.flatnonzero((found.samples.cycle == 10) & (found.samples.leg == 0))
    state, P, last = found.samples.state.copy(), found.samples.P.copy(), rows[-1]
    state[rows], state[rows, 9], state[rows[:-1], 14], P[last] = STICK, BACKWARD, OPEN, force
    state[last, 10:14], state[last, 14], state[rows, 23] = BACKWARD, FORWARD, FORWARD
    state[last, 20:23] = state[last, 26:28] = OPEN
    made = replace(found, samples=replace(found.samples, state=state, P=P))
    before, after = found.samples.s[rows[-2:]]
    changes = {i: line.changes[1:] for i, line in enumerate(timelines_of(made, 10, 0))}
    parts = {10: 0.125, 11: 0.375, 12: 0.625, 13: 0.875, 14: 0.5, 22: 1 / 6, 21: 0.5, 20: 5 / 6}
    for i, part in (parts | {26: 0.5, 27: 0.5}).items():
        new = FORWARD if i == 14 else BACKWARD if i < 20 else OPEN
        s = before + part * (after - before)
        assert changes[i] == ([(pytest.approx(s), new)] if force else [])


def moves_of(found: rf.Record, s: float) -> dict[str, np.ndarray]:
    """Nodes by what they do halfway between two samples of cycle 1's unloading, from v, w, p."""
    table = found.samples
    rows = np.flatnonzero((table.cycle == 1) & (table.leg == 0))
    row = rows[np.searchsorted(table.s[rows], s)]
    before, after = (np.stack([table.v[k], table.w[k]]) for k in (row - 1, row))
    (dv, _), open_ = after - before, (before[1] > 0.0) & (after[1] > 0.0)
    moving = 1e-6 * np.abs(dv[~open_]).max()
    pressed = (table.p[row - 1] > 0.0) & (table.p[row] > 0.0)
    return {
        "separation": open_,
        "stick": pressed & (dv == 0.0),
        "forward slip": pressed & (dv > moving),
        "backward slip": pressed & (dv < -moving),
    }


def amid(nodes: np.ndarray) -> np.ndarray:
    """Nodes both of whose neighbours are among them too."""
    return nodes & np.append(nodes[1:], False) & np.append(False, nodes[:-1])


@pytest.mark.parametrize("half", [True, False])
def test_colours_of_zones_are_those_of_the_legend(half: bool) -> None:
    """What the nodes do is taken from how they move, not from the states."""
    found = record(half=half)
    figure = rf.figures.zone_maps(found, [(1, 0)])
    named = names_of_colours(figure)
    (drawn,) = (c for c in figure.axes[0].collections if isinstance(c, PolyCollection))
    colours = [to_hex(colour) for colour in to_rgba_array(drawn.get_facecolor())]
    seen = set()
    for s in (0.3, 0.6, 0.9):
        load = 1.0 - (s - 0.0125) * 2.0 / 3.0  # samples are 0.025 apart
        for name, nodes in moves_of(found, s).items():
            # the figure shows the right half; a zone's end may lie between the two samples
            for x in found.x[amid(nodes) & (found.x > 0.1)] + 0.25 * np.diff(found.x).min():
                over = [k for k, p in enumerate(drawn.get_paths()) if p.contains_point((x, load))]
                assert named[colours[over[-1]]] == name, (s, x)
                seen.add(name)
    assert len(seen) == 4


def test_colours_and_numbers_of_the_band_are_those_of_the_legend() -> None:
    found = record()
    figure = rf.figures.tractions(found, found.at(1, "minimum"))
    named, band = names_of_colours(figure), figure.axes[0]
    spans = [
        (p.get_transform().transform_path(p.get_path()).get_extents(), to_hex(p.get_facecolor()))
        for p in band.patches
    ]

    def name_at(x: float) -> str:
        dots = float(band.transData.transform((x, 0.0))[0])
        (colour,) = [colour for box, colour in spans if box.x0 <= dots < box.x1]
        return named[colour]

    for name, nodes in moves_of(found, 1.0).items():
        assert {name_at(x) for x in found.x[amid(nodes)]} == {name}
    # the number in the band is that of the legend's text
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    middles, ends = zip(*((0.5 * (box.x0 + box.x1), box.x1) for box, _ in spans), strict=True)
    for text in band.texts:
        assert f"{text.get_text()}  {name_at(text.get_position()[0])}" in labels
        dots = band.transData.transform((text.get_position()[0], 0.0))[0]
        assert np.abs(np.subtract(middles, dots)).min() < 1e-6
    # lines below the band go on from where zones meet
    lines = [np.asarray(line.get_xydata()) for line in figure.axes[1].lines]
    starts = [line[0] for line in lines if np.ptp(line[:, 0]) == 0.0]
    below = figure.axes[1].transData.transform(starts)[:, 0]
    assert below == pytest.approx(sorted(ends)[:-1], abs=1e-6)


def test_nodes_that_slip_are_on_the_edge_of_the_cone_of_either_direction() -> None:
    system = models.block_system(80, 20, half=False)
    found = rf.evolve(replace(system, f_backward=2.0 * system.f), cyclic(1))
    moment = found.at(1, "minimum")
    axes = rf.figures.tractions(found, moment).axes[1]
    (cone,) = (np.asarray(c.get_paths()[0].vertices) for c in axes.collections)
    x, q = np.array(axes.lines[-1].get_data(), dtype=float)
    for state, edge in ((FORWARD, np.min), (BACKWARD, np.max)):
        slips = moment.state == state
        ends = [edge(cone[np.abs(cone[:, 0] - place) < 1e-12, 1]) for place in x[slips]]
        assert slips.sum() > 3 and q[slips] == pytest.approx(ends, abs=1e-12)


FIGURES = (
    "tractions_first_loading zones_first_unloading tractions_first_unloading slip_per_cycle "
    "zones_last_cycle zones_by_cycle dissipation_per_cycle dissipation_density hysteresis "
    "trajectories tractions_last_cycle"
).split()
"""Figures of a block under cycles."""


def test_figures_are_those_that_the_record_holds_something_for() -> None:
    def names(found: rf.Record, everything: bool = True) -> list[str]:
        return [name for name, *_ in _drawings(found, everything)]

    assert names(record("monotonic")) == FIGURES[:1]
    assert names(record("unloading")) == FIGURES[:3]
    shown = rf.figures.FIGURES["tractions_last_cycle"].needs(record())
    assert {moment.cycle for moment in shown} == {len(record().cycles.dissipation)}
    few = ["zones_last_cycle", "dissipation_per_cycle", "hysteresis", "tractions_last_cycle"]
    assert names(record(), False) == few
    assert names(record()) == names(record(known=False)) == FIGURES
    # without samples, and of one cycle alone
    bare = rf.OutputOptions(cycles=())
    found = rf.evolve(models.block_system(20, 10), cyclic(1), output=bare)
    assert names(found) == [FIGURES[0], FIGURES[2], "dissipation_density", FIGURES[-1]]
    assert rf.summarise(found)["limit_without_slip"] == []
    told = []
    for name, each in rf.figures.FIGURES.items():
        # whether it answers the question of a run whose last cycle is 0, 1 or 2
        main = [each.main(k) if callable(each.main) else each.main for k in range(3)]
        kind = " of each" * each.each + " of all edges" * each.all_edges
        told.append(f"{name}{kind} {main}: {each.caption}")
    check_words(told, REPORTS / "registered.txt")


def test_a_registered_figure_is_drawn_where_its_data_are_and_has_its_caption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rf.figures, "FIGURES", dict(rf.figures.FIGURES))

    @rf.figures.figure("slipping", needs=lambda r: r.cycles.dissipation[:1], caption="A < B")
    def _(found: rf.Record, first: np.ndarray) -> Figure:
        figure = rf.style.new_figure(2.0, 2.0)
        figure.suptitle(f"{first[0]:.3g}")
        return figure

    names = [[name for name, _ in rf.figures.draw_all(record(k))] for k in ("cyclic", "monotonic")]
    assert names == [[*FIGURES, "slipping"], FIGURES[:1]]
    path = tmp_path / "slipping.png"
    Image.new("RGB", (8, 8)).save(path)
    assert "<figcaption>A &lt; B</figcaption>" in report_html(rf.summarise(record()), "", [path])


def test_files_captions_and_tables_of_two_edges_are_what_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two layers on a plane; what is of a single edge is in a folder of the edge."""
    coarse = ["mesh.contact_elements=16", "history.cycles=2", "load.P.pressure=3"]
    scene = rf.read_scene(Path(__file__).parents[2] / "demos" / "stack.toml", coarse)
    record = rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)
    monkeypatch.setattr(
        rf.figures, "save", lambda _, path: Image.new("RGB", (8, 8)).save(path, "png")
    )
    made = rf.figures.plot_all(record, tmp_path / "figures", ("png", "pdf"))
    summary = rf.summarise(record)
    page = report_html(summary, "", [path for path in made if path.suffix == ".png"])
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    texts = rf.run_table(summary, everything=True), rf.run_table(summary)
    last = zip(2 * ["minimum"] + 2 * ["maximum"], summary["turning_points"][-4:], strict=True)
    known = {f"p_max_at_{load}.{point['edge']}": point["p_max"] for load, point in last}
    assert known.items() <= measure_record(record).items() and len(known) == 4
    files = [str(path.relative_to(tmp_path)) for path in made]
    check_words([*files, *captions, *"\n".join(texts).splitlines()], REPORTS / "edges.txt")


def test_the_same_record_gives_the_same_files_of_the_width_asked_for(tmp_path: Path) -> None:
    """A file is written a second time over the first."""
    made = rf.figures.plot_all(record("monotonic"), tmp_path)
    (drawing,) = rf.figures.plot_all(record("monotonic"), tmp_path, "svg")
    assert "<svg" in (text := drawing.read_text()) and "<dc:date>" not in text
    first = [path.read_bytes() for path in made]
    assert [path.name for path in made] == [f"{FIGURES[0]}.{end}" for end in ("png", "pdf")]
    assert first[1].startswith(b"%PDF")
    with pytest.raises(rf.InputError, match=r"no format 'docx'; use one of .*pdf.*png"):
        rf.figures.plot_all(record("monotonic"), tmp_path, "docx")
    assert [p.read_bytes() for p in rf.figures.plot_all(record("monotonic"), tmp_path)] == first
    image = Image.open(made[0])
    assert image.size[0] == pytest.approx(rf.style.COLUMN * rf.style.DPI, abs=12)
    # states and curves are in it: their colours are
    pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    states = (rf.style.STATE_COLOURS[s] for s in (STICK, FORWARD, BACKWARD))
    for colour in (*states, rf.style.SHEAR_COLOUR):
        assert np.all(pixels == np.round(255.0 * np.array(to_rgb(colour))), axis=1).sum() > 100


def test_figures_show_in_a_notebook() -> None:
    alone = rf.figures.tractions(record(), record().at(9, "minimum"))
    image = Image.open(io.BytesIO(alone._repr_png_()))  # type: ignore[attr-defined]
    assert image.size[0] == pytest.approx(rf.style.COLUMN * rf.style.NOTEBOOK_DPI, abs=2)
    assert len(rf.figures.zone_maps(record(), 9).axes) == 2


def test_what_cannot_be_drawn_is_refused_in_one_line() -> None:
    """Nothing of the kind is there, or nothing of it to show."""
    found, cycles = record(), record().cycles
    nothing, resting = np.zeros_like(cycles.slip_increment), np.zeros_like(found.samples.P)
    open_, changes = np.full_like(found.samples.state, OPEN), dict[str, dict[str, Any]]()
    changes["slip_per_cycle"] = {"cycles": replace(cycles, slip_increment=nothing)}
    changes["trajectories"] = {"samples": replace(found.samples, P=resting, p=resting, state=open_)}
    changes["hysteresis"] = {
        name: replace(table, load_displacement=np.full_like(table.load_displacement, np.nan))
        for name, table in (("turning_points", found.turning_points), ("samples", found.samples))
    }
    asked = {
        "zone_maps": ("nine", [], [(1,)], [(1, 7)], [(5, 0)], [(1, 0.5)]),
        "tractions": (9, [], [9]),
        "hysteresis": (5, []),
        "trajectories": ([-1], [81], [], 0.5),
        "probe_stresses": ("rwo",),
    }
    calls: list[Any] = [(name, found, what) for name, all_ in asked.items() for what in all_]
    calls += [(name, replace(found, **change)) for name, change in changes.items()]
    said = []
    for name, *given in calls:
        with pytest.raises(rf.InputError) as caught:
            getattr(rf.figures, name)(*given)
        said.append(str(caught.value))
    check_words(said, REPORTS / "refused.txt")


def test_dissipation_is_drawn_over_all_cycles_and_another_method_beside() -> None:
    found, other = record(known=False), record(method="gauss-seidel")
    drawn = {"both": rf.figures.dissipation_per_cycle(found, stepped=other)}
    for cycles in (3, 20, 1000):
        D = 3.0 / np.arange(1.0, cycles + 1.0)
        part = replace(found, cycles=replace(found.cycles, dissipation=D))
        drawn[f"{cycles} cycles"] = rf.figures.dissipation_per_cycle(part)
    check_figures(drawn.items(), REPORTS / "dissipation.txt")
    both = [part.cycles.dissipation for part in (found, other)]
    check_curves(drawn["both"].axes[0], *((range(1, 11), D / D[0]) for D in both))


def test_nothing_sticks_where_there_is_no_friction() -> None:
    system = models.block_system(40, 20)
    found = rf.evolve(replace(system, f=np.zeros(system.n)), cyclic(2, minimum=0.5))
    low = found.at(1, "minimum")
    assert low.zones[len(low.zones) // 2][0] == "contact"
    text = rf.run_table(rf.summarise(found), everything=True)
    assert "contact to" in text and "stick to" not in text
    (both,) = rf.style.state_patches([1], [False, True])
    assert both.get_label() == "1  stick, or contact without friction"
    draw = rf.figures
    drawn = draw.tractions(found, low), draw.zone_maps(found, 1), draw.trajectories(found)
    names = "tractions", "zones", "trajectories"
    check_figures(zip(names, drawn, strict=True), REPORTS / "frictionless.txt")


def around(legs: int, cycles: int = 2) -> rf.Record:
    """Return a record of two uncoupled nodes under two loads whose cycle is a polygon."""
    angle = np.linspace(0.0, 2.0 * np.pi, legs + 1)
    loop = np.stack([1.0 + 0.3 * np.cos(angle), 0.2 * np.sin(angle)], axis=1).round(12)
    loop[-1] = loop[0]
    loads = {"a": np.repeat([0.1, 1.0], 2), "b": np.repeat([0.2, 0.5], 2)}
    system = small_system(np.kron([[2.0, 0.3], [0.3, 1.0]], np.eye(2)), loads, 0.5)
    history = table(system, [[0.0, 0.0], loop[0]], loop, cycles)
    return rf.evolve(system, history, output=rf.OutputOptions(samples_per_leg=2, cycles="all"))


@pytest.mark.parametrize("unit", [1e-3, -1.0, 1e3])
def test_the_largest_load_does_not_depend_on_unit_and_sign_of_one_of_several(unit: float) -> None:
    loads = {"a": np.repeat([0.1, 1.0], 2), "b": np.repeat([0.02, 0.05], 2) / unit}
    system = small_system(np.kron([[2.0, 0.3], [0.3, 1.0]], np.eye(2)), loads, 0.5)
    path = np.array([[0.0, 0.0], [1.0, 5.0], [0.6, 6.0]]) * [1.0, unit]
    shown, found = rf.figures.FIGURES, rf.evolve(system, table(system, path))
    # 1 + 5/6 is more than 0.6 + 1: the second leg unloads
    assert shown["tractions_first_loading"].needs(found).leg == 0
    assert shown["zones_first_unloading"].needs(found) == [(0, 1)]
    history = table(system, path)
    assert [leg_number(history, name, 0) for name in ("loading", "unloading")] == [0, 1]


@pytest.mark.parametrize("legs", [7, 45])
def test_a_cycle_of_many_legs_is_one_map_with_the_loads_beside_it(legs: int) -> None:
    record = around(legs, 3 if legs == 7 else 2)
    drawn = dict(rf.figures.draw_all(record))
    check_figures(drawn.items(), REPORTS / f"legs_{legs}.txt")
    table = record.turning_points
    loads = table.load[-legs - 1 :] / np.abs(table.load).max(axis=0)
    lines = ((load, np.arange(legs + 1.0)) for load in loads.T)
    check_curves(drawn["zones_last_cycle"].axes[-1], *lines, ([0.0, 0.0], [0.0, 1.0]))


def test_zones_of_several_cycles_fill_one_page() -> None:
    """Each cycle begins a row; of too many for a page the last one is shown."""
    titles = [rf.style.panel_title(n, 60, "x") for n in (0, 25, 26, 53)]
    assert titles == ["(a) x", "(z) x", "(aa) x", "(bb) x"]
    records = {legs: around(legs, cycles) for legs, cycles in ((4, 4), (5, 5))}
    draw = rf.figures.FIGURES["zones_by_cycle"].draw
    drawn = ((f"{legs} legs", draw(found, None)) for legs, found in records.items())
    check_figures(drawn, REPORTS / "zones.txt")


@pytest.mark.parametrize("peak", [1.0, 40.0])
def test_a_peak_is_cut_off_alike_on_both_sides_of_the_axis(peak: float) -> None:
    p = np.append(np.zeros(20), np.linspace(1.0, 2.0, 40))
    p[-1] *= peak
    low, high = rf.style.focus(p, -0.3 * p)
    room = 0.06 * (high - low) / 1.12
    # a tenth of the nodes that touch may belong to the peak, of which 2.5 times the rest is seen
    top = min(p.max(), 2.5 * np.percentile(p[20:], 90.0))
    assert (low + room, high - room) == pytest.approx((-0.3 * top, top))
