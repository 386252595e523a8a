"""The paper's study, run with Debian's packages and with PyPI's, gives the same summary."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest

from receding_fenicsx.environment import child_environment

ROOT = Path(__file__).parents[1]
DEBIAN, PYPI = (ROOT / name / "bin" / "python" for name in (".venv", ".venv-pypi"))
OWN = {"versions", "timings", "peak_memory_MB"}
"""Keys that tell of the program and the machine."""
PROGRAM = """
import sys
import receding_fenicsx as r
r.run(r.read_scene(sys.argv[1]), sys.argv[2], r.RunOptions(pictures=False))
"""


def summary(python: Path, out: Path) -> dict[str, Any]:
    """Run the study by another interpreter; of round-off nothing but its size is kept."""
    done = subprocess.run(
        [python, "-c", PROGRAM, ROOT / "demos" / "block.toml", out],
        env=child_environment() | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads((out / "summary.json").read_text())
    round_off = "residual_max", "energy_error_max", "dissipation_round_off"
    assert all(result.pop(name) < 1e-10 for name in round_off)
    return result


def parts(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all that a summary holds with its keys; places in lists do not count."""
    if isinstance(value, dict):
        for key in value.keys() - OWN:
            yield from parts(value[key], f"{name}.{key}")
    elif isinstance(value, list):
        for part in value:
            yield from parts(part, name)
    else:
        yield name, value


@pytest.mark.skipif(
    MPI.COMM_WORLD.size > 1 or Path(sys.executable) != PYPI or not DEBIAN.exists(),
    reason="compares the two environments, once: on one rank of .venv-pypi, if .venv is there",
)
def test_both_stacks_give_the_same_summary(tmp_path: Path) -> None:
    debian, pypi = summary(DEBIAN, tmp_path / "debian"), summary(PYPI, tmp_path / "pypi")
    if debian["versions"]["gmsh"] != pypi["versions"]["gmsh"]:
        pytest.skip("the environments have different releases of gmsh, so different meshes")
    assert debian["versions"]["dolfinx"] != pypi["versions"]["dolfinx"]
    left, right = (sorted(parts(one), key=lambda part: part[0]) for one in (debian, pypi))
    floats: dict[str, list[tuple[float, float]]] = {}
    for (name, a), (other, b) in zip(left, right, strict=True):
        if type(a) is type(b) is float:
            floats.setdefault(name, []).append((a, b))
        else:
            assert (name, a) == (other, b)
    for name, pairs in floats.items():
        size, worst = max(abs(a) for a, _ in pairs), max(abs(a - b) for a, b in pairs)
        assert worst <= 1e-8 * size, f"{name} differs by {worst:.1e}, its size is {size:.1e}"
    assert sum(map(len, floats.values())) > 1000
