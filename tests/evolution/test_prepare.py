"""Saved systems used for other scenes from the command line, and what is logged meanwhile."""

import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx import cli, environment
from receding_fenicsx.bulk.mesh import meshing
from receding_fenicsx.store.hdf5 import read_record, read_system
from receding_fenicsx.store.run_folder import read_summary

BLOCK = str(Path(__file__).parents[2] / "demos" / "block.toml")
SMALL = ["--set", "mesh.contact_elements=24", "--set", "history.cycles=2"]
comm = MPI.COMM_WORLD
root = comm.rank == 0


@pytest.fixture
def system(shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """The file of a condensed block."""
    path = shared_tmp_path / "system.h5"
    assert cli.main(["condense", BLOCK, *SMALL, "--out", str(path)]) == 0
    capsys.readouterr()
    comm.Barrier()
    return path


def untouched(*_: object) -> None:
    """Stand for the meshing that must not happen."""
    raise AssertionError("the body was meshed")


def test_another_friction_gap_or_history_is_played_without_touching_the_body(
    system: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = ("contact.friction=0.2", "contact.initial_gap=0.001*x**2", "history.minimum=0.5")
    settings = [*SMALL, *(word for change in changes for word in ("--set", change))]
    folder = system.parent
    fresh = ["run", BLOCK, *settings, "--pictures", "none", "--out", str(folder / "fresh")]
    assert cli.main(fresh) == 0
    monkeypatch.setattr(meshing, "make_meshes", untouched)
    comm.Barrier()
    reused = [*fresh[:-1], str(folder / "reused"), "--system", str(system)]
    assert cli.main(reused) == 0
    comm.Barrier()
    if root:
        a, b = (read_record(folder / name / "record.h5") for name in ("fresh", "reused"))
        for name in ("v", "w", "P", "Q", "state"):
            x, y = getattr(a.turning_points, name), getattr(b.turning_points, name)
            assert x.tobytes() == y.tobytes(), name
        assert a.scene_toml == b.scene_toml
        timings = read_summary(folder / "reused" / "summary.json")["timings"]
        assert timings["mesh"] == timings["assemble"] == timings["condense"] == 0.0
        # the run's own copy is that of its own scene, and serves further ones
        own = read_system(folder / "reused" / "system.h5")
        assert own.scene_toml == b.scene_toml and own.kind == "frictional"
        np.testing.assert_array_equal(own.f, b.f[len(b.f) // 2 :])
    comm.Barrier()
    again = [*reused[:-3], str(folder / "again"), "--system", str(folder / "reused" / "system.h5")]
    assert cli.main([*again, "--set", "contact.friction=0.35"]) == 0


@pytest.mark.one_rank
def test_reuse_needs_neither_dolfinx_nor_petsc_nor_gmsh(system: Path) -> None:
    arguments = ["run", BLOCK, *SMALL, "--system", str(system), "--pictures", "none"]
    code = (
        "import sys\n"
        "for name in ('dolfinx', 'petsc4py', 'gmsh', 'ufl', 'basix', 'pyvista'):\n"
        "    sys.modules[name] = None\n"  # makes importing it fail
        "from receding_fenicsx import cli\n"
        f"sys.exit(cli.main({[*arguments, '--out', str(system.parent / 'run')]!r}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment.child_environment(),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "written to" in done.stdout
