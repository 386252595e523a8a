"""JSON Schema of scene files, and the tables of keys in the documents."""

import dataclasses
import datetime as dt
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import key_tables
import pytest

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.scene.toml_file import from_raw
from receding_fenicsx.scene.toml_reader import descriptions, parse_toml, scene_schema

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[2]


def parts(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield a schema and all schemas in it."""
    if isinstance(schema, dict):
        yield schema
    for part in schema.values() if isinstance(schema, dict) else schema:
        if isinstance(part, dict | list):
            yield from parts(part)


@pytest.mark.parametrize("table", key_tables.KINDS)
def test_schema_describes_every_key_by_the_text_of_its_docstring(table: str) -> None:
    schema, kind = scene_schema(), key_tables.KINDS[table]
    assert table in schema["properties"]
    properties = schema["$defs"][kind.__name__]["properties"]
    keys = {field.name for field in dataclasses.fields(kind)}
    assert set(descriptions(kind)) == keys
    assert set(properties) == keys - ({"name"} if kind is rf.Material else set())
    for key, part in properties.items():
        assert part["description"] == descriptions(kind)[key]


def test_schema_has_the_ranges_and_choices_and_nothing_that_toml_has_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema == scene_schema()
    material, mesh = (schema["$defs"][name]["properties"] for name in ("Material", "MeshOptions"))
    assert material["young"]["exclusiveMinimum"] == 0 and "maximum" not in material["young"]
    assert "axisymmetric" in material["kinematics"]["enum"]
    assert (mesh["contact_elements"]["minimum"], mesh["degree"]["maximum"]) == (4, 2)
    assert schema["$defs"]["Load"]["required"] == ["name"]
    assert not any(
        part.get("type") == "null" or part.get("maximum") == 1e50 for part in parts(schema)
    )
    references = {part["$ref"].split("/")[-1] for part in parts(schema) if "$ref" in part}
    assert references <= set(schema["$defs"])


ODD = [True, 10**400, math.nan, "", "x", [], [1], [1, 2, 3], ["x", 1.0], [{}], [[1.0], [True]]]
ODD += [{}, {"x": [0]}, {"forward": [1]}, {"a": {"mean": "b"}}, dt.date(2020, 1, 1)]


@pytest.mark.parametrize("table", key_tables.KINDS)
def test_any_value_of_any_key_is_taken_or_refused_in_plain_words(table: str) -> None:
    for key in descriptions(key_tables.KINDS[table]):
        for value in ODD:
            raw = parse_toml((ROOT / "demos" / "block.toml").read_text())
            given = raw.get(table, {})
            given = given[0] if isinstance(given, list) else given
            raw[table] = {**given, key: value}
            try:
                from_raw(raw)
            except rf.InputError as error:
                for line in str(error).splitlines():
                    assert not re.search("Input should|Value error|NoneType", line), line
                    assert line.startswith(("[", f"{table} '", "load '", "scene:")), line
