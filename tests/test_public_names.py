"""The names of ``import receding_fenicsx as rf``, and that demos and documents need no others."""

import ast
import inspect
import pydoc
import re
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parent.parent
PACKAGE = "receding_fenicsx"
INNER_PARTS = ("benchmark_condensation", "benchmark_interface")
"""Demos that measure parts of the package which have no public name."""
CHECKERS = {
    "hard_cases": {"hard", "hard_block", "hard_bodies", "hard_trials"},
    "random_problems": {"problems"},
}
"""Modules of ``tests/`` that demos use."""
NEEDED = {"matplotlib", "mpi4py", "numpy", "petsc4py", "scipy", "h5py"}
LATE = (
    *("dolfinx", "petsc4py", "mpi4py", "gmsh", "pyvista", "vtk", "matplotlib", "numpy", "h5py"),
    "numba",
)
DEMOS = sorted((ROOT / "demos").glob("*.py"))
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def imports(text: str) -> set[str]:
    """Return the modules that a program imports, anywhere in it; of the package, with names."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def is_inside(name: str) -> bool:
    return name.startswith(f"{PACKAGE}.")


@pytest.mark.parametrize("name", rf.__all__)
def test_every_public_name_loads_and_has_a_docstring(name: str) -> None:
    value = getattr(rf, name)
    assert (inspect.getdoc(value) or "").splitlines()[0].strip()


def test_public_names_are_listed_with_a_line_each_in_help_and_dir() -> None:
    assert set(rf.__all__) <= set(dir(rf))
    assert set(rf.__all__) == set(rf._NAMES)
    head = pydoc.plain(pydoc.render_doc(rf)).partition("\nCLASSES")[0]
    for name in rf.__all__:
        assert re.search(rf"^ +{name} {{2,}}\S.*$", head, re.M), name
    for line in str(rf.__doc__).splitlines():
        assert len(line) <= 100, line


def test_public_names_are_those_that_type_checkers_see() -> None:
    tree = ast.parse(Path(rf.__file__).read_text(encoding="utf-8"))
    (block,) = (n for n in tree.body if isinstance(n, ast.If) and "TYPE" in ast.unparse(n.test))
    seen = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom)
        for alias in node.names:
            seen[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    assert set(seen) == set(rf.__all__)
    for name, (place, _) in rf._NAMES.items():
        module, colon, inner = place.partition(":")
        end = "" if colon and not inner else f".{inner or name}"
        assert seen[name] == f"{PACKAGE}.{module}{end}"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'condens'"):
        _ = rf.condens


def test_importing_the_package_loads_no_library() -> None:
    program = f"import sys, {PACKAGE}; print(*sorted(m.split('.')[0] for m in sys.modules))"
    run = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env=rf.child_environment(),
    )
    assert not set(LATE) & set(run.stdout.split())


@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demos_use_public_names_only(demo: Path) -> None:
    found = imports(demo.read_text(encoding="utf-8"))
    if demo.stem not in INNER_PARTS:
        assert [name for name in found if is_inside(name)] == []
    others = {name.split(".")[0] for name in found} - NEEDED - {PACKAGE}
    beside = {path.stem for path in DEMOS} | CHECKERS.get(demo.stem, set())
    assert others - beside <= sys.stdlib_module_names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_programs_of_the_documents_use_public_names_only(document: Path) -> None:
    for program in re.findall(r"```python\n(.*?)```", document.read_text(encoding="utf-8"), re.S):
        assert [name for name in imports(program) if is_inside(name)] == []


def test_names_used_by_demos_and_documents_are_public() -> None:
    if MPI.COMM_WORLD.rank > 0:
        return
    texts = [path.read_text(encoding="utf-8") for path in (*DEMOS, *DOCUMENTS)]
    used = {name for text in texts for name in re.findall(r"\brf\.(\w+)", text)}
    assert used <= {*rf.__all__, "__version__"}
