"""Films of a cycle, on any number of ranks."""

from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from receding_fenicsx import read_scene, study
from receding_fenicsx.errors import InputError, RecedingError, on_root
from receding_fenicsx.output import animation, style
from receding_fenicsx.pictures import animate

BLOCK = Path(__file__).parent.parent / "demos" / "block.toml"
COMM = MPI.COMM_WORLD
FRAMES = 5


def film(folder: Path) -> list[Path] | None:
    """Run the block on a coarse mesh for one cycle and make a film of it."""
    scene = read_scene(BLOCK, ["mesh.contact_elements=16", "history.cycles=1"])
    study.run(scene, folder, COMM, pictures=False)
    return animate(folder, 1, frames=FRAMES, comm=COMM)


def test_film_shows_all_frames_with_the_states_and_the_loads(shared_tmp_path: Path) -> None:
    made = film(shared_tmp_path / "run")
    if COMM.rank != 0:
        assert made is None
        return
    assert made is not None
    mp4, gif = made
    assert [path.name for path in made] == ["cycle0001_max_shear.mp4", "cycle0001_max_shear.gif"]
    reader = imageio_ffmpeg.read_frames(str(mp4))
    meta = next(reader)
    width, height = meta["size"]
    assert width == pytest.approx(style.PAGE * animation.FILM_DPI, abs=2)
    assert width % 2 == height % 2 == 0
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]
    assert len(frames) == FRAMES + animation.HELD
    # the last picture stands still, the ones before differ
    for a, b in pairwise(frames[:FRAMES]):
        assert np.abs(a.astype(int) - b).mean() > 1.0
    for frame in frames[FRAMES:]:
        assert np.abs(frames[FRAMES - 1].astype(int) - frame).mean() < 1.0
    # at a third of the load, in the middle, all four states occur (paper, Fig. 5)
    for state, colour in style.STATE_COLOURS.items():
        near = np.abs(frames[FRAMES // 2] - 255.0 * np.array(to_rgb(colour))).max(axis=2) < 12.0
        assert near.sum() > 300, f"state {state} does not show"
    pages = Image.open(gif)
    assert pages.n_frames == FRAMES  # type: ignore[attr-defined]
    assert pages.info["loop"] == 0
    assert pages.size[0] == animation.GIF_WIDTH
    pages.seek(FRAMES // 2)
    pixels = np.asarray(pages.convert("RGB"))
    for colour in (*style.STATE_COLOURS.values(), style.SHEAR_COLOUR):
        near = np.abs(pixels - 255.0 * np.array(to_rgb(colour))).max(axis=2) < 8.0
        assert near.sum() > 30, f"{colour} does not show"


def test_failure_of_the_coder_is_said_and_leaves_no_file(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check() -> None:
        blank = [np.zeros((4, 4, 3), np.uint8)]
        monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: "/bin/false")
        path = shared_tmp_path / "film.mp4"
        with pytest.raises(RecedingError, match="FFmpeg failed"):
            animation.write_mp4(path, blank)
        assert not path.exists()

    on_root(COMM, check)


def test_unknown_stress_is_refused_with_the_known_ones(shared_tmp_path: Path) -> None:
    with pytest.raises(InputError, match="max_shear"):
        animate(shared_tmp_path, 1, stress="szz", comm=COMM)
