"""Films of a cycle, on any number of ranks."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import receding_fenicsx as rf
from receding_fenicsx.output.snapshots import draw
from receding_fenicsx.output.snapshots.page import Clock, Layout, compose, quantity_of
from receding_fenicsx.output.snapshots.view import View
from receding_fenicsx.pictures import picture_body, shown_instant
from receding_fenicsx.studies import run as study

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
COMM = MPI.COMM_WORLD
FRAMES = 5


def test_film_shows_all_frames_with_the_states_and_the_loads(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[View, Layout, Clock]] = []

    def note(view: View, layout: Any, pixels: Any, colours: Any, clock: Any, _: Any) -> Figure:
        drawn.append((view, layout, clock))
        return compose(view, layout, pixels, colours, clock)

    monkeypatch.setattr(draw, "compose", note)
    heard: list[str] = []
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=16", "history.cycles=1"])
    study.run(scene, shared_tmp_path / "run", study.RunOptions(pictures=False), COMM)
    made = rf.animate(shared_tmp_path / "run", 1, frames=FRAMES, comm=COMM, progress=heard.append)
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
    assert {clock.names for *_, clock in drawn} == {("$p_{0}$",)}
    assert [clock.now for *_, clock in drawn] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
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
    assert width % 2 == height % 2 == 0 and meta["fps"] == 12
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
    assert (pages.info["loop"], pages.size[0]) == (0, 800)
    pages.seek(FRAMES // 2)
    pixels = np.asarray(pages.convert("RGB"))
    for colour in (*rf.style.STATE_COLOURS.values(), rf.style.SHEAR_COLOUR):
        near = np.abs(pixels - 255.0 * np.array(to_rgb(colour))).max(axis=2) < 8.0
        assert near.sum() > 30, f"{colour} does not show"


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("rows", "place"),
    [([(1, 1, 0)], "right"), ([(0, 1, 2)], "left"), ([(1, 0, 0), (0, 0, 2)], "center")],
)
def test_the_legend_of_a_film_is_where_no_frame_has_much_pressure(
    rows: list[tuple[float, ...]], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(draw, "write_film", lambda *_: None)
    seen: list[Clock] = []

    def note(*given: Any) -> list[Figure]:
        seen.extend(given[-1])
        return []

    monkeypatch.setattr(draw, "draw_pages", note)
    parts = {"a": (-2.0, -0.7), "b": (-0.6, 0.6), "c": (0.7, 2.0)}
    scene = replace(
        rf.read_scene(BLOCK, ["mesh.contact_elements=16"]),
        loads=tuple(rf.Load(name, "top", span, pressure=1.0) for name, span in parts.items()),
        history=rf.HistoryOptions("table", columns=tuple(parts), rows=tuple(rows)),
    )
    system = rf.given(rf.condense(scene, COMM))
    record = rf.evolve(system, scene)
    with picture_body(scene, COMM) as bulk:
        legs = [shown_instant(scene, system, record, (0, str(k), 1.0)) for k in range(len(rows))]
        draw.animate(
            bulk, legs, np.linspace(0.0, 1.0, len(rows)), quantity_of("syy"), tmp_path / "film"
        )
    assert {clock.legend for clock in seen} == {f"upper {place}"}
    # each load is over its own largest
    assert np.array_equal(seen[0].load, np.sign(rows))


@pytest.mark.one_rank
def test_failure_of_the_coder_is_said_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blank = [np.zeros((4, 4, 3), np.uint8)]
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: "/bin/false")
    path = tmp_path / "film.mp4"
    with pytest.raises(rf.RecedingError, match="FFmpeg failed"):
        draw.write_film(path, blank)
    assert not path.exists()
