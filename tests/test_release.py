"""Files of a release agree with each other, with .ci/run and with what is in the project.

Workflows, containers and the recipe do not run here: they are parsed, and what they call is there.
"""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import yaml
from test_imports import IMPORTS

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
EXTRAS = PROJECT["optional-dependencies"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
CONDA_NAMES = {"gmsh": "python-gmsh", "matplotlib": "matplotlib-base", "tomli_w": "tomli-w"}
CONDA_NAMES |= {"annotated_types": "python-annotated-types"}


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_version_is_the_same_everywhere_and_the_address_in_one_place() -> None:
    citation, zenodo = loaded(ROOT / "CITATION.cff"), json.loads(text_of(".zenodo.json"))
    assert PROJECT["version"] == rf.__version__ == citation["version"]
    assert zenodo["creators"] == citation["authors"] == PROJECT["authors"]
    assert zenodo["license"] == citation["license"] == PROJECT["license"]
    assert zenodo["keywords"] == PROJECT["keywords"] and zenodo["upload_type"] == "software"
    # OWNER until the owner puts the name there
    owner = re.escape(PROJECT["urls"]["Repository"].split("/")[-2])
    here = rf"{owner}/{re.escape(PROJECT['urls']['Repository'].split('/')[-1])}|\bOWNER\b"
    hidden = (".github", ".devcontainer", ".conda", ".ci", ".changes")
    folders = (
        ROOT.glob("*"),
        *((ROOT / n).rglob("*") for n in ("docs", "demos", "meshes", *hidden)),
    )
    named = [
        path.relative_to(ROOT).as_posix()
        for path in itertools.chain((ROOT / "receding_fenicsx").rglob("*.py*"), *folders)
        if path.suffix in {".cff", ".json", ".md", ".py", ".pyi", ".sh", ".toml", ".yaml", ".yml"}
        and re.search(here, path.read_text(encoding="utf-8"))
    ]
    assert named == ["pyproject.toml"]


def commands(workflow: Any) -> Iterator[str]:
    """Yield the lines that a workflow's steps run."""
    for job in workflow["jobs"].values():
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step)
            assert re.search(r".[@:][\w./]+$", step.get("uses", "a@v1")), "an action of no version"
            yield from step.get("run", "").strip().splitlines()


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_scripts_and_extras_of_the_project(path: Path) -> None:
    workflow = loaded(path)
    assert workflow["name"] == path.stem and True in workflow  # YAML 1.1 takes "on" for true
    for line in commands(workflow):
        for script in re.findall(r"(?:bash|python3?) ([\w./]+)", line):
            assert (ROOT / script).is_file(), line
        for extras in re.findall(r"\.\[([\w,]+)\]", line):
            assert set(extras.split(",")) <= set(EXTRAS), line


def test_links_of_the_readme_that_pypi_shows_are_addresses(tmp_path: Path) -> None:
    steps = loaded(ROOT / ".github/workflows/publish.yml")["jobs"]["pypi"]["steps"]
    (step,) = (step for step in steps if "README.md" in step.get("run", ""))
    (tmp_path / "README.md").write_text(text_of("README.md"), encoding="utf-8")
    address = {name: name.lower() for name in step["env"]} | {"AT": "https://host/owner/name"}
    subprocess.run(["bash", "-ec", step["run"]], cwd=tmp_path, env=os.environ | address, check=True)
    links = re.findall(r'(?:\]\(|src=")([^)"]+)', (tmp_path / "README.md").read_text("utf-8"))
    assert len(links) > 20 and all(link.startswith("https://") for link in links)
    for link in links:
        kind, _, path = link.removeprefix("https://host/owner/name/").partition("/tag/")
        assert link.startswith("https://fenicsproject.org") or (
            kind == ("raw" if path.endswith(".gif") else "blob")
            and (ROOT / path.partition("#")[0]).is_file()
        )


def test_conda_recipe_asks_for_the_dependencies_of_the_project() -> None:
    recipe = re.sub(r"{%.*?%}", "", text_of(".conda/meta.yaml"))
    recipe = re.sub(r"{{.*?}}", "x", recipe)
    needs = yaml.safe_load(recipe)["requirements"]["run"]
    asked = {text.split()[0]: text for text in needs}
    for dependency in PROJECT["dependencies"]:
        requirement, _, marker = dependency.partition("; ")
        if "<" in marker:  # Debian's Python
            continue
        name, limits = re.split(r"(?=[<>=])", requirement, maxsplit=1)
        name = CONDA_NAMES.get(name, name)
        assert asked.pop(name) == f"{name} {limits}"
    assert set(asked) == {"python", "fenics-dolfinx"}


# -- dependencies, and the built wheel ----------------------------------------------------------

BROUGHT_BY_DOLFINX = {"basix", "cffi", "dolfinx", "dolfinx_solver", "mpi4py", "petsc4py", "ufl"}
"""Modules of Debian's python3-dolfinx-real, and of PyPI's dolfinx-solver-real."""
DISTRIBUTIONS = {"PIL": "pillow", "imageio_ffmpeg": "imageio-ffmpeg", "pydantic_core": "pydantic"}
"""Distribution that brings each module of another name."""
NOT_IMPORTED = {"vtk": "release for pyvista"}
"""Dependencies that the package does not import itself, and their purpose."""


def test_imports_of_the_package_are_its_declared_dependencies() -> None:
    project = PROJECT
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
