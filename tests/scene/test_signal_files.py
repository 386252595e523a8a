"""Rows of a table history from text files: formats, names of columns, refusals with their line."""

from pathlib import Path

from mpi4py import MPI

import pytest

import receding_fenicsx as rf
from receding_fenicsx.scene.identity import difference

comm = MPI.COMM_WORLD
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


def put(folder: Path, text: str, name: str = "signal.csv") -> None:
    """Write a file on rank 0."""
    comm.barrier()
    rf.on_root(comm, lambda: (folder / name).write_text(text, encoding="utf-8"))
    comm.barrier()


def read(folder: Path, history: str = FILE, body: str = BODY) -> rf.Scene:
    return rf.from_toml(f"{body}{history}", folder=folder)


@pytest.mark.parametrize(
    "text",
    [
        "P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n",
        "P Q\n 1   0.25\n\n1.5  -0.5\n1 0.5 # the end\n",
        "rig three, by hand\n% 3 Hz\ntime [s], P [kN], Q (kN)\ns, kN, kN\n"
        "0, 1, 0.25\n1, 1.5, -0.5\n1, 1, 0.5\n",
        "# T P Q\n0.0 1 0.25\n0.1 1.5 -0.5\n0.2 1 0.5\n",
    ],
)
def test_every_format_gives_the_same_rows(text: str, shared_tmp_path: Path) -> None:
    put(shared_tmp_path, text)
    history = rf.history_from_scene(read(shared_tmp_path))
    assert history.load_names == ("P", "Q")
    assert history.path.tolist() == [[0.0, 0.0], *map(list, ROWS)]


def test_columns_name_those_of_a_file_without_header_and_choose_from_a_header(
    shared_tmp_path: Path,
) -> None:
    put(shared_tmp_path, "0 0.25 1\n1 -0.5 1.5\n2 0.5 1\n")
    assert read(shared_tmp_path, f'columns = ["time", "Q", "P"]\n{FILE}').history.rows == (
        (0.25, 1.0),
        (-0.5, 1.5),
        (0.5, 1.0),
    )
    put(shared_tmp_path, "P,room,Q\n1,20,0.25\n1.5,20,-0.5\n1,21,0.5\n")
    assert read(shared_tmp_path, f'columns = ["P", "Q"]\n{FILE}').history.rows == ROWS


def test_load_of_the_name_t_is_no_time(shared_tmp_path: Path) -> None:
    put(shared_tmp_path, "t,P\n1,0\n0.5,1\n")
    scene = read(shared_tmp_path, body=BODY.replace('"Q"', '"t"'))
    assert scene.history.columns == ("t", "P")


def test_dwell_of_a_signal_is_one_row(shared_tmp_path: Path) -> None:
    put(shared_tmp_path, "time,P,Q\n0,0,0\n1,0,0\n2,1,0\n3,1,0\n4,1,0\n5,1,0.5\n6,1,0.5\n")
    assert rf.history_from_scene(read(shared_tmp_path)).path.tolist() == [[0, 0], [1, 0], [1, 0.5]]


def test_measured_block_is_closed_from_its_end_to_its_beginning(shared_tmp_path: Path) -> None:
    put(shared_tmp_path, "P,Q\n1,0.25\n1.5,-0.5\n1.25,0.5\n")
    history = rf.history_from_scene(read(shared_tmp_path, 'cycle_rows = {file = "signal.csv"}\n'))
    assert history.path.tolist() == [[0, 0], [1.25, 0.5]]
    assert history.loop.tolist() == [[1.25, 0.5], [1, 0.25], [1.5, -0.5], [1.25, 0.5]]
    both = read(shared_tmp_path, FILE + 'cycle_rows = {file = "signal.csv"}\n')
    assert rf.history_from_scene(both).path.shape == (4, 2) and both.history.columns == ("P", "Q")


def test_scene_holds_the_rows_and_notices_another_file(shared_tmp_path: Path) -> None:
    put(shared_tmp_path, "P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n")
    scene = read(shared_tmp_path)
    assert rf.from_toml(rf.to_toml(scene), folder=shared_tmp_path / "elsewhere") == scene
    put(shared_tmp_path, "P,Q\n1,0.25\n1.5,-0.5000001\n1,0.5\n")
    assert difference(scene, read(shared_tmp_path)) == "[history] rows"
