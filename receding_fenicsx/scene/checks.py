"""Checks of single names and values, with one-line error messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import NoReturn

from receding_fenicsx.errors import InputError

LARGEST, SMALLEST = 1e50, 1e-50
"""Range of numbers in which products and quotients of up to six of them stay finite."""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a name, None if no one is similar."""
    return next(iter(difflib.get_close_matches(name, list(known), n=1)), None)


def suggestion(name: str, known: Sequence[str]) -> str:
    """Return "did you mean" with the nearest known name, or the list of known names."""
    close = nearest(name, known)
    return f"did you mean '{close}'?" if close else f"known are {', '.join(known)}"


def unknown_name(name: str, known: Sequence[str], where: str, what: str) -> NoReturn:
    """Raise InputError for an unknown name, with a suggestion."""
    hint = suggestion(name, known) if known else f"the scene has no {what}"
    raise InputError(f"{where}: unknown {what} '{name}'; {hint}")


def check_name(name: str, where: str) -> None:
    """Raise InputError for an empty name, and for one that messages of one line cannot hold."""
    if not name.strip():
        raise InputError(f"{where}: is missing or empty; give a name")
    if not name.isprintable():
        raise InputError(f"{where}: {name!r} holds a character that cannot be printed; remove it")


def check_size(value: float, where: str) -> None:
    """Raise InputError for a number so large that arithmetic with it may overflow."""
    if not abs(value) <= LARGEST:
        raise InputError(
            f"{where}: {value:g} is beyond {LARGEST:g}; choose units in which it is nearer to 1"
        )


def check_positive(value: float, where: str) -> None:
    """Raise InputError for a value that is not positive, or so small that it may underflow."""
    if not value > 0.0:
        raise InputError(f"{where}: must be positive, not {value:g}")
    if value < SMALLEST:
        raise InputError(
            f"{where}: {value:g} is below {SMALLEST:g}; choose units in which it is nearer to 1"
        )


def check_count(value: int, largest: int, where: str) -> None:
    """Raise InputError for a count outside 1 to ``largest``."""
    check_positive(value, where)
    if value > largest:
        raise InputError(f"{where}: must be at most {largest}, not {value}")


def check_choice(value: object, choices: tuple[str, ...], where: str) -> None:
    """Raise InputError for a value that is not one of the choices."""
    if value not in choices:
        raise InputError(f'{where}: "{value}" is unknown; use one of {", ".join(choices)}')
