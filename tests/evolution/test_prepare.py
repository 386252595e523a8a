"""A saved system used from the command line, without the programs that made it."""

import subprocess
import sys
from pathlib import Path

import pytest

from receding_fenicsx import cli, environment
from receding_fenicsx.store.run_folder import read_summary

BLOCK = str(Path(__file__).parents[2] / "demos" / "block.toml")
SMALL = ["--set", "mesh.contact_elements=24", "--set", "history.cycles=2"]


@pytest.mark.one_rank
def test_reuse_needs_neither_dolfinx_nor_petsc_nor_gmsh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = tmp_path / "system.h5"
    command = ["condense", BLOCK, *SMALL, "--out", str(system)]
    assert [cli.main(command), cli.main(command)] == [0, 2]  # nothing is replaced unasked
    assert "25 contact nodes of the half body" in capsys.readouterr().out
    arguments = ["run", BLOCK, *SMALL, "--system", str(system), "--pictures", "none"]
    code = (
        "import sys\n"
        "for name in ('dolfinx', 'petsc4py', 'gmsh', 'ufl', 'basix', 'pyvista'):\n"
        "    sys.modules[name] = None\n"  # makes importing it fail
        "from receding_fenicsx import cli\n"
        f"sys.exit(cli.main({[*arguments, '--out', str(tmp_path / 'run')]!r}))\n"
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
    timings = read_summary(tmp_path / "run" / "summary.json")["timings"]
    assert timings["mesh"] == timings["assemble"] == timings["condense"] == 0.0
