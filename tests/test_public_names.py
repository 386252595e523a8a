"""The names of ``import receding_fenicsx as rf``, and that demos and documents need no others."""

import ast
import inspect
import pydoc
import re
import sys
from pathlib import Path

import pytest
from test_imports import imports

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parent.parent
PACKAGE = "receding_fenicsx"
CHECKERS = {
    "hard_cases": {"hard"},
    "random_problems": {"problems", "stack_problems"},
}
"""Modules of ``tests/`` that benchmarks use."""
NEEDED = {"matplotlib", "mpi4py", "numpy", "petsc4py", "scipy", "h5py"}
DEMOS = sorted((ROOT / "demos").rglob("*.py"))
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.py"))
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
DOCUMENTS += NOTEBOOKS


@pytest.mark.parametrize("name", rf.__all__)
def test_every_public_name_loads_and_has_a_docstring(name: str) -> None:
    value = getattr(rf, name)
    assert (inspect.getdoc(value) or "").splitlines()[0].strip()


def test_help_and_completion_know_every_public_name() -> None:
    assert set(rf.__all__) <= set(dir(rf))
    assert not set(rf.__all__) - set(re.findall(r"\w+", pydoc.plain(pydoc.render_doc(rf))))


def test_type_checkers_and_programs_see_the_same_names() -> None:
    stub = ast.parse(Path(rf.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    lines = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    names = [(alias.name, alias.asname) for node in lines for alias in node.names]
    # a type checker hides names without "as"; the loader takes the name before it
    assert names == [(name, name) for name, _ in names]
    assert sorted(name for name, _ in names) == sorted(rf.__all__)


@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demos_use_public_names_only(demo: Path) -> None:
    found = imports(demo.read_text(encoding="utf-8"))
    assert not [name for name in found if name.startswith(f"{PACKAGE}.")]
    others = {name.split(".")[0] for name in found} - NEEDED - {PACKAGE}
    beside = {path.stem for path in DEMOS} | CHECKERS.get(demo.stem, set())
    assert others - beside <= sys.stdlib_module_names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_programs_of_the_documents_use_public_names_only(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    programs = re.findall(r"```python\n(.*?)```", text, re.S)
    for program in [text] if document in NOTEBOOKS else programs:
        assert not [name for name in imports(program) if name.startswith(f"{PACKAGE}.")]


def test_names_used_by_demos_and_documents_are_public() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (*DEMOS, *DOCUMENTS)]
    for space, known in (("", {*rf.__all__, "__version__"}), ("figures.", rf.figures.__all__)):
        pattern = rf"\brf\.{space}([A-Za-z]\w+)"
        assert {name for text in texts for name in re.findall(pattern, text)} <= set(known)
