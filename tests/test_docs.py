"""The reference builds, and its formulas survive Markdown."""

import dataclasses
import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

from mpi4py import MPI

import pytest

import receding_fenicsx
from receding_fenicsx.scene.model import (
    Body,
    Contact,
    HistoryOptions,
    Load,
    Material,
    MeshOptions,
    OutputOptions,
    Probe,
    SolverOptions,
    Support,
)

ROOT = Path(__file__).parent.parent


def builder() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build", ROOT / "docs" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SECTIONS = {
    "[body]": Body,
    "[material]": Material,
    "[mesh]": MeshOptions,
    "[contact]": Contact,
    "[[load]]": Load,
    "[[support]]": Support,
    "[[probe]]": Probe,
    "[history]": HistoryOptions,
    "[solver]": SolverOptions,
    "[output]": OutputOptions,
}


def default_of(field: dataclasses.Field[Any]) -> str:
    """How the guide writes a key's default."""
    if field.default is dataclasses.MISSING:
        return "needed" if field.default_factory is dataclasses.MISSING else "-"
    if field.default is None or field.default == () or field.default == "":
        return "-"
    return json.dumps(field.default)


@pytest.mark.parametrize("heading", SECTIONS)
def test_every_key_of_a_scene_is_told_with_its_default(heading: str) -> None:
    guide = (ROOT / "docs" / "scene.md").read_text(encoding="utf-8")
    section = guide.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    told = dict(re.findall(r"^\| `(\w+)` \| .* \| (.*) \|$", section, re.M))
    kind = SECTIONS[heading]
    assert told == {field.name: default_of(field) for field in dataclasses.fields(kind)}
    attributes = str(kind.__doc__).partition("Attributes:")[2]
    named = {
        name for line in re.findall(r"^ +([\w, ]+):", attributes, re.M) for name in line.split(", ")
    }
    assert named == set(told)


def test_every_module_can_be_imported_for_the_reference() -> None:
    build = builder()
    names = build.modules()
    assert {"receding_fenicsx", "receding_fenicsx.bulk.condensation"} <= set(names)
    assert [name for name in names if not build.imports(name)] == []


def test_formulas_in_docstrings_survive_markdown() -> None:
    r"""Markdown takes a backslash away from ``\\`` and ``\{``, and formulas must end."""
    found = 0
    for path in sorted(Path(receding_fenicsx.__file__).parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for doc in re.findall(r'r"""(.*?)"""', text, re.S):
            assert doc.count("$") % 2 == 0, f"{path}: a formula does not end"
            for formula in re.findall(r"\$\$(.*?)\$\$|\$(.*?)\$", doc, re.S):
                found += 1
                assert not re.search(r"\\[\\{}]", "".join(formula)), f"{path}: {formula}"
    assert found > 20


def test_reference_builds_with_a_page_for_each_module(tmp_path: Path) -> None:
    pytest.importorskip("pdoc")
    if MPI.COMM_WORLD.size > 1:
        pytest.skip("the build is for one rank")
    build = builder()
    build.build(tmp_path)
    for name in build.modules():
        page = tmp_path / f"{name.replace('.', '/')}.html"
        assert page.is_file(), f"{name} has no page"
        assert "Error parsing" not in page.read_text(encoding="utf-8")
    laws = (tmp_path / "receding_fenicsx" / "interface.html").read_text(encoding="utf-8")
    assert r"K_{tn} \cr K_{nt}" in laws
