"""Scene files in TOML: reading, changing single values (``--set``), and writing."""

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
from receding_fenicsx.scene.checks import as_list, check_known
from receding_fenicsx.scene.model import TABLE_OF, Contact, Scene
from receding_fenicsx.scene.profiles import DIRECTIONS, with_files
from receding_fenicsx.scene.toml_reader import KNOWN, named_materials, parse_toml, plain, scene_of
from receding_fenicsx.scene.validate import check_rules


def read_scene(path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and validate a scene file.

    Args:
        path: TOML file.
        overrides: ``table.key=value`` or ``load.NAME.key=value``, as for ``--set``.

    Raises:
        InputError: the file cannot be read, or the scene cannot be modelled; one line each.
    """
    check_types("read_scene", path=(path, str, Path))
    text = read_text(path)
    try:
        return from_toml(text, overrides, Path(path).parent)
    except InputError as error:
        raise InputErrors(*(f"{path}: {line}" for line in str(error).splitlines())) from None


def from_toml(text: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Read and validate a scene from TOML text; see :func:`read_scene`.

    Paths are relative to ``folder``. By default paths of mesh files are left unchanged, and paths
    of tables are relative to the working directory.
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
    """Return the scene of a TOML text of :func:`to_toml`, which was valid by older rules."""
    raw = parse_toml(text)
    if not raw:
        raise InputError("the scene is empty")
    # keys of older versions that do not change the results
    for table, key in (("accuracy", "grading"), ("solver", "overshoot")):
        raw.get(table, {}).pop(key, None)
    return scene_of(raw)


def from_raw(raw: dict[str, Any], folder: Path | None = None) -> Scene:
    """Convert parsed TOML into a scene and validate it; see :func:`from_toml`."""
    scene = scene_of(with_files(raw, folder or Path()))
    if folder is not None:
        bodies = []
        for body in scene.bodies:
            path = (folder / (body.mesh or "")).resolve()
            if body.mesh is not None and not path.is_file():
                raise InputError(f'[body] mesh: "{body.mesh}": no such file; check the path')
            bodies.append(replace(body, mesh=body.mesh and str(path)))
        scene = replace(scene, body=bodies[0], others=tuple(bodies[1:]))
    check_rules(scene)
    return scene


def to_toml(scene: Scene) -> str:
    """Return the TOML text of a scene without unused options; reading it gives an equal scene."""
    tables: dict[str, Any] = {}
    for field in dataclasses.fields(scene):
        table, value = TABLE_OF.get(field.name, field.name), getattr(scene, field.name)
        off = table in ("units", "shakedown", "accuracy", "mode", "wear") and value == type(value)()
        if field.name == "materials":
            tables[table] |= {m.name: plain(replace(m, name=""), sparse=True) for m in value}
        elif field.name == "others" and value:
            tables[table] = [tables[table], *plain(value, sparse=True)]
        elif value not in (None, ()) and not off:
            tables[table] = plain(value, sparse=True)
    # no table fits into a line of this indent, so that each gets a header of its own
    text = re.sub(r"(?m)^ +", "    ", tomli_w.dumps(tables, indent=100))
    # strings hold no line breaks; lists without brackets in them fit on one line
    return re.sub(
        r"\[\n    ((?:[^\n\[\]{}]*,\n *)+)\]",
        lambda found: f"[{found[1].strip()[:-1]}]".replace(",\n    ", ", "),
        text,
    )


def apply_override(raw: dict[str, Any], override: str) -> None:
    """Change one value of a parsed scene file in place.

    The override is ``table.key=value``, ``load.NAME.key=value`` or ``title=value``; of
    ``contact.friction.forward`` the other direction stays as it is. Text that is no TOML is a
    string, so that a shell command needs no quotes for it.
    """
    key, equals, text = override.partition("=")
    where = f"--set {override}"
    if not equals or not all(part.strip() for part in key.split(".")):
        raise InputError(f"{where}: write table.key=value, for example contact.friction=0.5")
    # a title may be any text
    set_value(raw, key, parse_value(text, None if key.strip() == "title" else where), where)


def parse_value(text: str, where: str | None) -> Any:
    """Return a value of TOML, or a string; it begins as no list or table unless not ``where``."""
    try:
        parsed = parse_toml(f"value = {text}")
    except InputError as error:
        if where is not None and text.strip().startswith(("{", "[")):
            raise InputError(f"{where}: the value is {str(error).partition(' (')[0]}") from None
        return text.strip()
    return parsed["value"] if set(parsed) == {"value"} else text


def set_value(raw: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Change one value by its key, as of :func:`apply_override`; ``where`` begins messages."""
    kind, *names = (part.strip() for part in key.split("."))
    if kind == "title" and not names:
        raw["title"] = value
        return
    check_known(kind, KNOWN, where, "table")
    if kind == "title" or not names:
        raise InputError(f"{where}: write {kind}{'' if kind == 'title' else '.key'}=value")
    table, (name, *parts) = _table_to_set(raw, kind, names, where)
    if parts and name not in ("friction", "parameters", "constant", "harmonic", "mean"):
        raise InputError(f"{where}: write {kind}.key=value")
    if parts and name == "friction":
        check_known(parts[0], DIRECTIONS, where, "key")
        given = table.get(name, Contact.friction)
        if not isinstance(given, dict) or not set(given) & set(DIRECTIONS):
            table[name] = dict.fromkeys(DIRECTIONS, given)
    # names of loads may hold dots
    last = [parts.pop()] if name == "harmonic" and len(parts) > 1 else []
    *steps, last_key = [name, *([".".join(parts)] if parts else []), *last]
    for step in steps:
        inner = table.get(step)
        table[step] = {**inner} if isinstance(inner, dict) else {}
        table = table[step]
    table[last_key] = value


def _table_to_set(
    raw: dict[str, Any], kind: str, names: list[str], where: str
) -> tuple[dict[str, Any], list[str]]:
    """Return the table that "kind.NAMES" changes, and the keys in it."""
    named = ".".join(names[:-1])
    if kind == "material" and named in named_materials(raw):
        return named_materials(raw)[named], names[-1:]
    table = raw.setdefault(kind, {})
    single = kind in ("body", "material") or kind not in TABLE_OF.values()
    if single and isinstance(table, dict):
        return table, names
    tables = as_list(table, kind)
    for n in range(len(names) - 1, 0, -1):
        # a name, which may hold dots, with a number where several have it; or a number alone
        label, base, number = ".".join(names[:n]), ".".join(names[: n - 1]), names[n - 1]
        chosen = [table for table in tables if table.get("name") == label]
        alike = [table for table in tables if table.get("name") == base] if base else tables
        if not chosen and number.isdecimal() and 1 <= int(number) <= len(alike):
            chosen = [alike[int(number) - 1]]
        if len(chosen) > 1:
            ways = f"write {kind}.{label}.N.{names[-1]}, N = 1 to {len(chosen)}"
            raise InputError(f"{where}: {len(chosen)} [[{kind}]] are named '{label}'; {ways}")
        if chosen:
            return chosen[0], names[n:]
    identified = kind in ("body", "load", "probe", "bolt")
    if identified and named:
        known = [str(table["name"]) for table in tables if "name" in table]
        check_known(named, known, where, kind)
    if kind == "load":
        raise InputError(f"{where}: name the load, for example load.p0.pressure=2.0")
    if len(tables) != 1:
        which = f"{kind}.{'NAME' if identified else f'N (1 to {len(tables)})'}.key=value"
        raise InputError(f"{where}: the scene has {len(tables)} [[{kind}]] tables; write {which}")
    return tables[0], names
