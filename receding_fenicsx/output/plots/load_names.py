"""Names of loads in labels: a symbol as mathematics, a word as text."""

from __future__ import annotations

import re

MAX_NAME_LENGTH = 10
"""Largest number of letters of a load's name in a label."""
IN_MATHEMATICS = {
    **{letter: f"\\{letter}" for letter in "_%${} "},
    "\\": r"\backslash ",
    "^": r"\wedge ",
    "~": r"\sim ",
    "#": r"\sharp ",
    '"': "''",
    "`": "'",
}
"""Replacements of letters of a name that are commands in Matplotlib's mathematics."""


def is_word(name: str) -> bool:
    """Return whether a load's name is a word, not a symbol."""
    return load_symbol(name).startswith(r"\mathrm")


def shown_name(name: str) -> str:
    """Return a load's name as text; the middle of a long name is left out."""
    return _shortened(name).replace("$", r"\$")


def _shortened(name: str) -> str:
    return name if len(name) <= MAX_NAME_LENGTH else f"{name[:5]}…{name[-4:]}"


def load_symbol(name: str) -> str:
    """Write a load's name as mathematics: "p0" as a letter with an index, a word as a word."""
    found = re.fullmatch(r"([A-Za-z])_?([A-Za-z0-9]*)", name)
    if found and (len(found[2]) == 0 or found[2].isdigit()):
        return found[1] + (f"_{{{found[2]}}}" if found[2] else "")
    word = "".join(IN_MATHEMATICS.get(letter, letter) for letter in _shortened(name))
    return rf"\mathrm{{{word}}}"


def load_text(name: str) -> str:
    """Return a load's name as a text: a symbol as mathematics, a word as it is."""
    return shown_name(name) if is_word(name) else f"${load_symbol(name)}$"


def peak(symbol: str) -> str:
    """Return the symbol of the largest value of a load."""
    return rf"{symbol}^{{\,\mathrm{{max}}}}"
