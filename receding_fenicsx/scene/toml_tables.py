"""Profiles from files: ``{file = "gap.csv"}`` becomes the table of its two columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError

PROFILES = ("friction", "initial_gap", "pressure", "traction", "displacement", "initial_slip")
"""Keys whose values may be read from files."""


def inline_files(raw: Any, folder: Path, where: str = "") -> Any:
    """Return a parsed scene in which every ``{file = "..."}`` is the table that the file holds.

    So a scene kept with its results stands by itself.

    Args:
        raw: parsed TOML, or a part of it.
        folder: folder that paths are relative to.
        where: keys down to the part, for messages.

    Raises:
        InputError: a file cannot be read, or is no table of two columns; one line.
    """
    if isinstance(raw, dict):
        if set(raw) == {"file"}:
            if where.split()[-1] in PROFILES:
                return _read(raw["file"], folder, where)
            if isinstance(raw["file"], str):
                raise InputError(
                    f"{where.strip()}: cannot be read from a file, only {', '.join(PROFILES)} can; "
                    "write its values into the scene"
                )
        return {key: inline_files(value, folder, f"{where} {key}") for key, value in raw.items()}
    if isinstance(raw, list):
        return [inline_files(item, folder, where) for item in raw]
    return raw


def _read(name: object, folder: Path, where: str) -> dict[str, list[float]]:
    """Read positions and values from two columns, parted by commas or blanks; # is a comment."""
    label = f"{where.strip()} file"
    if not isinstance(name, str):
        raise InputError(f"{label}: must be a path in quotes")
    try:
        text = (folder / name).read_text(encoding="utf-8-sig").replace(",", " ")
        cells = [line.partition("#")[0].split() for line in text.splitlines()]
        rows = [[float(cell) for cell in row] for row in cells if row]
    except FileNotFoundError:
        raise InputError(f'{label}: "{name}": no such file; check the path') from None
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InputError(
            f'{label}: "{name}": cannot be read as columns of numbers ({error}); give x and value '
            "on each line"
        ) from None
    if not rows or any(len(row) != 2 for row in rows):
        counts = sorted({len(row) for row in rows}) or [0]
        raise InputError(
            f'{label}: "{name}": has {", ".join(map(str, counts))} column(s); give x and value on '
            "each line"
        )
    return {"x": [row[0] for row in rows], "value": [row[1] for row in rows]}
