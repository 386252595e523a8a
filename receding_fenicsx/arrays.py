"""Array types of the package, and short descriptions of arrays, dataclasses and tables."""

from __future__ import annotations

import dataclasses
import reprlib
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError

Array = NDArray[np.float64]
"""Real numbers."""
Ints = NDArray[np.int64]
"""Whole numbers: nodes, cells, cycles."""


def brief(value: Any) -> str:
    """Return a value in a few words: an array by its shape and range.

    >>> brief(np.linspace(0.0, 2.0, 161))
    '(161,) from 0 to 2'
    >>> brief(np.full(4, 0.35))
    '(4,) of 0.35'
    """
    if isinstance(value, float):
        return f"{value:.6g}"
    if not isinstance(value, np.ndarray):
        short = reprlib.Repr()  # cuts long ones in their middle
        short.maxstring = short.maxother = 60
        return short.repr(value)
    if not value.size or value.ndim > 1:
        return str(value.shape)
    if value.dtype == bool:
        return f"{np.count_nonzero(value)} of {value.size}"
    low, high = value.min(), value.max()
    ends = f"of {low:.6g}" if low == high else f"from {low:.6g} to {high:.6g}"
    return f"{value.shape} {ends}"


def check_types(where: str, **arguments: tuple[Any, ...]) -> None:
    """Raise InputError for an argument of none of its types, given as NAME=(value, type, ...).

    >>> check_types("evolve", until=(3, str, None))
    Traceback (most recent call last):
    ...
    receding_fenicsx.errors.InputError: evolve: until has to be of type str or None, not int
    """
    for name, (value, *types) in arguments.items():
        if not any(value is None if kind is None else isinstance(value, kind) for kind in types):
            wanted = " or ".join("None" if kind is None else kind.__name__ for kind in types)
            raise InputError(
                f"{where}: {name} has to be of type {wanted}, not {type(value).__name__}"
            )


def as_numbers(value: Any, where: str) -> Array:
    """Return an array of numbers; raise InputError for what is none."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{where}: has to be numbers, not {brief(value)}") from None


def shortened(text: str, most: int = 60) -> str:
    """Return a text, cut to a number of characters if it is longer."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def over_largest(values: Array, of: Array) -> Array:
    """Return columns over the largest absolute value of each column of an array, or over 1."""
    largest = np.abs(of).max(axis=0, initial=0.0)
    return np.asarray(values / np.where(largest > 0.0, largest, 1.0))


def spread(rows: Ints, most: int) -> Ints:
    """Return at most a number of rows, evenly spread from the first to the last."""
    return rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(int)]


def described(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a title and rows of names and texts, of at most 30 lines of 100 characters.

    >>> described("Loads", [("P", "0 to 1"), ("shear", "-1 to 1")]).splitlines()
    ['Loads', '  P      0 to 1', '  shear  -1 to 1']
    >>> described("Loads", [("q", "1")] * 40).splitlines()[28:]
    ['  q  1', '  ... 12 more lines']
    """
    named = list(rows)
    width = max((len(name) for name, _ in named), default=0)
    lines = [shortened(title, 100)]
    for name, text in named:
        first, *more = textwrap.wrap(text, 96 - width) or [""]
        lines += [f"  {name:{width}}  {first}", *(f"  {'':{width}}  {line}" for line in more)]
    if len(lines) > 30:
        lines = [*lines[:29], f"  ... {len(lines) - 29} more lines"]
    return "\n".join(lines)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table whose columns are as wide as their longest cell."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def call_of(item: Any, without: Iterable[str] = ()) -> str:
    """Return a dataclass as a call with its values in a few words; empty ones are left out."""
    names = (field.name for field in dataclasses.fields(item) if field.name not in without)
    values = ((name, getattr(item, name)) for name in names)
    given = (f"{name}={brief(value)}" for name, value in values if value not in (None, "", (), {}))
    return f"{type(item).__name__}({', '.join(given)})"
