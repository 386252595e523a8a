"""Tables of a scene file: known keys, and conversion of parsed TOML into a scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import unknown_name
from receding_fenicsx.scene.model import (
    TABLE_OF,
    AccuracyOptions,
    Body,
    Bolt,
    Contact,
    HistoryOptions,
    Load,
    Material,
    MeshOptions,
    ModeOptions,
    OutputOptions,
    Probe,
    Scene,
    ShakedownOptions,
    SolverOptions,
    Spring,
    Support,
)
from receding_fenicsx.scene.toml_values import BY_TYPE, read_string
from receding_fenicsx.scene.units import Units

TABLES: dict[str, type] = {
    "material": Material,
    "mesh": MeshOptions,
    "history": HistoryOptions,
    "solver": SolverOptions,
    "output": OutputOptions,
    "units": Units,
    "shakedown": ShakedownOptions,
    "accuracy": AccuracyOptions,
    "mode": ModeOptions,
}
"""Tables that occur once, with the dataclass of each."""
ARRAYS: dict[str, type] = {
    "contact": Contact,
    "load": Load,
    "support": Support,
    "spring": Spring,
    "bolt": Bolt,
    "probe": Probe,
}
"""Tables that may occur several times, with the dataclass of each."""
ATTRIBUTE = {table: attribute for attribute, table in TABLE_OF.items()}
"""Attribute of a scene for each table that may occur several times."""
NAMED = ("body", "load", "probe", "bolt")
"""Tables that are identified by their names where there are several."""
KNOWN = ("title", "body", *TABLES, *ARRAYS)
"""Keys at the top of a scene file."""


def readers_of(kind: type) -> dict[str, Callable[[object, str], Any]]:
    """Return the reader of each field of a dataclass."""
    return {field.name: BY_TYPE[str(field.type)] for field in dataclasses.fields(kind)}


READERS = {kind: readers_of(kind) for kind in (Body, *TABLES.values(), *ARRAYS.values())}
"""Reader of each key of each table; the dataclasses define the known keys."""
# a material's name is in the header of its table
del READERS[Material]["name"]


def scene_of(raw: dict[str, Any]) -> Scene:
    """Convert parsed TOML into a scene; keys and types are checked, values are not.

    Raises:
        InputError: a key is unknown or missing, or a value has the wrong type.
    """
    for key in raw:
        if key not in KNOWN:
            unknown_name(key, KNOWN, "scene", "table")
    values: dict[str, Any] = {}
    if "title" in raw:
        values["title"] = read_string(raw["title"], "title")
    if "body" in raw:
        bodies = _array(raw["body"], Body, "body")
        if not bodies:
            raise InputError("[[body]]: the scene has none; add one")
        values["body"], values["others"] = bodies[0], bodies[1:]
    named = named_materials(raw)
    values["materials"] = tuple(
        replace(read_table(table, Material, "material", f"[material.{name}]"), name=name)
        for name, table in named.items()
    )
    if named:
        raw = {**raw, "material": {k: v for k, v in raw["material"].items() if k not in named}}
    for name, kind in TABLES.items():
        if name in raw:
            values[name] = read_table(raw[name], kind, name, f"[{name}]")
    for name, kind in ARRAYS.items():
        if name in raw:
            values[ATTRIBUTE[name]] = _array(raw[name], kind, name)
    return Scene(**values)


def named_materials(raw: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables [material.NAME] of parsed TOML."""
    table = raw.get("material", {})
    if not isinstance(table, dict):
        return {}
    return {
        name: value
        for name, value in table.items()
        if isinstance(value, dict) and name not in READERS[Material]
    }


def as_list(value: object, name: str) -> list[dict[str, Any]]:
    """Return the tables of an array [[name]]; a single table [name] is an array of one."""
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"'{name}' must be a table; write [[{name}]]")
    return tables


def _array(raw: object, kind: type, name: str) -> tuple[Any, ...]:
    tables = as_list(raw, name)
    return tuple(
        read_table(table, kind, name, _label(name, table, i, len(tables)))
        for i, table in enumerate(tables)
    )


def _label(name: str, table: dict[str, Any], index: int, count: int) -> str:
    """Return the name of a table in messages."""
    if name in NAMED and isinstance(table.get("name"), str) and (name != "body" or count > 1):
        return f"{name} '{table['name']}'"
    single = count == 1 and name in ("body", "contact")
    return f"[{name}]" if single else f"[[{name}]] number {index + 1}"


def read_table(raw: object, kind: type, name: str, label: str) -> Any:
    """Convert one table into its dataclass, whose fields are the known keys."""
    if not isinstance(raw, dict):
        raise InputError(f"'{name}' must be a table; write [{name}]")
    readers = READERS.get(kind) or readers_of(kind)
    for key, value in raw.items():
        if key not in readers:
            unknown_name(key, tuple(readers), label, "key")
    for field in dataclasses.fields(kind):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and field.name not in raw:
            raise InputError(f"{label}: the key '{field.name}' is missing; add it")
    return kind(**{key: readers[key](value, f"{label} {key}") for key, value in raw.items()})
