"""Readers of single TOML values: each checks the type and returns the value."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tomllib
from collections.abc import Callable
from typing import Any

from receding_fenicsx.arrays import shortened
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import unknown_name
from receding_fenicsx.scene.model import Harmonic, Refinement
from receding_fenicsx.scene.profiles import DIRECTIONS, FrictionProfile, Profile, directions

PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
DEEP_KEY = re.compile(rf"""(?<![\w"'\\-])(?:{PART}[ \t]*+\.[ \t]*+){{50}}""")
"""A dotted key of more than 50 parts: the parser's memory grows with the square of their number."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises:
        InputError: it is not valid TOML, or has a key of more than 50 parts.
    """
    if DEEP_KEY.search(text):
        raise InputError("not valid TOML: a key has more than 50 parts")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # whole numbers of too many digits included
        reason = str(error).partition("; use sys")[0].replace("\n", " ")
        raise InputError(f"not valid TOML: {reason}") from None


def _shown(value: object) -> str:
    """Return a value as written in the file, at most 60 characters."""
    text = json.dumps(value) if isinstance(value, bool | str) else str(value)
    return shortened(text)


def read_string(value: object, where: str) -> str:
    """Return a value that must be a string."""
    if not isinstance(value, str):
        raise InputError(f"{where}: must be a string in quotes, not {_shown(value)}")
    if "\0" in value:
        raise InputError(f"{where}: {_shown(value)} holds a NUL character; remove it")
    return value


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: must be a number, not {_shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{where}: must be a finite number, not {_shown(value)}")
    return number


def _integer(value: object, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{where}: must be a whole number, not {_shown(value)}")
    return value


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{where}: must be true or false, not {_shown(value)}")
    return value


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{where}: must be a list in brackets, not {_shown(value)}")
    return value


def _numbers(value: object, where: str) -> tuple[float, ...]:
    return tuple(_number(item, where) for item in _list(value, where))


def _pair(value: object, where: str) -> tuple[float, float]:
    numbers = _numbers(value, where)
    if len(numbers) != 2:
        raise InputError(f"{where}: must be two numbers [a, b], not {_shown(value)}")
    return numbers[0], numbers[1]


def _point(value: object, where: str) -> tuple[float, float] | str:
    return value if isinstance(value, str) else _pair(value, where)


def _rows(value: object, where: str) -> tuple[tuple[float, ...], ...]:
    return tuple(_numbers(row, f"{where} row {i + 1}") for i, row in enumerate(_list(value, where)))


def read_names(value: object, where: str) -> tuple[str, ...]:
    """Return a value that must be a list of strings."""
    return tuple(read_string(item, where) for item in _list(value, where))


def _name_or_integer(value: object, where: str) -> str | int:
    return value if isinstance(value, str) else _integer(value, where)


def _profile(value: object, where: str) -> Profile:
    if isinstance(value, str):
        return value
    if not isinstance(value, dict):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(
                f"{where}: must be a number, an expression in quotes or a table "
                f"{{x = [...], value = [...]}}, not {_shown(value)}"
            )
        return _number(value, where)
    for key in value:
        if key not in ("x", "value"):
            unknown_name(key, ("x", "value"), where, "key")
    if set(value) != {"x", "value"}:
        raise InputError(f"{where}: a table needs both lists, {{x = [...], value = [...]}}")
    return {key: list(_numbers(value[key], f"{where}.{key}")) for key in ("x", "value")}


def _friction(value: object, where: str) -> FrictionProfile:
    if not isinstance(value, dict) or not set(value) & set(DIRECTIONS):
        return _profile(value, where)
    for key in value:
        if key not in DIRECTIONS:
            unknown_name(key, DIRECTIONS, where, "key")
    found = {key: _profile(value[key], f"{where} {key}") for key in value}
    directions(found, where)
    return found


def _parameters(value: object, where: str) -> dict[str, float]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: must be a table {{name = number}}, not {_shown(value)}")
    return {name: _number(item, f"{where}.{name}") for name, item in value.items()}


def _vertices(value: object, where: str) -> tuple[dict[str, float], ...]:
    tables = enumerate(_list(value, where))
    return tuple(_parameters(table, f"{where} {i + 1}") for i, table in tables)


def _harmonic(value: object, where: str) -> dict[str, Harmonic]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: must hold a table for each load, not {_shown(value)}")
    known = tuple(field.name for field in dataclasses.fields(Harmonic))
    found = {}
    for name, table in value.items():
        if not isinstance(table, dict):
            raise InputError(
                f"{where}.{name}: must be a table {{mean = ..., amplitude = ..., phase = ...}}, "
                f"not {_shown(table)}"
            )
        for key in table:
            if key not in known:
                unknown_name(key, known, f"{where}.{name}", "key")
        numbers = {key: _number(item, f"{where}.{name} {key}") for key, item in table.items()}
        found[name] = Harmonic(**numbers)
    return found


def _place(value: object, where: str) -> float | tuple[float, float] | str:
    if isinstance(value, str | list):
        return _point(value, where)
    return _number(value, where)


def _refinements(value: object, where: str) -> tuple[Refinement, ...]:
    readers = {"size": _number, "at": _place, "growth": _number, "edge": read_string}
    found = []
    for i, table in enumerate(_list(value, where)):
        label = f"{where} number {i + 1}"
        if not isinstance(table, dict) or "size" not in table:
            raise InputError(f"{label}: must be a table {{at = ..., size = ...}}")
        for key in table:
            if key not in readers:
                unknown_name(key, tuple(readers), label, "key")
        values: dict[str, Any] = {k: readers[k](v, f"{label} {k}") for k, v in table.items()}
        found.append(Refinement(**values))
    return tuple(found)


def _traction(value: object, where: str) -> tuple[Profile, Profile]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where}: must be a pair [x, y] in global axes, not {_shown(value)}")
    return _profile(value[0], f"{where}[0]"), _profile(value[1], f"{where}[1]")


def _sampled_cycles(value: object, where: str) -> tuple[int, ...] | str:
    if value == "all":
        return "all"
    if not isinstance(value, list):
        raise InputError(f'{where}: must be "all" or a list of cycles, not {_shown(value)}')
    return tuple(_integer(item, where) for item in value)


BY_TYPE: dict[str, Callable[[object, str], Any]] = {
    "str": read_string,
    "str | None": read_string,
    "float": _number,
    "float | None": _number,
    "int": _integer,
    "int | None": _integer,
    "str | int": _name_or_integer,
    "bool": _boolean,
    "bool | None": _boolean,
    "Profile": _profile,
    "FrictionProfile": _friction,
    "Profile | None": _profile,
    "tuple[float, ...]": _numbers,
    "tuple[float, float]": _pair,
    "tuple[float, float] | None": _pair,
    "tuple[float, float] | str | None": _point,
    "dict[str, float]": _parameters,
    "tuple[dict[str, float], ...]": _vertices,
    "dict[str, Harmonic]": _harmonic,
    "tuple[Profile, Profile] | None": _traction,
    "tuple[Refinement, ...]": _refinements,
    "tuple[str, ...]": read_names,
    "tuple[tuple[float, ...], ...]": _rows,
    "tuple[int, ...] | str | None": _sampled_cycles,
}
"""Reader of each field type of the scene's dataclasses."""
