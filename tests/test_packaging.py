"""Packaging: folders, data files and dependencies in pyproject.toml, and the built wheel."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from test_imports import IMPORTS

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())

BROUGHT_BY_DOLFINX = {"basix", "cffi", "dolfinx", "dolfinx_solver", "mpi4py", "petsc4py", "ufl"}
"""Modules of Debian's python3-dolfinx-real, and of PyPI's dolfinx-solver-real."""
DISTRIBUTIONS = {"PIL": "pillow", "imageio_ffmpeg": "imageio-ffmpeg", "pydantic_core": "pydantic"}
"""Distribution that brings each module of another name."""
NOT_IMPORTED = {"vtk": "release for pyvista"}
"""Dependencies that the package does not import itself, and their purpose."""


def test_imports_of_the_package_are_its_declared_dependencies() -> None:
    project = PYPROJECT["project"]
    requirements = project["dependencies"] + project["optional-dependencies"]["tables"]
    declared = {re.split(r"[<>=~!; ]", text)[0] for text in requirements}
    names = {name.partition(".")[0] for found in IMPORTS.values() for name in found}
    names -= sys.stdlib_module_names | BROUGHT_BY_DOLFINX
    imported = {DISTRIBUTIONS.get(name, name) for name in names - {"receding_fenicsx"}}
    assert imported == declared - set(NOT_IMPORTED)


BUILD = "from setuptools import build_meta as b; print(b.build_{kind}({folder!r}))"
LEFT = shutil.ignore_patterns(".*", "*.egg-info", "build", "dist", "results", "__pycache__")
NEEDED = int(PYPROJECT["build-system"]["requires"][0].partition(">=")[2])


@pytest.mark.skipif(
    int(metadata.version("setuptools").split(".")[0]) < NEEDED,
    reason=f"setuptools >= {NEEDED} is not there; see the extra 'test'",
)
def test_an_installed_wheel_made_from_the_sdist_has_all_it_needs(tmp_path: Path) -> None:
    source, out, site = (tmp_path / name for name in ("source", "out", "site"))
    shutil.copytree(ROOT, source, ignore=LEFT)

    def python(*arguments: str | Path, cwd: Path = tmp_path, **variables: str) -> str:
        command = [sys.executable, *map(str, arguments)]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | variables
        done = subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    sdist = python("-c", BUILD.format(kind="sdist", folder=str(out)), cwd=source).split()[-1]
    subprocess.run(["tar", "-xf", out / sdist, "-C", tmp_path], check=True)
    unpacked = tmp_path / sdist.removesuffix(".tar.gz")
    wheel = python("-c", BUILD.format(kind="wheel", folder=str(out)), cwd=unpacked).split()[-1]
    python("-m", "pip", "install", "--no-deps", "--no-index", "--target", site, out / wheel)

    shipped = {path.relative_to(ROOT) for path in (ROOT / "receding_fenicsx").rglob("*.py")}
    assert shipped == {path.relative_to(site) for path in (site / "receding_fenicsx").rglob("*.py")}
    # without it type checkers take nothing of the package's annotations
    assert (site / "receding_fenicsx" / "py.typed").is_file()
    assert (site / "receding_fenicsx" / "__init__.pyi").is_file()  # the names that are loaded
    for path in (ROOT / "meshes").glob("*.geo"):
        assert (site / "receding_fenicsx" / "meshes" / path.name).read_text() == path.read_text()
    assert os.access(site / "bin" / "receding-fenicsx", os.X_OK)
    place = "import receding_fenicsx as r; print(r.__file__)"
    assert python("-c", place, PYTHONPATH=str(site)).startswith(str(site))
    said = python(
        *("-m", "receding_fenicsx", "check", ROOT / "demos" / "block.toml"), PYTHONPATH=str(site)
    )
    assert "contact nodes" in said
