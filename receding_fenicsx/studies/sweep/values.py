"""Values of a sweep on the command line: ``contact.friction=0.1:0.9:9``."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.toml_file import parse_value
from receding_fenicsx.scene.toml_reader import parse_toml

RANGE = re.compile(r"\s*([^:\s]+)\s*:\s*([^:\s]+)\s*:\s*([^:\s]+)\s*")
"""First value, last value, number of values."""
MAX_VALUES = 100_000
"""Largest number of values in a range."""


def read_over(texts: list[str]) -> dict[str, list[Any]]:
    """Read the arguments ``--over KEY=VALUES``.

    Args:
        texts: each "table.key=values". Values are separated by commas; each is TOML, a text
            without quotes, or a range "first:last:number" of evenly spaced values.

    Returns:
        The values of each key.

    Raises:
        InputError: a text has no key or no values, a key occurs twice, or a range is not one.
    """
    over: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = (part.strip() for part in text.partition("="))
        where = f"--over {text}"
        if not (key and equals and values):
            raise InputError(
                f"{where}: write table.key=values, for example contact.friction=0.1:0.9:9 or "
                "history.minimum=0,0.25,0.5"
            )
        if key in over:
            raise InputError(f"{where}: {key} occurs twice; give all its values at once")
        over[key] = _values(values, where)
    return over


def _values(text: str, where: str) -> list[Any]:
    """Return the values of one key."""
    parts = text.split(",")
    if not any(RANGE.fullmatch(part) for part in parts):
        try:
            return list(parse_toml(f"values = [{text}]")["values"])
        except InputError:
            pass
    found: list[Any] = []
    for part in parts:
        if not part.strip():
            raise InputError(f"{where}: a value is missing between commas")
        match = RANGE.fullmatch(part)
        found += _range(match, where) if match else [parse_value(part, where)]
    return found


def _range(match: re.Match[str], where: str) -> list[float] | list[int]:
    """Return evenly spaced values; whole numbers where both ends and all values are such."""
    first, last, number = match.groups()
    wrong = InputError(
        f"{where}: a range is first:last:number, two numbers and a count of 2 to {MAX_VALUES}"
    )
    try:
        a, b, n = float(first), float(last), int(number)
    except ValueError:
        raise wrong from None
    if not (math.isfinite(a) and math.isfinite(b) and 2 <= n <= MAX_VALUES):
        raise wrong
    values = np.linspace(a, b, n)
    whole = all(re.fullmatch(r"[+-]?\d+", end) for end in (first, last))
    if whole and np.all(values == np.round(values)):
        return [int(value) for value in values]
    return [float(value) for value in values]
