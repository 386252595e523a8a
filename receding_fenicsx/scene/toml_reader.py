"""Conversion of parsed TOML into dataclasses, by Pydantic, with all errors in plain words."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
import tomllib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, get_args, get_type_hints

from receding_fenicsx.arrays import shortened
from receding_fenicsx.errors import InputError, InputErrors
from receding_fenicsx.scene.checks import (
    LARGEST,
    SMALLEST,
    WORDS,
    Table,
    as_list,
    is_given,
    suggestion,
)
from receding_fenicsx.scene.model import RECTANGLE_KEYS, TABLE_OF, Material, Scene

Place = tuple[str | int, ...]
"""Keys and numbers of list entries that lead to a value."""

KNOWN = tuple(dict.fromkeys(TABLE_OF.get(f.name, f.name) for f in dataclasses.fields(Scene)))
"""Keys at the top of a scene file."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML text."""
    part = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
    # the parser's memory grows with the square of the number of parts
    if re.search(rf"""(?<![\w"'\\-])(?:{part}[ \t]*+\.[ \t]*+){{50}}""", text):
        raise InputError("not valid TOML: a key has more than 50 parts")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # whole numbers of too many digits included
        reason = str(error).partition("; use sys")[0].replace("\n", " ")
        raise InputError(f"not valid TOML: {reason}") from None


def scene_of(raw: dict[str, Any]) -> Scene:
    """Convert parsed TOML into a scene; types, ranges and choices are checked, rules are not."""
    unknown = [key for key in raw if key not in KNOWN]
    messages = [f"scene: unknown table '{key}'; {suggestion(key, KNOWN)}" for key in unknown]
    values = {key: value for key, value in raw.items() if key not in unknown}
    for attribute, name in TABLE_OF.items():
        if name in values and name != "material":
            values[attribute] = as_list(values.pop(name), name)
    if "others" in values:
        if not values["others"]:
            raise InputError("[[body]]: the scene has none; add one")
        values["body"], *values["others"] = values["others"]
    named, common = named_materials(raw), {}
    materials = [(f"[material.{name}]", table) for name, table in named.items()]
    if isinstance(raw.get("material"), dict):
        values["material"] = {k: v for k, v in raw["material"].items() if k not in named}
        materials.append(("[material]", values["material"]))
        # all bodies have the same kinematics
        common = {k: v for k, v in values["material"].items() if k == "kinematics"}
    # a material's name is in the header of its table
    messages += [f"{where}: unknown key 'name'; remove it" for where, m in materials if "name" in m]
    values["materials"] = [{**common, **table, "name": name} for name, table in named.items()]
    try:
        scene: Scene = convert(Scene, values, lambda place: _label(values, place))
    except InputErrors as error:
        messages += error.args
    if messages:
        raise InputErrors(*messages)
    return scene


def named_materials(raw: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables [material.NAME] of parsed TOML."""
    table, keys = raw.get("material", {}), [field.name for field in dataclasses.fields(Material)]
    if not isinstance(table, dict):
        return {}
    return {k: v for k, v in table.items() if isinstance(v, dict) and k not in keys}


def plain(value: Any, sparse: bool = False) -> Any:
    """Return a value as parsed TOML; ``sparse`` omits empty defaults and sides of meshed bodies."""
    if isinstance(value, list | tuple):
        return [plain(item, sparse) for item in value]
    if isinstance(value, dict):
        return {key: plain(item, sparse) for key, item in value.items()}
    if not dataclasses.is_dataclass(value):
        return value
    omitted = RECTANGLE_KEYS if sparse and getattr(value, "mesh", None) is not None else ()
    return {
        name: plain(item, sparse)
        for name, item in [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
        if not sparse
        or (name not in omitted and (is_given(value, name) or item not in (None, "", (), {})))
    }


def check_values(table: Table, label: str = "") -> None:
    """Check types, ranges and choices of a scene, or of one of its tables, made in Python."""
    values = plain(table)
    scene = isinstance(table, Scene)
    convert(type(table), values, lambda place: _label(values, place) if scene else (label, place))


def _label(values: dict[str, Any], place: Place) -> tuple[str, Place]:
    """Return the name of a table in messages, and the place of the value in it."""
    attribute, *rest = place or ("scene",)
    table = TABLE_OF.get(str(attribute), str(attribute))
    value = values.get(str(attribute))
    if table == "title" or (not rest and not isinstance(value, dict)):
        return table, tuple(rest)
    index, several = 0, table == "body" and bool(values.get("others"))
    if isinstance(value, list):
        index, *rest = rest  # type: ignore[assignment]
        several |= len(value) > 1 or table != "contact"
        value = value[index]
    name = value.get("name") if isinstance(value, dict) else None
    label = f"[[{table}]] number {index + 1 + (attribute == 'others')}" if several else f"[{table}]"
    if table == "material":
        label = f"[material.{name}]" if name and attribute == "materials" else "[material]"
    elif isinstance(name, str) and several:
        label = f"{table} '{name}'"
    return label, tuple(rest)


@lru_cache(maxsize=32)
def type_adapter(kind: type) -> Any:
    """Return Pydantic's reader of a dataclass; Pydantic is loaded when it is first needed."""
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def convert(kind: type, raw: Any, label: Callable[[Place], tuple[str, Place]]) -> Any:
    """Convert a parsed table; ``label`` splits places into the table in messages and the rest."""
    from pydantic import ValidationError

    # in JSON lists may become tuples; dates, which it lacks, become what no key may be
    text = json.dumps(raw, default=lambda value: {str(value): None})
    if re.search(r"(?<!\\)(\\\\)*\\u0000", text):  # which no file or name can have
        raise InputError(f"{_where(label, ())}: a text holds a NUL character; remove it")
    try:
        return type_adapter(kind).validate_json(text)
    except ValidationError as error:
        errors: list[Any] = error.errors(include_url=False)
    lines = [*dict.fromkeys(_message(kind, item, label) for item in errors)]
    more = [f"{_where(label, ())}: {len(lines) - 20} more errors"] if len(lines) > 20 else []
    raise InputErrors(*lines[:20], *more)


def _message(kind: type, item: dict[str, Any], label: Callable[[Place], tuple[str, Place]]) -> str:
    """Return one line for an error: where it is, what is wrong, what to do."""
    error, value, bounds = item["type"], item["input"], item.get("ctx", {})
    place = tuple(part for part in item["loc"] if part not in WORDS.values())
    if place[-1:] == ("[key]",):
        place, error = place[:-1], "key"
    pair = error == "too_long" or (error == "missing" and isinstance(place[-1], int))
    keyed = error in ("missing", "unexpected_keyword_argument", "key") and not pair
    inside = place[:-1] if error == "missing" or keyed else place
    where = _where(label, inside)
    if keyed:
        if error == "missing":
            return f"{where}: the key '{place[-1]}' is missing; add it"
        known = re.findall(r"'([^']*)'", bounds.get("expected", ""))
        known = known or [field.name for field in dataclasses.fields(_table_at(kind, inside))]
        return f"{where}: unknown key '{place[-1]}'; {suggestion(str(place[-1]), known)}"
    shown = shortened(json.dumps(value, default=str, ensure_ascii=False))
    if error == "literal_error":
        choices = bounds["expected"].replace("'", '"')
        return f"{where}: {shown} is unknown; use {choices}"
    if error == "string_too_long":
        return f"{where}: must have at most {bounds['max_length']} characters, not {len(value)}"
    wanted = "a finite number" if error == "finite_number" else item["msg"]
    if pair:
        wanted = "a pair [a, b]"
    elif error == "union_tag_invalid":
        *others, last = re.findall("'([^']*)'", bounds["expected_tags"])
        wanted = f"{', '.join(others)} or {last}"
    elif error.endswith(("_type", "_from_float")):
        wanted = WORDS[error.partition("_")[0]]
    for key, words in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most")):
        if key in bounds and not pair:
            bound = bounds[key]
            if abs(bound) in (LARGEST, SMALLEST) and value > 0.0:
                beyond = f"{'below' if bound == SMALLEST else 'beyond'} {bound:g}"
                return f"{where}: {shown} is {beyond}; choose units in which it is nearer to 1"
            wanted = f"{words} {bound if isinstance(bound, int) else f'{bound:g}'}"
            positive = dict.fromkeys(("above 0", f"at least {SMALLEST:g}"), "positive")
            wanted = (positive | {"at least 0": "0 or more"}).get(wanted, wanted)
    return f"{where}: must be {wanted}, not {shown}"


def _where(label: Callable[[Place], tuple[str, Place]], place: Place) -> str:
    """Return a place as messages begin with it."""
    table, rest = label(place)
    for k, part in enumerate(rest):
        table += f" entry {part + 1}" if isinstance(part, int) else f"{'.' if k else ' '}{part}"
    return table


def _table_at(kind: type, place: Place) -> type:
    """Return the dataclass of the table at a place."""

    def tables(hint: Any) -> list[Any]:
        inner = [table for part in get_args(hint) for table in tables(part)]
        return [hint] if dataclasses.is_dataclass(hint) else inner

    for part in place:
        kind = next(iter(tables(get_type_hints(kind).get(str(part)))), kind)
    return kind


def descriptions(kind: type[Table]) -> dict[str, str]:
    """Return the text of each key of a table, from its docstring."""
    section = (inspect.getdoc(kind) or "").partition("Attributes:\n")[2].partition("\n\n")[0]
    found = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", section, re.M)
    return {name: " ".join(text.split()) for name, text in found}


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of scene files."""
    whole = _cleaned(type_adapter(Scene).json_schema())
    tables = whole["$defs"]
    for kind in (kind for kind in Table.__subclasses__() if kind.__name__ in tables):
        name, texts = kind.__name__, descriptions(kind)
        tables[name]["description"] = (inspect.getdoc(kind) or "").partition("\n")[0]
        for key, schema in tables[name]["properties"].items():
            schema["description"] = texts[key]
    history = tables["HistoryOptions"]["properties"]
    for key in ("rows", "cycle_rows"):
        text = history[key].pop("description")
        history[key] = {"anyOf": [history[key], {"$ref": "#/$defs/File"}], "description": text}
    file = {"type": "object", "properties": {"file": {"type": "string"}}}
    tables["File"] = {**file, "required": ["file"], "additionalProperties": False}
    del tables["Material"]["properties"]["name"]
    named = {"$ref": "#/$defs/Material"}
    tables["DefaultMaterial"] = {**tables["Material"], "additionalProperties": named}
    keys: dict[str, Any] = {}
    for field in dataclasses.fields(Scene):
        table, schema = TABLE_OF.get(field.name, field.name), whole["properties"][field.name]
        if field.name == "material":
            schema = {"$ref": "#/$defs/DefaultMaterial"}
        elif field.name == "body" or (field.name in TABLE_OF and table not in keys):
            one = schema.get("items", {"$ref": schema.get("$ref")})
            # in place of anyOf, of which editors only say that no alternative fits
            described = tables[one["$ref"].rpartition("/")[2]]
            schema = {**described, "type": ["object", "array"], "items": one}
        keys.setdefault(table, schema)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene of receding_fenicsx",
        "type": "object",
        "properties": keys,
        "additionalProperties": False,
        "$defs": tables,
    }


def _cleaned(schema: Any) -> Any:
    """Return Pydantic's schema as scene files need it: TOML has no null, profiles may be files."""
    if isinstance(schema, list):
        return [_cleaned(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    # titles are those of Pydantic, bounds those in which all products are finite
    without = ("default", None), ("maximum", LARGEST), ("minimum", -LARGEST)
    found = {
        key: _cleaned(item)
        for key, item in schema.items()
        if not (key == "title" and isinstance(item, str)) and (key, item) not in without
    }
    if found.get("minimum") == SMALLEST:
        found["exclusiveMinimum"] = 0
        del found["minimum"]
    if "anyOf" in found or "oneOf" in found:
        either = found.pop("anyOf", None) or found.pop("oneOf")
        options = [item for item in either if item != {"type": "null"}]
        if any(item.get("propertyNames", {}).get("enum") == ["x", "value"] for item in options):
            options.append({"$ref": "#/$defs/File"})
        found |= options[0] if len(options) == 1 else {"anyOf": options}
    return found
