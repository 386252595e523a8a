"""Rows of a table history from text files: formats, names of columns, refusals with their line."""

from pathlib import Path

import pytest

import receding_fenicsx as rf
from receding_fenicsx.scene.identity import difference

pytestmark = pytest.mark.one_rank

BODY = """
[[load]]
name = "P"
edge = "top"
pressure = 1.0
[[load]]
name = "Q"
edge = "top"
traction = [1.0, 0.0]
[history]
kind = "table"
"""
ROWS = ((1.0, 0.25), (1.5, -0.5), (1.0, 0.5))
FILE = 'rows = {file = "signal.csv"}\n'
LOOP = 'cycle_rows = {file = "signal.csv"}\n'


def read(folder: Path, text: str, history: str = FILE, body: str = BODY) -> rf.Scene:
    """Read a scene whose history comes from a file of some text."""
    (folder / "signal.csv").write_text(text, encoding="utf-8")
    return rf.from_toml(f"{body}{history}", folder=folder)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n", ""),
        ("P Q\n 1   0.25\n\n1.5  -0.5\n1 0.5 # the end\n", ""),
        (
            "rig three, by hand\n% 3 Hz\ntime [s], P [kN], Q (kN)\ns, kN, kN\n"
            "0, 1, 0.25\n1, 1.5, -0.5\n1, 1, 0.5\n",
            "",
        ),
        ("# T P Q\n0.0 1 0.25\n0.1 1.5 -0.5\n0.2 1 0.5\n", ""),
        # columns name those of a file without header and choose from a header
        ("0 0.25 1\n1 -0.5 1.5\n2 0.5 1\n", 'columns = ["time", "Q", "P"]\n'),
        ("P,room,Q\n1,20,0.25\n1.5,20,-0.5\n1,21,0.5\n", 'columns = ["P", "Q"]\n'),
        # a dwell is one row
        ("time,P,Q\n0,0,0\n1,0,0\n2,1,0.25\n3,1,0.25\n4,1.5,-0.5\n5,1,0.5\n6,1,0.5\n", ""),
    ],
)
def test_every_format_gives_the_same_rows(text: str, columns: str, tmp_path: Path) -> None:
    history = rf.history_from_scene(read(tmp_path, text, columns + FILE))
    assert history.load_names == ("P", "Q")
    assert history.path.tolist() == [[0.0, 0.0], *map(list, ROWS)]


def test_load_of_the_name_t_is_no_time(tmp_path: Path) -> None:
    scene = read(tmp_path, "t,P\n1,0\n0.5,1\n", body=BODY.replace('"Q"', '"t"'))
    assert scene.history.columns == ("t", "P")


def test_measured_block_is_closed_from_its_end_to_its_beginning(tmp_path: Path) -> None:
    text = "P,Q\n1,0.25\n1.5,-0.5\n1.25,0.5\n"
    history = rf.history_from_scene(read(tmp_path, text, LOOP))
    assert history.path.tolist() == [[0, 0], [1.25, 0.5]]
    assert history.loop.tolist() == [[1.25, 0.5], [1, 0.25], [1.5, -0.5], [1.25, 0.5]]
    both = read(tmp_path, text, FILE + LOOP)
    assert rf.history_from_scene(both).path.shape == (4, 2) and both.history.columns == ("P", "Q")


def test_scene_holds_the_rows_and_notices_another_file(tmp_path: Path) -> None:
    scene = read(tmp_path, "P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n")
    assert rf.from_toml(rf.to_toml(scene), folder=tmp_path / "elsewhere") == scene
    other = read(tmp_path, "P,Q\n1,0.25\n1.5,-0.5000001\n1,0.5\n")
    assert difference(scene, other) == "[history] rows"
