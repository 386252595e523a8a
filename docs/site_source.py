"""Sources of the site: the project's documents, its demos, and the pages made from its code."""

import re
import shutil
from pathlib import Path

import api_pages
import gallery_pages
import key_tables

from receding_fenicsx.cli import app

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PARTS = {
    "Tutorials": "install tutorials/block tutorials/own_body tutorials/joint tutorials/fretting "
    "tutorials/study gallery",
    "How-to": "usage bodies assemblies loads half_planes grading tolerance limit joints wear "
    "fatigue shakedown uniqueness sweeps cluster exchange tutorials/extending tutorials/elsewhere",
    "Reference": "scene command_line formats glossary api/index",
    "Explanation": "theory accuracy measured contributing changelog",
}
"""The four parts of the documents with their pages."""


def prepare(source: Path) -> None:
    """Gather and generate the sources of all pages.

    Args:
        source: folder of the sources, created.
    """
    source.mkdir(parents=True)
    demos = ROOT / "demos"
    shutil.copytree(demos / "pictures", source / "pictures")
    shutil.copytree(
        demos, source / "demos", ignore=shutil.ignore_patterns("pictures", "benchmarks", "__*")
    )
    pages = {path.name: path for path in DOCS.glob("*.md")}
    pages |= {name.lower(): ROOT / name for name in ("CHANGELOG.md", "CONTRIBUTING.md")}
    for name, path in pages.items():
        text = key_tables.with_tables(relinked(path.read_text(encoding="utf-8")))
        (source / name).write_text(text, encoding="utf-8")
    with (source / "index.md").open("a", encoding="utf-8") as page:
        for part, names in PARTS.items():
            head = f"\n```{{toctree}}\n:hidden:\n:caption: {part}\n\n"
            page.write("\n".join([head, *names.split(), "```\n"]))
    (source / "command_line.md").write_text(command_line(), encoding="utf-8")
    (source / "tutorials").mkdir()
    for path in (DOCS / "tutorials").glob("*.py"):
        text = page_of_notebook(path.read_text(encoding="utf-8"))
        (source / "tutorials" / f"{path.stem}.md").write_text(text, encoding="utf-8")
    api_pages.write_pages(ROOT / api_pages.PACKAGE, source / "api")
    gallery_pages.write_pages(demos, source)


def relinked(text: str) -> str:
    """Return a page whose links to files of the project lead to pages of the site."""

    def place(found: re.Match[str]) -> str:
        path = found[1].replace("../", "").removeprefix("docs/").rstrip("/")
        if path in ("CHANGELOG.md", "CONTRIBUTING.md"):
            path = path.lower()
        elif path == f"{api_pages.PACKAGE}/cli.py":
            path = "command_line.md"
        elif path.startswith("tutorials/"):
            path = path.replace(".py", ".md")
        elif path == "demos":
            path = "gallery.md"
        elif path.startswith("demos/pictures/"):
            path = path.removeprefix("demos/")
        elif path == f"{api_pages.PACKAGE}/__init__.pyi":
            path = "api/index.md"
        elif room := re.fullmatch(rf"{api_pages.PACKAGE}/(.+)/__init__\.py", path):
            path = f"api/{room[1].replace('/', '.')}.md"
        elif module := re.fullmatch(rf"{api_pages.PACKAGE}/(.+)/(\w+)\.py", path):
            path = f"api/{module[1].replace('/', '.')}.md#{module[2]}"
        elif demo := re.fullmatch(r"demos/(\w+)\.py", path):
            path = f"gallery/{demo[1]}.md"
        return f"]({path}"

    return re.sub(r"\]\(((?!https?:)[^)#\s]+)", place, text)


def page_of_notebook(text: str) -> str:
    """Return the page of a notebook in jupytext's percent format, with links within the site."""
    parts = []
    for cell in re.split(r"^# %%", text, flags=re.M)[1:]:
        kind, _, body = cell.partition("\n")
        if "markdown" in kind:
            prose = re.sub(r"^# ?", "", body, flags=re.M).strip()
            prose = relinked(re.sub(r"\]\((?=\w+\.py)", "](tutorials/", prose))
            parts.append(re.sub(r"\]\((?!https?:|#)", "](../", prose))
        else:
            parts.append(f"```python\n{body.strip()}\n```")
    return "\n\n".join(parts) + "\n"


def command_line() -> str:
    """Return the page of all commands with their options, made of their help texts."""
    text = app.generate_docs(output_format="markdown")
    text = re.sub(r"## Table of Contents\n.*?(?=\*\*Commands)", "", text, flags=re.S)
    return re.sub(r"^# .*", "# Command line", text, count=1)
