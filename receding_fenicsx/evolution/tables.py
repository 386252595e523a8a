"""Labelled tables of a record, for pandas, xarray or a CSV file."""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError

if TYPE_CHECKING:
    import xarray

    from receding_fenicsx.evolution.record_data import RecordData

Columns = dict[str, NDArray[Any]]


def columns(record: RecordData, which: str) -> Columns:
    """Return a table as columns of equal length; see :meth:`Record.to_table`."""
    per_row, per_node, per_load = _parts(record, which)
    per_row |= _by_name(record, per_load)
    if which == "events":
        return per_row
    rows, n = len(next(iter(per_row.values()))), len(record.x)
    found = {name: np.repeat(values, n) for name, values in per_row.items()}
    found["node"] = np.tile(np.arange(n), rows)
    found["x"] = np.tile(record.x, rows)
    return found | {name: values.reshape(-1) for name, values in per_node.items()}


def dataset(record: RecordData, which: str) -> xarray.Dataset:
    """Return a table for xarray; see :meth:`Record.to_xarray`."""
    if which == "events":
        raise InputError("events: are a plain table; use to_table or to_pandas")
    per_row, per_node, per_load = _parts(record, which)
    row = "cycle" if which == "cycles" else "instant"
    by_name = _by_name(record, per_load)
    selected_by = {name: a for name, a in by_name.items() if name.startswith("load.")}
    selected_by |= {name: per_row[name] for name in ("cycle", "leg", "s") if name in per_row}
    singles = {k: a for k, a in (per_row | by_name).items() if k not in selected_by}
    variables: dict[str, Any] = {name: (row, a) for name, a in singles.items()}
    variables |= {name: ((row, "node"), a) for name, a in per_node.items()}
    # "load" names the dimension, so the factors need another name
    renamed = {"load": "load_factor"}
    variables |= {renamed.get(name, name): ((row, "load"), a) for name, a in per_load.items()}
    coordinates: dict[str, Any] = {
        "x": ("node", record.x),
        "f": ("node", record.f),
        "weight": ("node", record.weight),
        "load": ("load", list(record.load_names)),
    }
    for name in ("f_backward", "cohesion", "shear_limit"):
        if (values := getattr(record, name)) is not None:
            coordinates[name] = ("node", values)
    if len(record.edge_names) > 1:
        coordinates["edge"] = ("node", np.array(record.edge_names)[record.edge])
    coordinates |= {name: (row, a) for name, a in selected_by.items()}
    found = optional("xarray").Dataset(variables, coordinates)
    for name in ("x", *(["edge"] if "edge" in coordinates else []), *selected_by):
        if name not in found.indexes:
            found = found.set_xindex(name)
    return found


def _by_name(record: RecordData, per_load: Columns) -> Columns:
    """Return a column for each load, "load.NAME": no other column has a dot in its name."""
    return {
        f"{quantity}.{name}": values[:, k]
        for quantity, values in per_load.items()
        for k, name in enumerate(record.load_names)
    }


def _parts(record: RecordData, which: str) -> tuple[Columns, Columns, Columns]:
    """Split a table's arrays into those of one value a row, of N, and of one a load."""
    tables = ("turning_points", "samples", "cycles", "events")
    if which not in tables:
        raise InputError(f"table '{which}': is unknown; use one of {', '.join(tables)}")
    table = getattr(record, which)
    per_row: Columns = {}
    if which == "cycles":
        per_row["cycle"] = np.arange(1, len(table.dissipation) + 1)
    per_node: Columns = {}
    per_load: Columns = {}
    for field in fields(table):
        values = getattr(table, field.name)
        if values.ndim == 1:
            per_row[field.name] = values
        elif field.name in ("load", "load_displacement"):
            per_load[field.name] = values
        else:
            per_node[field.name] = values
    return per_row, per_node, per_load


def optional(name: str) -> ModuleType:
    """Import pandas or xarray."""
    try:
        return import_module(name)
    except ModuleNotFoundError:
        # another major version of NumPy would break Debian's DOLFINx
        numpy = f'"numpy<{int(np.__version__.partition(".")[0]) + 1}"'
        raise InputError(
            f"{name} is not installed; pip install {numpy} {name}, or use to_table"
        ) from None
