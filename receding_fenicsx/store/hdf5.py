"""HDF5 files of records and of condensed systems; groups and names are those of the dataclasses."""

from __future__ import annotations

import dataclasses
import inspect
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.problem import system_for
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import (
    Cycles,
    Events,
    Limit,
    PathUniqueness,
    Probes,
    States,
    Steady,
)
from receding_fenicsx.interface.system import ContactSystem, ProbeMatrix
from receding_fenicsx.scene.identity import body_difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.store.choices import choices_of, text_of
from receding_fenicsx.store.hdf5_file import new_hdf5, open_file, read, write

RECORD = "receding_fenicsx record"
SYSTEM = "receding_fenicsx contact system"

NODE_FIELDS = ("x", "points", "f", "g0", "weight", "edge", "f_backward", "held")
"""Arrays of a Record in the group /nodes; ``f_backward`` where friction has two directions,
``held`` where supports hold nodes."""
GROUPS: dict[str, type] = {
    "turning_points": States,
    "samples": States,
    "events": Events,
    "cycles": Cycles,
    "steady": Steady,
    "probes": Probes,
    "limit": Limit,
    "uniqueness": PathUniqueness,
}
"""Tables of a Record; each has its own group. Records without probes, or
without a limit, have no group for them."""

CHOICES = "choices"
"""Instants with several continuations, as JSON in an attribute; a record without it has none."""


def write_record(path: Path, record: Record, overwrite: bool = False) -> None:
    """Write ``record.h5``.

    Args:
        path: the file.
        record: the record.
        overwrite: replace an existing file.

    Raises:
        InputError: the file exists already or cannot be written.
    """
    with new_hdf5(path, overwrite, RECORD) as file:
        nodes = file.create_group("nodes")
        for field in dataclasses.fields(record):
            value = getattr(record, field.name)
            if value is None:
                continue
            if field.name == CHOICES:
                file.attrs[CHOICES] = text_of(value)
            elif field.name in GROUPS:
                group = file.create_group(field.name)
                for inner in dataclasses.fields(value):
                    write(group, inner.name, getattr(value, inner.name))
            else:
                write(nodes if field.name in NODE_FIELDS else file, field.name, value)


def read_record(path: Path) -> Record:
    """Read ``record.h5``.

    Raises:
        InputError: the file does not exist, is not a record, or is damaged.
    """
    with open_file(path, RECORD) as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(Record):
            if field.name == CHOICES:
                values[CHOICES] = choices_of(file.attrs.get(CHOICES, "[]"))
            elif field.name in GROUPS:
                if field.default is None and field.name not in file:
                    continue
                kind, group = GROUPS[field.name], file[field.name]
                values[field.name] = kind(
                    **{f.name: read(group, f.name) for f in dataclasses.fields(kind)}
                )
            else:
                place = file["nodes"] if field.name in NODE_FIELDS else file
                if field.default is not None or field.name in place:
                    values[field.name] = read(place, field.name)
        for name in ("load_names", "edge_names"):
            values[name] = tuple(values[name])
        if "probes" in values:
            values["probes"].names = tuple(values["probes"].names)
    return Record(**values)


def write_system(path: Path, system: ContactSystem, overwrite: bool = False) -> None:
    """Write a condensed system with its scene and the digest of the scene keys it depends on.

    Args:
        path: the file.
        system: the condensed system.
        overwrite: replace an existing file.

    Raises:
        InputError: the file exists already or cannot be written.
    """
    values = _values_of(system)
    with new_hdf5(path, overwrite, SYSTEM) as file:
        for name, value in values.items():
            write(file, name, value)
        file.attrs["description"] = inspect.getdoc(ContactSystem) or ""
        file.attrs["digest"] = digest(known_scene(system.scene_toml)) if system.scene_toml else ""


def read_system(path: Path, scene: Scene | None = None) -> ContactSystem:
    """Read a condensed system.

    Args:
        path: the file.
        scene: scene that the system will be used for; None returns the system as stored.

    Returns:
        The system, with friction and initial gap of ``scene``.

    Raises:
        InputError: the file does not exist, is damaged, or was condensed from a scene with another
            body, material, mesh, contact edge, load, support or symmetry.
    """
    with open_file(path, SYSTEM) as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(ContactSystem):
            optional = field.default is None
            stored = field.name in file or field.name in file.attrs
            if field.name != "probes" and (not optional or stored):
                values[field.name] = read(file, field.name)
        for name in ("load_names", "edge_names"):
            values[name] = tuple(values[name])
        system = ContactSystem(**values, probes=_read_probes(file))
        condensed_from = file.attrs["digest"]
    if scene is not None:
        _check_scene(path, condensed_from, system.scene_toml, scene)
    if scene is None:
        return system
    try:
        return system_for(scene, system)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _values_of(system: ContactSystem) -> dict[str, Any]:
    """Return the fields of a system that are not None by their names in its file."""
    values = {f.name: getattr(system, f.name) for f in dataclasses.fields(system)}
    probes = values.pop("probes")
    if probes is not None:
        values |= {f"probes/{f.name}": getattr(probes, f.name) for f in dataclasses.fields(probes)}
    return {name: value for name, value in values.items() if value is not None}


def _read_probes(file: h5py.File) -> ProbeMatrix | None:
    """Read the probes of a system, None where it has none."""
    if "probes" not in file:
        return None
    names, points, rows = (read(file, f"probes/{name}") for name in ("names", "points", "rows"))
    return ProbeMatrix(tuple(names), points, rows)


def _check_scene(path: Path, stored: str, scene_toml: str, scene: Scene) -> None:
    """Raise InputError if a system was condensed from another scene."""
    if not scene_toml:
        raise InputError(f"{path}: was not condensed from a scene; condense this scene")
    if stored == digest(scene):
        return
    found = None
    with suppress(InputError):  # the mesh file of that scene may no longer exist
        found = body_difference(known_scene(scene_toml), scene)
    raise InputError(
        f"{path}: was condensed from a scene with another {found or 'mesh file'}; condense this "
        "scene again"
    )
