"""The paper's study, run with Debian's packages and with PyPI's, gives the same summary."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest

from receding_fenicsx.environment import child_environment

ROOT = Path(__file__).parents[1]
DEBIAN, PYPI = (ROOT / name / "bin" / "python" for name in (".venv", ".venv-pypi"))
SAME = 1e-8
"""Difference of two numbers over the largest number of that name."""
OWN = {"versions", "timings", "peak_memory_MB"}
"""Keys that tell of the program and the machine."""
ROUND_OFF = {"residual_max": 1e-10, "energy_error_max": 1e-10}
"""Keys that hold nothing but round-off, and what they must stay below."""

PROGRAM = """
import sys
import receding_fenicsx as r
r.run(r.read_scene(sys.argv[1]), sys.argv[2], r.RunOptions(pictures=False))
"""


def summary(python: Path, out: Path) -> dict[str, Any]:
    """Run the study by another interpreter."""
    scene = ROOT / "demos" / "block.toml"
    done = subprocess.run(
        [python, "-c", PROGRAM, scene, out],
        env=child_environment() | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return result


def numbers_and_words(value: Any, name: str = "") -> dict[str, list[Any]]:
    """All that a summary holds, by its keys; places in lists do not count."""
    if isinstance(value, dict):
        parts = [numbers_and_words(part, f"{name}.{key}") for key, part in value.items()]
    elif isinstance(value, list):
        parts = [numbers_and_words(part, name) for part in value]
    else:
        return {name: [value]}
    merged: dict[str, list[Any]] = {}
    for part in parts:
        for key, found in part.items():
            merged.setdefault(key, []).extend(found)
    return merged


@pytest.mark.skipif(
    MPI.COMM_WORLD.size > 1 or Path(sys.executable) != PYPI or not DEBIAN.exists(),
    reason="compares the two environments, once: on one rank of .venv-pypi, if .venv is there",
)
def test_both_stacks_give_the_same_summary(tmp_path: Path) -> None:
    debian, pypi = summary(DEBIAN, tmp_path / "debian"), summary(PYPI, tmp_path / "pypi")
    if debian["versions"]["gmsh"] != pypi["versions"]["gmsh"]:
        pytest.skip("the environments have different releases of gmsh, so different meshes")
    assert debian["versions"]["dolfinx"] != pypi["versions"]["dolfinx"]
    for key, limit in ROUND_OFF.items():
        assert debian.pop(key) < limit
        assert pypi.pop(key) < limit
    for key in OWN:
        del debian[key], pypi[key]
    left, right = numbers_and_words(debian), numbers_and_words(pypi)
    assert left.keys() == right.keys()
    compared = 0
    for name, values in left.items():
        pairs = list(zip(values, right[name], strict=True))
        floats = [pair for pair in pairs if {type(part) for part in pair} == {float}]
        others = [pair for pair in pairs if {type(part) for part in pair} != {float}]
        assert all(a == b for a, b in others), f"{name} differs"
        size = max((abs(a) for a, _ in floats), default=0.0)
        worst = max((abs(a - b) for a, b in floats), default=0.0)
        assert worst <= SAME * size, f"{name} differs by {worst:.1e}, its size is {size:.1e}"
        compared += len(floats)
    assert compared > 1000
