"""A measured signal of 500 points, run from a scene file, against rows and a closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx import cli, evolve
from receding_fenicsx.arrays import Array
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.run_folder import read_run

comm = MPI.COMM_WORLD
ROOT = Path(__file__).parents[2]
HISTORY = """
[history]
kind = "table"
constant = {P = 1.0}
rows = {file = "signal.csv"}
[output]
samples_per_leg = 1
"""


def signal() -> Array:
    """500 points of a modulated sine with noise, short of gross sliding, with two dwells."""
    time = np.arange(500) / 50.0
    noise = np.random.default_rng(14).normal(size=len(time))
    Q = 0.25 * np.sin(2.0 * np.pi * time) * (1.0 + 0.5 * np.sin(0.7 * time)) + 0.01 * noise
    Q[100:110], Q[300:303] = Q[100], Q[300]
    return np.round(Q, 6)


def moves(Q: Array) -> Array:
    """The signal without its dwells."""
    return Q[np.concatenate([[True], np.diff(Q) != 0.0])]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scene, signal and run of Cattaneo and Mindlin's contact, by the command line."""
    text = (ROOT / "demos" / "cattaneo_mindlin.toml").read_text()
    body = text[text.index("[[body]]") : text.index("[history]")]
    body = body.replace("../meshes", str(ROOT / "meshes")).replace("= 240", "= 60")
    folder = Path(comm.bcast(str(tmp_path_factory.mktemp("signal"))))

    def write() -> None:
        (folder / "scene.toml").write_text(body + HISTORY)
        rows = "".join(f"{k / 50:.2f};{Q:.6f}\n" for k, Q in enumerate(signal()))
        (folder / "signal.csv").write_text(f"shear of the rig\ntime [s];Q [N]\n{rows}")

    on_root(comm, write)
    comm.barrier()
    scene, out = str(folder / "scene.toml"), str(folder / "run")
    assert cli.main(["run", scene, "--out", out, "--pictures", "none"]) == 0
    return folder


def with_rows(scene: Scene, Q: Array) -> Scene:
    rows = tuple((float(value),) for value in Q)
    return replace(scene, history=replace(scene.history, rows=rows))


def test_signal_of_500_points_is_followed_point_by_point(place: Path) -> None:
    _, _, record = read_run(place / "run")
    Q = moves(signal())
    assert 400 < len(Q) < 500
    table = record.turning_points
    np.testing.assert_array_equal(table.load[0], [1.0, 0.0])
    np.testing.assert_array_equal(table.load[1:], np.column_stack([np.ones(len(Q)), Q]))
    # the contact carries the signal, and nothing of the way is lost
    np.testing.assert_allclose(-table.Q[1:].sum(axis=1), Q, atol=1e-10)
    assert record.residual_max < 1e-12 and record.energy_error_max < 1e-9


def test_run_folder_needs_the_file_no_more_and_a_changed_file_is_noticed(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, system, record = read_run(place / "run")
    assert scene.history.rows == with_rows(scene, moves(signal())).history.rows
    again = evolve(system, scene)
    np.testing.assert_array_equal(again.turning_points.v, record.turning_points.v)
    resume = ["run", str(place / "scene.toml"), "--out", str(place / "run"), "--resume"]
    text = (place / "signal.csv").read_text()
    comm.barrier()
    on_root(comm, lambda: (place / "signal.csv").write_text(text.replace("9.98;-", "9.98;")))
    comm.barrier()
    assert cli.main(resume) == 2
    if comm.rank == 0:
        assert "is a run with another [history] rows" in capsys.readouterr().err
    on_root(comm, lambda: (place / "signal.csv").write_text(text))
