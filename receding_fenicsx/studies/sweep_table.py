"""Table of a sweep: a row for each case."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import aligned, shortened
from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.tables import optional
from receding_fenicsx.scene.checks import suggestion

if TYPE_CHECKING:
    import pandas as pd

Label = float | int | str | bool
"""A value of a key as the table shows it."""
ERROR = "error"
"""Column of the reasons why cases failed."""


@dataclass(frozen=True, repr=False)
class SweepTable:
    """Table of a sweep; ``table["dissipation_last_cycle"]`` is a column.

    Attributes:
        keys: the keys of the sweep, the first columns.
        labels: the values of each key.
        rows: one dictionary for each case, the last key varying fastest: keys, measured numbers
            (none where the case failed), and "error", the reason why it failed, or "".
    """

    keys: tuple[str, ...]
    labels: tuple[tuple[Any, ...], ...]
    rows: tuple[dict[str, Any], ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns: keys, measured numbers, "error"."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        return (*(name for name in names if name != ERROR), ERROR)

    @property
    def failed(self) -> tuple[dict[str, Any], ...]:
        """Rows of the cases that failed."""
        return tuple(row for row in self.rows if row[ERROR])

    def __len__(self) -> int:
        """Return the number of rows, one for each case."""
        return len(self.rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Go through the rows."""
        return iter(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; missing numbers are NaN, missing texts None."""
        if name not in self.columns:
            raise InputError(
                f"sweep: no column is named '{name}'; {suggestion(name, self.columns)}"
            )
        values = [row.get(name) for row in self.rows]
        given = [value for value in values if value is not None]
        if given and all(isinstance(v, int | float) and not isinstance(v, bool) for v in given):
            return np.array([math.nan if value is None else value for value in values])
        return np.array(values, dtype=object)

    def grid(self, name: str) -> NDArray[Any]:
        """Return a column with one axis for each key, in the order of ``keys``."""
        return self[name].reshape([len(values) for values in self.labels])

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame; needs pandas."""
        return optional("pandas").DataFrame({name: self[name] for name in self.columns})

    def write_csv(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the table as a CSV file; numbers keep all their digits."""
        names = self.columns
        with (
            new_file(Path(path), overwrite) as beside,
            beside.open("w", encoding="utf-8", newline="") as file,
        ):
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(names)
            writer.writerows([row.get(name) for name in names] for row in self.rows)

    def __repr__(self) -> str:
        """Return the number of cases, and the first rows with the most important columns."""
        filled = {name for row in self.rows for name, cell in row.items() if cell is not None}
        measured = [name for name in self.columns[len(self.keys) : -1] if name in filled]
        first = ("steady", "steady_cycle", "dissipation_last_cycle", "stick_half_width_at_minimum")
        headlines = (*first, "p_max_at_maximum", "residual_max")
        names = [name for name in headlines if name in measured] or measured[:5]
        names = [*self.keys, *names, *([ERROR] if self.failed else [])]
        most = 20
        rows = [names, *([_shown(r.get(name)) for name in names] for r in self.rows[:most])]
        lines = aligned(rows)
        if len(self.rows) > most:
            lines.append(f"... {len(self.rows) - most} more rows")
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return "\n".join([*lines, f"{len(self.rows)} cases{failed}"])


def _shown(value: Any) -> str:
    """Return a cell as text, at most 40 characters."""
    if value is None:
        return "-"
    return shortened(f"{value:.6g}" if isinstance(value, float) else str(value), 40)
