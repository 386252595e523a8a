"""Pages of the API: one for each public name and each folder of the package, from its sources.

The docstrings are Markdown with Google's sections and formulas between dollar signs. They are read
from the syntax tree; nothing is imported.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = "receding_fenicsx"
SECTIONS = {
    "Args:": "Arguments",
    "Attributes:": "Attributes",
    "Raises:": "Raises",
    "Returns:": "Returns",
    "Yields:": "Yields",
}
ENTRY = re.compile(r"^([\w, *]+|\"[^\"]+\"(?:, \"[^\"]+\")*): ?(.*)")
ROLE = re.compile(r":(func|class|meth|mod|data|attr|obj|exc):`")
ORDER = ("", "scene", "bulk", "interface", "evolution", "output", "studies", "reference")
"""Folders of the package in the order of the pages."""


def write_pages(package: Path, out: Path) -> list[str]:
    """Write the pages of all public names and rooms, and the list of them.

    Args:
        package: folder of the package.
        out: folder of the pages, created.

    Returns:
        Names of the modules documented.
    """
    out.mkdir(parents=True)
    folders = [package, *(path.parent for path in package.rglob("*/__init__.py"))]
    rooms = {".".join(path.relative_to(package).parts): path for path in folders}
    order = sorted(rooms, key=_place)
    public = _public_names(package)
    pages = {}
    for name, found in (item for names in public.values() for item in names.items()):
        module, node, following = found
        if node:
            pages[f"{module}.{name}"] = name
            place = f"```{{py:currentmodule}} {module}\n```\n\nIn {{py:mod}}`{module}`."
            # orphan: not one line more in the sidebar of every page
            text = "\n\n".join(
                [
                    "---\norphan: true\n---",
                    f"# rf.{name}",
                    place,
                    _member(node, following, fence="`" * 5),
                ]
            )
            (out / f"rf.{name}.md").write_text(text, encoding="utf-8")
    documented = []
    for room in order:
        modules = [path for path in sorted(rooms[room].glob("*.py")) if path.stem != "__main__"]
        names = [_module_name(package, path) for path in modules]
        parts = [_module(path, name, pages) for path, name in zip(modules, names, strict=True)]
        (out / f"{room or PACKAGE}.md").write_text("\n\n".join(parts), encoding="utf-8")
        documented += names
    index = [
        "# API",
        "## Public names",
        "`import receding_fenicsx as rf` gives all of these.",
        *(_table(group, names) for group, names in public.items()),
        "## Rooms",
        "The package has a folder for each concept; imports go down only.",
        "\n".join(
            ["```{toctree}", ":maxdepth: 1", "", *(room or PACKAGE for room in order), "```"]
        ),
    ]
    (out / "index.md").write_text("\n\n".join(index), encoding="utf-8")
    return documented


def _place(room: str) -> tuple[int, str]:
    """Return the key by which the rooms are sorted; those that ``ORDER`` lacks come last."""
    folder = room.split(".")[0]
    return (ORDER.index(folder) if folder in ORDER else len(ORDER)), room


def _module_name(package: Path, path: Path) -> str:
    parts = path.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


Definition = tuple[str, ast.stmt | None, ast.stmt | None]
"""Module that defines a name, its statement (None for a module), and the statement after it."""


def _public_names(package: Path) -> dict[str, dict[str, Definition]]:
    """Return the public names of each group of ``__init__.pyi`` with their definitions."""
    text = (package / "__init__.pyi").read_text(encoding="utf-8")
    _, *parts = re.split(r"^# (.+)$", text, flags=re.MULTILINE)
    groups: dict[str, dict[str, Definition]] = {}
    for group, block in zip(parts[::2], parts[1::2], strict=True):
        imports = [node for node in ast.parse(block).body if isinstance(node, ast.ImportFrom)]
        groups[group] = {
            alias.name: _definition(package, node.module or "", alias.name)
            for node in imports
            for alias in node.names
        }
    return groups


def _definition(package: Path, module: str, name: str) -> Definition:
    """Find what a module defines or passes on, or the module of that name."""
    place = package.joinpath(*module.split("."))
    for path in (place / f"{name}.py", place / name / "__init__.py"):
        if path.exists():
            return _module_name(package, path), None, None
    for path in (place.with_suffix(".py"), place / "__init__.py", *sorted(package.rglob("*.py"))):
        body = _parsed(path).body if path.exists() else []
        for node, following in zip(body, [*body[1:], None], strict=False):
            if _name(node) == name and _doc(node, following):
                return _module_name(package, path), node, following
    raise LookupError(f"{module}.{name} has no docstring")


def _table(group: str, names: dict[str, Definition]) -> str:
    """Return the table of a group of public names."""
    rows = [f"**{group}**", "", "| name | |", "| --- | --- |"]
    for name, (module, node, following) in names.items():
        if node:
            told = _summary(node, following).replace("|", r"\|")
            rows.append(f"| [rf.{name}](rf.{name}.md) | {told} |")
        else:
            rows.append(f"| {{py:mod}}`rf.{name} <{module}>` | |")
    return "\n".join(rows)


def _summary(node: ast.stmt, following: ast.stmt | None) -> str:
    """Return the first line of a docstring."""
    return markdown(_doc(node, following) or "").split("\n")[0]


@cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _module(path: Path, name: str, pages: dict[str, str]) -> str:
    """Return the section of one module; the room's own is the head of its page."""
    tree = _parsed(path)
    head = path.stem == "__init__"
    title = name.removeprefix(f"{PACKAGE}.") if head else path.stem
    parts = [f"{'#' if head else '##'} {title}", f"```{{py:module}} {name}\n```"]
    parts.append(markdown(ast.get_docstring(tree) or ""))
    for node, following in _documented(tree.body):
        if public := pages.get(f"{name}.{_name(node)}"):
            parts.append(f"* [rf.{public}](rf.{public}.md): {_summary(node, following)}")
        else:
            parts.append(_member(node, following, fence="`" * 5))
    return "\n\n".join(parts)


def _documented(body: list[ast.stmt]) -> Iterator[tuple[ast.stmt, ast.stmt | None]]:
    """Yield public constants, functions and classes with a docstring, each name once."""
    seen: set[str] = set()
    for node, following in zip(body, [*body[1:], None], strict=True):
        name = _name(node)
        if name and name[0] != "_" and name not in seen and _doc(node, following) is not None:
            seen.add(name)
            yield node, following


def _member(node: ast.stmt, following: ast.stmt | None, fence: str) -> str:
    """Return the description of a constant, a function, or a class with its members."""
    inner = [markdown(_doc(node, following) or "")]
    if isinstance(node, ast.ClassDef):
        inner += [_member(*member, fence=fence[1:]) for member in _documented(node.body)]
    return "\n".join([fence + _directive(node, _name(node)), "", "\n\n".join(inner), fence])


def _doc(node: ast.stmt, following: ast.stmt | None) -> str | None:
    """Return the docstring of a definition; that of a constant follows it."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return ast.get_docstring(node)
    if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
        return str(following.value.value)
    return None


def _name(node: ast.stmt) -> str:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return node.name
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return node.target.id
    return ""


def _directive(node: ast.stmt, name: str) -> str:
    """Return Sphinx's directive of a definition, with its signature."""
    if isinstance(node, ast.ClassDef):
        return f"{{py:class}} {name}"
    if not isinstance(node, ast.FunctionDef):
        return f"{{py:data}} {name}"
    arguments = node.args
    method = bool(arguments.args) and arguments.args[0].arg in ("self", "cls")
    if method:
        arguments.args.pop(0)
    returned = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    if any(ast.unparse(decorator) == "property" for decorator in node.decorator_list):
        kind = f"\n:type: {ast.unparse(node.returns)}" if node.returns else ""
        return f"{{py:property}} {name}{kind}"
    signature = f"{name}({ast.unparse(arguments)}){returned}".replace("\n", " ")
    return f"{{py:{'method' if method else 'function'}}} {signature}"


def markdown(docstring: str) -> str:
    """Return a docstring as Markdown: Google's sections as lists, references as MyST's roles."""
    lines: list[str] = []
    section = ""
    for line in ROLE.sub(r"{py:\1}`", docstring).splitlines():
        if line in SECTIONS:
            section = line
            lines += [f"**{SECTIONS[line]}**", ""]
        elif not section or not line.strip():
            lines.append(line)
        elif not line.startswith("    "):
            section = ""
            lines += ["", line]
        elif section in ("Returns:", "Yields:"):
            lines.append(line[4:])
        else:
            lines.append(_entry(line[4:]))
    # in reStructuredText two colons begin a block of code
    return re.sub(r"::$", ":", "\n".join(lines), flags=re.MULTILINE)


def _entry(line: str) -> str:
    """Return a line of a section as part of a list."""
    found = ENTRY.match(line)
    if found is None:
        return f"  {line.strip()}"
    return f"* `{found[1]}`: {found[2]}"
