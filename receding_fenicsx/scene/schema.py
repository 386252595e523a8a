"""JSON Schema of scene files, by which editors complete and check them; texts of the keys."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import Any

from receding_fenicsx.scene.checks import LARGEST, SMALLEST, Table
from receding_fenicsx.scene.model import TABLE_OF, Scene
from receding_fenicsx.scene.toml_reader import type_adapter

FILE = {
    "type": "object",
    "properties": {"file": {"type": "string"}},
    "required": ["file"],
    "additionalProperties": False,
}
"""Schema of values that are read from a file of columns."""


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
        history[key] = {"anyOf": [history[key], FILE], "description": text}
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
            schema = {"anyOf": [one, {"type": "array", "items": one}]}
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
    """Return Pydantic's schema as scene files need it.

    TOML has no null, the range of all numbers says nothing, and profiles may come from files.
    """
    if isinstance(schema, list):
        return [_cleaned(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    found = {
        key: _cleaned(item)
        for key, item in schema.items()
        if key != "title" or not isinstance(item, str)
    }
    if found.get("default", 0) is None:
        del found["default"]
    if found.get("maximum") == LARGEST:
        del found["maximum"]
    if found.get("minimum") in (SMALLEST, -LARGEST):
        if found.pop("minimum") == SMALLEST:
            found["exclusiveMinimum"] = 0
    if "anyOf" in found:
        options = [item for item in found.pop("anyOf") if item != {"type": "null"}]
        if any(item.get("propertyNames", {}).get("enum") == ["x", "value"] for item in options):
            options.append(FILE)
        found |= options[0] if len(options) == 1 else {"anyOf": options}
    return found
