"""Films of a cycle, on any number of ranks."""

from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import imageio_ffmpeg
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.output.snapshots import animation, draw
from receding_fenicsx.output.snapshots.colours import quantity_of
from receding_fenicsx.output.snapshots.page import RIGHT, Clock, Layout, _draw_clock, compose
from receding_fenicsx.output.snapshots.view import View
from receding_fenicsx.studies import run as study
from receding_fenicsx.timing import Timer

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
COMM = MPI.COMM_WORLD
FRAMES = 5


def film(folder: Path, heard: list[str]) -> list[Path] | None:
    """Run the block on a coarse mesh for one cycle and make a film of it."""
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=16", "history.cycles=1"])
    study.run(scene, folder, study.RunOptions(pictures=False), COMM)
    return rf.animate(folder, 1, frames=FRAMES, comm=COMM, progress=heard.append)


def test_film_shows_all_frames_with_the_states_and_the_loads(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[View, Layout, Clock]] = []

    def note(view: View, layout: Any, pixels: Any, colours: Any, clock: Any, _: Any) -> Figure:
        drawn.append((view, layout, clock))
        return compose(view, layout, pixels, colours, clock)

    monkeypatch.setattr(draw, "compose", note)
    heard: list[str] = []
    made = film(shared_tmp_path / "run", heard)
    if COMM.rank != 0:
        assert made is None and heard == []
        return
    assert made is not None
    for what in ("fields", "frames"):
        told = [text.split(",")[0] for text in heard if text.startswith(what)]
        assert told == [f"{what}: {n} of {FRAMES}" for n in range(FRAMES)]
    # the page stays as it is, with room for the tractions of all frames
    assert len(drawn) == FRAMES and len({layout for _, layout, _ in drawn}) == 1
    assert len({clock.tractions for *_, clock in drawn}) == 1
    low, high = drawn[0][2].tractions
    for view, _, clock in drawn:
        curves = np.concatenate([view.p, view.q, *view.f.limits(view.p)])
        assert low <= curves.min() and curves.max() <= high
        # over the largest load, in all frames
        assert view.pressure_symbol == r"p_{0}^{\,\mathrm{max}}"
        assert view.p.max() < 1.2 * clock.now_load[0]
    assert [clock.now_load[0] for *_, clock in drawn] == pytest.approx([1, 2 / 3, 1 / 3, 2 / 3, 1])
    mp4, gif = made
    assert [path.name for path in made] == ["cycle0001_max_shear.mp4", "cycle0001_max_shear.gif"]
    reader = imageio_ffmpeg.read_frames(str(mp4))
    meta = next(reader)
    width, height = meta["size"]
    assert width == pytest.approx(1280, abs=2)
    assert width % 2 == height % 2 == 0
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]
    assert len(frames) == FRAMES + 6
    # the last picture stands still, the ones before differ
    for a, b in pairwise(frames[:FRAMES]):
        assert np.abs(a.astype(int) - b).mean() > 1.0
    for frame in frames[FRAMES:]:
        assert np.abs(frames[FRAMES - 1].astype(int) - frame).mean() < 1.0
    # at a third of the load, in the middle, all four states occur (paper, Fig. 5)
    for state, colour in rf.style.STATE_COLOURS.items():
        near = np.abs(frames[FRAMES // 2] - 255.0 * np.array(to_rgb(colour))).max(axis=2) < 12.0
        assert near.sum() > 300, f"state {state} does not show"
    pages = Image.open(gif)
    assert pages.n_frames == len(frames)  # type: ignore[attr-defined]
    assert pages.info["loop"] == 0
    assert pages.size[0] == 800
    pages.seek(FRAMES // 2)
    pixels = np.asarray(pages.convert("RGB"))
    for colour in (*rf.style.STATE_COLOURS.values(), rf.style.SHEAR_COLOUR):
        near = np.abs(pixels - 255.0 * np.array(to_rgb(colour))).max(axis=2) < 8.0
        assert near.sum() > 30, f"{colour} does not show"


@pytest.mark.one_rank
def test_axis_of_a_film_that_ends_unloaded_has_room_for_the_largest_tractions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = ["mesh.contact_elements=16", "history.rows=[[4.0], [0.0]]"]
    scene = rf.read_scene(BLOCK.with_name("unloading.toml"), settings)
    system = rf.given(study.condense(scene, MPI.COMM_SELF))
    record = rf.evolve(system, scene)
    instants = [rf.instant_of(scene, system, record, 0, "1", s) for s in (0.0, 0.5, 0.9)]
    bulk = bulk_of(scene, MPI.COMM_SELF, Timer())
    made = [fields_at(bulk, now.load, np.concatenate([now.v, now.state.w])) for now in instants]
    fields = [found for found in made if found is not None]
    drawn: list[tuple[View, Clock]] = []

    def note(view: View, page: Any, pixels: Any, colours: Any, clock: Any, _: Any) -> Figure:
        drawn.append((view, clock))
        return Figure(figsize=(1.0, 1.0))

    monkeypatch.setattr(draw, "compose", note)
    monkeypatch.setattr(draw, "render", lambda *_: None)
    film = animation.Scenario(instants, np.array([0.0, 0.5, 0.9]))
    animation.draw_frames(bulk, film, fields, quantity_of("max_shear"))
    bulk.destroy()
    largest = max(view.p.max() for view, _ in drawn)
    assert largest == drawn[0][0].p.max() > 5.0 * drawn[-1][0].p.max()
    # all over the largest load, which is 4
    assert 0.7 < largest < 1.3
    assert np.array([clock.load[:, 0] for _, clock in drawn]) == pytest.approx(
        np.tile([1.0, 0.5, 0.1], (3, 1))
    )
    for part, (_, clock) in zip((1.0, 0.5, 0.1), drawn, strict=True):
        assert clock.now_load[0] == pytest.approx(part)
        assert clock.tractions[1] >= largest


@pytest.mark.one_rank
def test_film_of_two_bodies_merges_no_vertices_of_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = rf.read_scene(BLOCK.with_name("layer.toml"), ["mesh.contact_elements=16"])
    bulk = bulk_of(scene, MPI.COMM_SELF, Timer())
    free = np.zeros(len(bulk.contact.x))
    state = rf.ContactState(
        np.zeros(2 * len(free)), np.zeros(2 * len(free)), free.astype(np.int8) + 1
    )
    rest = Instant(0, 0, 0.0, np.zeros(len(bulk.load_names)), free, state)
    drawn: list[Fields] = []
    monkeypatch.setattr(animation, "draw_frames", lambda b, film, fields, *_: drawn.extend(fields))
    monkeypatch.setattr(animation, "write_film", lambda *_: None)
    scenario = animation.Scenario([rest], np.array([0.0]))
    animation.animate(bulk, scenario, quantity_of("von_mises"), tmp_path / "film")
    whole = fields_at(bulk, rest.load, np.zeros(2 * len(free)))
    bulk.destroy()
    assert whole is not None and whole.body is not None
    (found,) = drawn
    assert list(found.stress) == ["von_mises"]
    assert found.body is not None and np.array_equal(found.body, whole.body)


@pytest.mark.one_rank
@pytest.mark.parametrize("now", [0.0, 0.5, 1.0])
def test_dots_of_the_dial_lie_on_no_number(now: float) -> None:
    time = np.array([0.0, 0.5, 1.0])
    load = np.array([[1.0, 0.5], [-1.0, 1.0], [1.0, 0.5]])
    here = np.array([np.interp(now, time, column) for column in load.T])
    clock = Clock(time, load, ("P", "Q"), now, here, (0.0, 1.0))
    with mpl.rc_context(rf.style.RC):
        # the size that the dial has on the page
        figure = Figure(figsize=(4.0, 3.0), dpi=200)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.5, 0.5, (RIGHT - 0.5) / 4.0, 0.2))
        _draw_clock(axes, clock)
        canvas.draw()
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    assert len(dots) == 2
    for dot, curve in zip(dots, axes.lines[0::2], strict=True):
        assert dot.get_color() == curve.get_color()
        assert dot.get_ydata() == pytest.approx(np.interp(now, *np.asarray(curve.get_xydata()).T))
    for dot in dots:
        x, y = axes.transData.transform(dot.get_xydata())[0]
        radius = 0.5 * dot.get_markersize() * figure.dpi / 72.0
        for label in axes.get_yticklabels():
            box = label.get_window_extent()
            off = np.hypot(max(box.x0 - x, x - box.x1, 0.0), max(box.y0 - y, y - box.y1, 0.0))
            assert off > radius, label.get_text()


@pytest.mark.one_rank
@pytest.mark.parametrize("lowest", [-0.9714, -1.0 / 3.0, 0.0])
def test_numbers_at_the_loads_of_a_film_are_not_cut_at_the_edge(lowest: float) -> None:
    load = np.array([[1.0, 0.3], [0.5, lowest], [1.0, 0.3]])
    clock = Clock(np.linspace(0.0, 1.0, 3), load, ("P", "Q"), 0.5, load[1], (0.0, 1.0))
    with mpl.rc_context(rf.style.RC):
        figure = Figure(figsize=(4.0, 3.0), dpi=200)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.5, 0.5, (RIGHT - 0.5) / 4.0, 0.2))
        _draw_clock(axes, clock)
        canvas.draw()
        end = axes.get_position().x1 * 4.0 + 0.5 - 0.22
        for label in axes.get_yticklabels():
            assert label.get_window_extent().x1 / figure.dpi < end, label.get_text()


@pytest.mark.one_rank
def test_legend_of_a_film_is_where_the_pressure_is_low_in_all_pictures() -> None:
    x = np.linspace(-1.0, 1.0, 61)
    hill, edges, left = 1.0 - x**2, 0.1 + x**4, 1.0 - x
    assert animation.free_place(x, np.array([hill, 0.1 * hill])) in ("upper right", "upper left")
    assert animation.free_place(x, np.array([0.1 * edges, edges])) == "upper center"
    assert animation.free_place(x, np.array([left, 0.5 * left])) == "upper right"
    assert animation.free_place(x, np.array([left[::-1], 0.1 * edges])) == "upper left"
    nowhere = np.where(np.abs(x) > 0.9, np.nan, edges)
    assert animation.free_place(x, np.array([nowhere])) == "upper center"


@pytest.mark.one_rank
def test_failure_of_the_coder_is_said_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blank = [np.zeros((4, 4, 3), np.uint8)]
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: "/bin/false")
    path = tmp_path / "film.mp4"
    with pytest.raises(rf.RecedingError, match="FFmpeg failed"):
        animation.write_film(path, blank)
    assert not path.exists()


def test_unknown_stress_is_refused_with_the_known_ones(shared_tmp_path: Path) -> None:
    with pytest.raises(rf.InputError, match="max_shear"):
        rf.animate(shared_tmp_path, 1, stress="szz", comm=COMM)
