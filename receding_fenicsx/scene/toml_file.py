"""Scene files in TOML: reading and writing."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import tomli_w

from receding_fenicsx.arrays import check_types
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError, InputErrors
from receding_fenicsx.scene.column_file import with_files
from receding_fenicsx.scene.model import TABLE_OF, Body, Scene
from receding_fenicsx.scene.toml_overrides import apply_override
from receding_fenicsx.scene.toml_reader import parse_toml, plain, scene_of
from receding_fenicsx.scene.validate import check_rules


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
        raise InputErrors(*(f"{path}: {line}" for line in str(error).splitlines())) from None


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
    scene = scene_of(with_files(raw, folder or Path()))
    if folder is not None:
        found = [_with_path(body, folder) for body in scene.bodies]
        scene = replace(scene, body=found[0], others=tuple(found[1:]))
    check_rules(scene)
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
    # no table fits into a line of this indent, so that each gets a header of its own
    text = re.sub(r"(?m)^ +", "    ", tomli_w.dumps(tables_of(scene), indent=100))
    # strings hold no line breaks; lists without brackets in them fit on one line
    return re.sub(
        r"\[\n    ((?:[^\n\[\]{}]*,\n *)+)\]",
        lambda found: f"[{found[1].strip()[:-1]}]".replace(",\n    ", ", "),
        text,
    )


def tables_of(scene: Scene) -> dict[str, Any]:
    """Return a scene as the tables of its file, as parsed TOML has them.

    Empty values and tables of options that are not used are left out.
    """
    tables: dict[str, Any] = {}
    for field in dataclasses.fields(scene):
        table, value = TABLE_OF.get(field.name, field.name), getattr(scene, field.name)
        if field.name == "materials":
            tables[table] |= {m.name: plain(replace(m, name=""), sparse=True) for m in value}
        elif field.name == "others":
            tables[table] = [tables[table], *plain(value, sparse=True)] if value else tables[table]
        elif table not in ("units", "shakedown", "accuracy", "mode") or value != type(value)():
            tables[table] = plain(value, sparse=True)
    return {name: table for name, table in tables.items() if table != []}
