"""The pages of the documentation: keys of scenes, API, gallery; formulas survive Markdown."""

import doctest
import re
from importlib import import_module
from pathlib import Path

import api_pages
import gallery_pages
import pytest
import site_source
from test_imports import MODULES

import receding_fenicsx

pytestmark = [pytest.mark.one_rank, pytest.mark.once]

ROOT = Path(__file__).parent.parent


def test_formulas_in_docstrings_survive_markdown() -> None:
    r"""Markdown takes a backslash away from ``\\`` and ``\{``, and formulas must end."""
    found = 0
    for path in MODULES.values():
        text = path.read_text(encoding="utf-8")
        for doc in re.findall(r'r"""(.*?)"""', text, re.S):
            assert doc.count("$") % 2 == 0, f"{path}: a formula does not end"
            for formula in re.findall(r"\$\$(.*?)\$\$|\$(.*?)\$", doc, re.S):
                found += 1
                assert not re.search(r"\\[\\{}]", "".join(formula)), f"{path}: {formula}"
    assert found > 20


def test_examples_of_docstrings_hold() -> None:
    shown = [name for name, path in MODULES.items() if ">>> " in path.read_text(encoding="utf-8")]
    assert len(shown) > 2
    for name in shown:
        failed, tried = doctest.testmod(import_module(f"receding_fenicsx.{name}"))
        assert tried > 0 and failed == 0, name


def test_api_describes_every_module_and_public_name(tmp_path: Path) -> None:
    package = Path(receding_fenicsx.__file__).parent
    modules = api_pages.write_pages(package, tmp_path / "api")
    assert len(modules) == len(MODULES) - 1  # without __main__
    pages = "\n".join(path.read_text(encoding="utf-8") for path in (tmp_path / "api").iterdir())
    for module in modules:
        assert f"{{py:module}} {module}\n" in pages
    index = (tmp_path / "api" / "index.md").read_text(encoding="utf-8")
    parts = re.findall(r"`rf\.(\w+) <receding_fenicsx\.([\w.]+)>`", index)
    assert all(f"{{py:module}} receding_fenicsx.{module}\n" in pages for _, module in parts)
    names = re.findall(r"^\| \[rf\.(\w+)\]\(rf\.\1\.md\) \| \S", index, re.M)
    assert {*names, *(name for name, _ in parts)} == set(receding_fenicsx.__all__)
    for name in names:
        page = (tmp_path / "api" / f"rf.{name}.md").read_text(encoding="utf-8")
        assert re.search(rf"py:(?:function|class|data)\}} {name}\b", page), name
    assert r"K_{tn} \cr K_{nt}" in pages


def test_every_demo_has_a_picture_and_every_picture_is_shown() -> None:
    demos = ROOT / "demos"
    names = gallery_pages.demo_names(demos)
    shown = [gallery_pages.pictures_of(demos, name) for name in names]
    assert [name for name, found in zip(names, shown, strict=True) if not found] == []
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    linked = set(re.findall(r"demos/pictures/([\w.]+)", pages))
    assert linked | {name for names in shown for name in names} == {
        path.name for path in (demos / "pictures").iterdir()
    }


def test_links_to_files_lead_to_pages() -> None:
    for link, page in {
        "../CHANGELOG.md": "changelog.md",
        "docs/scene.md#mesh": "scene.md#mesh",
        "../demos/pictures/c.png": "pictures/c.png",
        "../demos/block.py": "gallery/block.md",
        "../demos": "gallery.md",
        "../receding_fenicsx/bulk/mesh/__init__.py": "api/bulk.mesh.md",
        "../receding_fenicsx/bulk/mesh/edges.py": "api/bulk.mesh.md#edges",
        "https://x.y": "https://x.y",
    }.items():
        assert site_source.relinked(f"[a]({link}) b") == f"[a]({page}) b"
