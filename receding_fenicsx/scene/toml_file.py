"""Scene files in TOML: reading and writing."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from receding_fenicsx.arrays import check_types
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.history.signal_file import with_signals
from receding_fenicsx.scene.model import (
    RECTANGLE_KEYS,
    AccuracyOptions,
    Body,
    ModeOptions,
    Scene,
    ShakedownOptions,
)
from receding_fenicsx.scene.profiles import inline_files
from receding_fenicsx.scene.toml_overrides import apply_override
from receding_fenicsx.scene.toml_tables import ARRAYS, ATTRIBUTE, scene_of
from receding_fenicsx.scene.toml_values import parse_toml
from receding_fenicsx.scene.units import Units
from receding_fenicsx.scene.validate import validate


def read_scene(path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and validate a scene file.

    Args:
        path: TOML file.
        overrides: ``table.key=value`` or ``load.NAME.key=value``, as for ``--set``.

    Returns:
        The validated scene.

    Raises:
        InputError: the file cannot be read, or the scene cannot be modelled; one line.
    """
    check_types("read_scene", path=(path, str, Path))
    text = read_text(path)
    try:
        return from_toml(text, overrides, Path(path).parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def from_toml(text: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Read and validate a scene from TOML text; see :func:`read_scene`.

    Args:
        text: content of a scene file.
        overrides: ``table.key=value`` or ``load.NAME.key=value``.
        folder: folder that paths are relative to. Default: paths of mesh files are left unchanged,
            paths of tables are relative to the working directory.

    Returns:
        The validated scene.
    """
    check_types("scene", text=(text, str), overrides=(overrides, Iterable))
    overrides = list(overrides)
    for override in overrides:
        check_types("scene", override=(override, str))
    raw = parse_toml(text)
    for override in overrides:
        apply_override(raw, override)
    return from_raw(raw, folder)


@lru_cache(maxsize=16)
def known_scene(text: str) -> Scene:
    """Return the scene of a TOML text of :func:`to_toml`, read once."""
    return from_toml(text)


def from_raw(raw: dict[str, Any], folder: Path | None = None) -> Scene:
    """Convert parsed TOML into a scene and validate it; see :func:`from_toml`."""
    raw = with_signals(raw, folder or Path())
    scene = scene_of(inline_files(raw, folder or Path()))
    if folder is not None:
        found = [_with_path(body, folder) for body in scene.bodies]
        scene = replace(scene, body=found[0], others=tuple(found[1:]))
    validate(scene)
    return scene


def _with_path(body: Body, folder: Path) -> Body:
    """Return the body with the absolute path of its mesh file; raise if there is no such file."""
    if body.mesh is None:
        return body
    path = (folder / body.mesh).resolve()
    if not path.is_file():
        raise InputError(f'[body] mesh: "{body.mesh}": no such file; check the path')
    return replace(body, mesh=str(path))


def to_toml(scene: Scene) -> str:
    """Return the TOML text of a scene with all values; reading it gives an equal scene."""
    lines = [f"title = {_text(scene.title)}"]
    for body in scene.bodies:
        lines += ["", "[[body]]" if scene.others else "[body]", *_lines(body)]
    lines += ["", "[material]", *_lines(scene.material)]
    for material in scene.materials:
        lines += ["", f"[material.{_text(material.name)}]", *_lines(replace(material, name=""))]
    lines += ["", "[mesh]", *_lines(scene.mesh)]
    for name in ARRAYS:
        for item in getattr(scene, ATTRIBUTE[name]):
            lines += ["", f"[[{name}]]", *_lines(item)]
    for name in ("history", "solver", "output"):
        lines += ["", f"[{name}]", *_lines(getattr(scene, name))]
    options = {"units": Units(), "shakedown": ShakedownOptions(), "accuracy": AccuracyOptions()}
    options["mode"] = ModeOptions()
    for name, default in options.items():
        if getattr(scene, name) != default:
            lines += ["", f"[{name}]", *_lines(getattr(scene, name))]
    return "\n".join(lines) + "\n"


def _lines(table: Any) -> list[str]:
    """Return one line per field; None, empty names and edges, empty defaults are omitted."""
    fields = [(f.name, getattr(table, f.name), f.default) for f in dataclasses.fields(table)]
    if isinstance(table, Body) and table.mesh is not None:
        fields = [field for field in fields if field[0] not in RECTANGLE_KEYS]
    return [
        f"{name} = {_text(value)}"
        for name, value, default in fields
        if value is not None
        and value != {}
        and (value != () or default is None)
        and (name, value) not in (("name", ""), ("edge", ""))
    ]


def _text(value: object) -> str:
    """Return a value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a TOML basic string is a JSON string except for DEL, which JSON does not escape
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_text(item)}" for k, item in value.items()) + "}"
    if dataclasses.is_dataclass(value):
        return "{" + ", ".join(_lines(value)) + "}"
    if isinstance(value, int):
        return str(int(value))
    return repr(float(value))  # type: ignore[arg-type]


def _key(name: str) -> str:
    """Return a key as TOML, in quotes where it is not bare."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _text(name)
