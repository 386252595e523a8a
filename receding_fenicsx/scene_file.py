"""Scenes as TOML: reading with clear messages, ``--set`` overrides, writing canonical text."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import (
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
from receding_fenicsx.scene_values import BY_TYPE, read_string, unknown_name

TABLES: dict[str, type] = {
    "body": Body,
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

LATER = {
    "body": {"mesh": "a user's own mesh", "name": "a second body"},
    "contact": {"against": "contact between two bodies"},
    "load": {
        "displacement": "a prescribed edge displacement",
        "platen": "a platen",
        "force": "a platen",
    },
    "solver": {"on_jump": "stepping over a jump", "checkpoint_cycles": "a checkpoint"},
    "output": {"checkpoint_cycles": "a checkpoint"},
}
"""Keys that are known but cannot be served yet, by table."""


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
        text = Path(path).read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such scene file; check the path") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8; give a scene in TOML") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); give a scene in TOML"
        ) from None
    try:
        return from_toml(text, overrides)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def from_toml(text: str, overrides: Iterable[str] = ()) -> Scene:
    """Make a checked scene from TOML text; see :func:`read_scene`."""
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"not valid TOML: {error}".replace("\n", " ")) from None
    for override in overrides:
        apply_override(raw, override)
    scene = _scene(raw)
    scene.validate()
    return scene


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
    known = ["title", *TABLES, *ARRAYS]
    if names == ["title"]:
        raw["title"] = value
        return
    if names[0] not in known:
        unknown_name(names[0], known, f"--set {override}", "table")
    if names[0] == "title" or len(names) == 1:
        raise InputError(f"--set {override}: write {names[0]}.key=value")
    if names[0] == "load":
        if len(names) < 3:
            raise InputError(f"--set {override}: name the load, for example load.p0.pressure=2.0")
        # a load's name may itself hold a dot
        name, last = ".".join(names[1:-1]), names[-1]
        loads = _as_list(raw.get("load", []), "load")
        chosen = [load for load in loads if load.get("name") == name]
        if not chosen:
            unknown_name(
                name, [str(load.get("name")) for load in loads], f"--set {override}", "load"
            )
        chosen[0][last] = value
        return
    if len(names) != 2:
        raise InputError(f"--set {override}: write {names[0]}.key=value")
    if names[0] in ARRAYS:
        tables = _as_list(raw.setdefault(names[0], {}), names[0])
        if len(tables) != 1:
            raise InputError(
                f"--set {override}: the scene has {len(tables)} [[{names[0]}]] tables; edit the "
                "file"
            )
        tables[0][names[1]] = value
        return
    table = raw.setdefault(names[0], {})
    if not isinstance(table, dict):
        raise InputError(f"'{names[0]}' must be a table; write [{names[0]}]")
    table[names[1]] = value


def to_toml(scene: Scene) -> str:
    """Canonical TOML text of a scene, every value written out; reading it gives an equal scene."""
    lines = [f"title = {_text(scene.title)}"]
    for name in ("body", "material", "mesh"):
        lines += ["", f"[{name}]", *_lines(getattr(scene, name))]
    for name, (_, attribute) in ARRAYS.items():
        for item in getattr(scene, attribute):
            lines += ["", f"[[{name}]]", *_lines(item)]
    for name in ("history", "solver", "output"):
        lines += ["", f"[{name}]", *_lines(getattr(scene, name))]
    return "\n".join(lines) + "\n"


def _lines(table: Any) -> list[str]:
    """One line a field; None and empty sequences have no TOML value and are left out."""
    fields = ((f.name, getattr(table, f.name)) for f in dataclasses.fields(table))
    return [
        f"{name} = {_text(value)}" for name, value in fields if value is not None and value != ()
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
    known = ["title", *TABLES, *ARRAYS]
    for key in raw:
        if key not in known:
            unknown_name(key, known, "scene", "table")
    if isinstance(raw.get("body"), list):
        if len(raw["body"]) != 1:
            raise InputError("[[body]]: two bodies are not available yet; write one [body] table")
        raw = {**raw, "body": raw["body"][0]}
    values: dict[str, Any] = {}
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
    if name == "load" and isinstance(table.get("name"), str):
        return f"load '{table['name']}'"
    return f"[[{name}]] number {index + 1}" if count > 1 or name != "contact" else f"[{name}]"


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
        if key in LATER.get(name, {}):
            if (name, key) == ("body", "mesh") and not Path(str(value)).is_file():
                raise InputError(f'{label} mesh: "{value}": no such file; check the path')
            raise InputError(
                f"{label} {key}: {LATER[name][key]} is not available yet; leave it out"
            )
        if name == "material" and isinstance(value, dict) and key not in readers:
            raise InputError(
                f"[material.{key}]: a second body is not available yet; write one [material]"
            )
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
    for kind in (*TABLES.values(), *(kind for kind, _ in ARRAYS.values()))
}
"""The reader of each key of each table: the dataclasses are the one list of known keys."""
