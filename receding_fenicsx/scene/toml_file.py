"""Scenes as TOML: reading with clear messages, ``--set`` overrides, writing canonical text."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import (
    OF_RECTANGLES,
    Body,
    Contact,
    HistoryOptions,
    Load,
    Material,
    MeshOptions,
    OutputOptions,
    Scene,
    SolverOptions,
    Support,
)
from receding_fenicsx.scene.toml_tables import inline_files
from receding_fenicsx.scene.toml_values import BY_TYPE, read_string, unknown_name
from receding_fenicsx.scene.validate import validate

TABLES: dict[str, type] = {
    "material": Material,
    "mesh": MeshOptions,
    "history": HistoryOptions,
    "solver": SolverOptions,
    "output": OutputOptions,
}
"""Tables that occur once, and the dataclass of each; the scene's attribute has the table's name."""

ARRAYS: dict[str, tuple[type, str]] = {
    "contact": (Contact, "contacts"),
    "load": (Load, "loads"),
    "support": (Support, "supports"),
}
"""Tables that may occur several times: the dataclass of each and the attribute of the scene."""

NAMED = ("body", "load")
"""Tables that may occur several times and are then told apart by their names."""


def read_scene(path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene file.

    Args:
        path: TOML file.
        overrides: ``table.key=value`` or ``load.NAME.key=value``, as for ``--set``.

    Returns:
        The checked scene.

    Raises:
        InputError: the file cannot be read, or the scene cannot be modelled; one line.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such scene file; check the path") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8; give a scene in TOML") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); give a scene in TOML"
        ) from None
    try:
        return from_toml(text, overrides, Path(path).parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def from_toml(text: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Make a checked scene from TOML text; see :func:`read_scene`.

    Args:
        text: the scene.
        overrides: changes to it.
        folder: folder that the paths of files are relative to. When left out, those of mesh files
            are kept as they are, those of tables are relative to the present folder.

    Returns:
        The checked scene.
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"not valid TOML: {error}".replace("\n", " ")) from None
    for override in overrides:
        apply_override(raw, override)
    scene = _scene(inline_files(raw, folder or Path()))
    if folder is not None:
        found = [_with_path(body, folder) for body in scene.bodies]
        scene = replace(scene, body=found[0], others=tuple(found[1:]))
    validate(scene)
    return scene


def _with_path(body: Body, folder: Path) -> Body:
    """Return the body with the whole path of its mesh file, which has to be there."""
    if body.mesh is None:
        return body
    path = (folder / body.mesh).resolve()
    if not path.is_file():
        raise InputError(f'[body] mesh: "{body.mesh}": no such file; check the path')
    return replace(body, mesh=str(path))


def apply_override(raw: dict[str, Any], override: str) -> None:
    """Change one value of a parsed scene file in place.

    The value is read as TOML; text that is not TOML (a word, an expression) is taken as a string,
    so that no quotes need to be passed through a shell.

    Args:
        raw: the parsed file.
        override: ``table.key=value``, ``load.NAME.key=value`` or ``title=value``.

    Raises:
        InputError: the text has no such form, or names a table or load that the scene does not
            have.
    """
    key, equals, text = override.partition("=")
    names = [part.strip() for part in key.split(".")]
    if not equals or not all(names):
        raise InputError(
            f"--set {override}: write table.key=value, for example contact.friction=0.5"
        )
    try:
        parsed = tomllib.loads(f"value = {text}")
        value = parsed["value"] if set(parsed) == {"value"} else text
    except (tomllib.TOMLDecodeError, RecursionError):
        value = text.strip()
    known = ["title", "body", *TABLES, *ARRAYS]
    if names == ["title"]:
        raw["title"] = value
        return
    if names[0] not in known:
        unknown_name(names[0], known, f"--set {override}", "table")
    if names[0] == "title" or len(names) == 1:
        raise InputError(f"--set {override}: write {names[0]}.key=value")
    _table_to_set(raw, names, override)[names[-1]] = value


def _table_to_set(raw: dict[str, Any], names: list[str], override: str) -> dict[str, Any]:
    """Find the table that an override "table.key" or "table.NAME.key" changes."""
    kind = names[0]
    # a name may itself hold a dot
    name = ".".join(names[1:-1])
    if kind == "load" and not name:
        raise InputError(f"--set {override}: name the load, for example load.p0.pressure=2.0")
    if kind == "material" and name in _named_materials(raw):
        return _named_materials(raw)[name]
    if kind in ARRAYS or isinstance(raw.get(kind), list):
        tables = _as_list(raw.setdefault(kind, {}), kind)
        if kind in NAMED and name:
            chosen = [table for table in tables if table.get("name") == name]
            if not chosen:
                known = [str(table["name"]) for table in tables if "name" in table]
                unknown_name(name, known, f"--set {override}", kind)
            return chosen[0]
        if name.isdecimal() and 1 <= int(name) <= len(tables):
            return tables[int(name) - 1]
        if len(tables) != 1:
            which = "NAME" if kind in NAMED else f"N (1 to {len(tables)})"
            raise InputError(
                f"--set {override}: the scene has {len(tables)} [[{kind}]] tables; write "
                f"{kind}.{which}.key=value"
            )
        if not name:
            return tables[0]
    table = raw.setdefault(kind, {})
    if name:
        raise InputError(f"--set {override}: write {kind}.key=value")
    if not isinstance(table, dict):
        raise InputError(f"'{kind}' must be a table; write [{kind}]")
    return table


def _named_materials(raw: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables [material.NAME] of a parsed file."""
    table = raw.get("material", {})
    if not isinstance(table, dict):
        return {}
    return {
        name: value
        for name, value in table.items()
        if isinstance(value, dict) and name not in READERS[Material]
    }


def to_toml(scene: Scene) -> str:
    """Canonical TOML text of a scene, every value written out; reading it gives an equal scene."""
    lines = [f"title = {_text(scene.title)}"]
    for body in scene.bodies:
        lines += ["", "[[body]]" if scene.others else "[body]", *_lines(body)]
    lines += ["", "[material]", *_lines(scene.material)]
    for material in scene.materials:
        lines += ["", f"[material.{_text(material.name)}]", *_lines(replace(material, name=""))]
    lines += ["", "[mesh]", *_lines(scene.mesh)]
    for name, (_, attribute) in ARRAYS.items():
        for item in getattr(scene, attribute):
            lines += ["", f"[[{name}]]", *_lines(item)]
    for name in ("history", "solver", "output"):
        lines += ["", f"[{name}]", *_lines(getattr(scene, name))]
    return "\n".join(lines) + "\n"


def _lines(table: Any) -> list[str]:
    """One line a field; None, empty names, sequences and tables are left out."""
    named = [f.name for f in dataclasses.fields(table)]
    if isinstance(table, Body) and table.mesh is not None:
        named = [name for name in named if name not in OF_RECTANGLES]
    fields = ((name, getattr(table, name)) for name in named)
    return [
        f"{name} = {_text(value)}"
        for name, value in fields
        if value is not None and value not in ((), {}) and (name, value) != ("name", "")
    ]


def _text(value: object) -> str:
    """One value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a TOML basic string is a JSON string, but for DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, int):
        return str(int(value))
    return repr(float(value))  # type: ignore[arg-type]


def _scene(raw: dict[str, Any]) -> Scene:
    """Scene from parsed TOML: keys and types are checked here, meanings in ``scene_checks``."""
    known = ["title", "body", *TABLES, *ARRAYS]
    for key in raw:
        if key not in known:
            unknown_name(key, known, "scene", "table")
    values: dict[str, Any] = {}
    if "body" in raw:
        tables = _as_list(raw["body"], "body")
        labels = [_label("body", table, i, len(tables)) for i, table in enumerate(tables)]
        bodies = [
            _table(table, Body, "body", label) for table, label in zip(tables, labels, strict=True)
        ]
        if not bodies:
            raise InputError("[[body]]: the scene has none; add one")
        values["body"], values["others"] = bodies[0], tuple(bodies[1:])
    named = _named_materials(raw)
    values["materials"] = tuple(
        replace(_table(table, Material, "material", f"[material.{name}]"), name=name)
        for name, table in named.items()
    )
    if named:
        raw = {**raw, "material": {k: v for k, v in raw["material"].items() if k not in named}}
    if "title" in raw:
        values["title"] = read_string(raw["title"], "title")
    for name, kind in TABLES.items():
        if name in raw:
            values[name] = _table(raw[name], kind, name, f"[{name}]")
    for name, (kind, attribute) in ARRAYS.items():
        if name in raw:
            tables = _as_list(raw[name], name)
            labels = [_label(name, table, i, len(tables)) for i, table in enumerate(tables)]
            values[attribute] = tuple(
                _table(table, kind, name, label)
                for table, label in zip(tables, labels, strict=True)
            )
    return Scene(**values)


def _label(name: str, table: dict[str, Any], index: int, count: int) -> str:
    """How a message names a table: loads by their name, others by number when there are several."""
    if name in NAMED and isinstance(table.get("name"), str) and (name == "load" or count > 1):
        return f"{name} '{table['name']}'"
    single = count == 1 and name in ("body", "contact")
    return f"[{name}]" if single else f"[[{name}]] number {index + 1}"


def _as_list(value: object, name: str) -> list[dict[str, Any]]:
    """The tables of a [[name]] array; a single [name] table counts as an array of one."""
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"'{name}' must be a table; write [[{name}]]")
    return tables


def _table(raw: object, kind: type, name: str, label: str) -> Any:
    """Make one dataclass from one table, key by key."""
    if not isinstance(raw, dict):
        raise InputError(f"'{name}' must be a table; write [{name}]")
    readers = READERS[kind]
    for key, value in raw.items():
        if key not in readers:
            unknown_name(key, list(readers), label, "key")
    for field in dataclasses.fields(kind):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and field.name not in raw:
            raise InputError(f"{label}: the key '{field.name}' is missing; add it")
    return kind(**{key: readers[key](value, f"{label} {key}") for key, value in raw.items()})


READERS: dict[type, dict[str, Callable[[object, str], Any]]] = {
    kind: {field.name: BY_TYPE[str(field.type)] for field in dataclasses.fields(kind)}
    for kind in (Body, *TABLES.values(), *(kind for kind, _ in ARRAYS.values()))
}
# a material's name stands in the head of its table
del READERS[Material]["name"]
"""The reader of each key of each table: the dataclasses are the one list of known keys."""
