"""``record.h5`` and the condensed system's file: HDF5 that mirrors the dataclasses."""

from __future__ import annotations

import dataclasses
import typing
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from receding_fenicsx.atomic import new_hdf5
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.prepare import system_for
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Cycles, Events, States, Steady
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.identity import body_difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import from_toml

FORMAT_VERSION = 1
RECORD = "receding_fenicsx record"
SYSTEM = "receding_fenicsx contact system"

NODE_FIELDS = ("x", "points", "f", "g0", "weight", "edge")
"""Arrays of a Record that stand in the group /nodes."""
GROUPS: dict[str, type] = {
    "turning_points": States,
    "samples": States,
    "events": Events,
    "cycles": Cycles,
    "steady": Steady,
}
"""Tables of a Record, each in a group of its own."""

COMPRESS_FROM = 4096
"""Arrays of at least this many values are compressed (without loss)."""


def write_record(path: Path, record: Record, overwrite: bool = False) -> None:
    """Write ``record.h5``.

    Args:
        path: the file.
        record: what to write.
        overwrite: replace a file that is there already.

    Raises:
        InputError: the file is there already or cannot be written.
    """
    with _create(path, RECORD, overwrite) as file:
        nodes = file.create_group("nodes")
        for field in dataclasses.fields(record):
            value = getattr(record, field.name)
            if field.name in GROUPS:
                group = file.create_group(field.name)
                for inner in dataclasses.fields(value):
                    _write(group, inner.name, getattr(value, inner.name))
            else:
                _write(nodes if field.name in NODE_FIELDS else file, field.name, value)


def read_record(path: Path) -> Record:
    """Read ``record.h5``.

    Raises:
        InputError: there is no such file, it is no record, or it is damaged.
    """
    with _open(path, RECORD) as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(Record):
            if field.name in GROUPS:
                kind = GROUPS[field.name]
                group = _member(file, field.name)
                values[field.name] = kind(
                    **{f.name: _read(group, f.name) for f in dataclasses.fields(kind)}
                )
            else:
                place = _member(file, "nodes") if field.name in NODE_FIELDS else file
                values[field.name] = _read(place, field.name)
        for name in ("load_names", "edge_names"):
            values[name] = tuple(values[name])
        record = Record(**values)
        _check_lengths(record)
    return record


def write_system(path: Path, system: ContactSystem, overwrite: bool = False) -> None:
    """Write a condensed system with the text of its scene and the digest of what it depends on.

    Args:
        path: the file.
        system: what to write.
        overwrite: replace a file that is there already.

    Raises:
        InputError: the file is there already or cannot be written.
    """
    with _create(path, SYSTEM, overwrite) as file:
        values = {f.name: getattr(system, f.name) for f in dataclasses.fields(system)}
        values = {name: value for name, value in values.items() if value is not None}
        for name, value in values.items():
            _write(file, name, value)
        file.attrs["checksum"] = _checksum(values)
        file.attrs["digest"] = digest(from_toml(system.scene_toml)) if system.scene_toml else ""


def read_system(path: Path, scene: Scene | None = None) -> ContactSystem:
    """Read a condensed system.

    Args:
        path: the file.
        scene: the scene that it shall be used for; None takes it as it is.

    Returns:
        The system, with the scene's own friction and gap.

    Raises:
        InputError: there is no such file, it is damaged, or it was condensed from a scene whose
            body, material, mesh, contact edges, loads, supports or symmetry differ.
    """
    with _open(path, SYSTEM) as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(ContactSystem):
            optional = field.default is None
            if not optional or field.name in file or field.name in file.attrs:
                values[field.name] = _read(file, field.name)
        for name in ("load_names", "edge_names"):
            values[name] = tuple(values[name])
        system = ContactSystem(**values)
        n = len(system.x)
        size = n if system.kind == "normal" else 2 * n
        if system.K.shape != (size, size) or system.held.shape != (2 * n,):
            raise InputError(f"{path}: its arrays do not fit together; condense the scene again")
        stored, intact = _read(file, "digest"), _read(file, "checksum") == _checksum(values)
    if scene is not None:
        _check_scene(path, stored, system.scene_toml, scene)
    if not intact:
        raise InputError(f"{path}: is damaged; make it again")
    if scene is None:
        return system
    try:
        return system_for(scene, system)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _checksum(values: dict[str, Any]) -> int:
    """Return a checksum of a system's fields, from their names to their last bits.

    HDF5's own checksums cover the arrays' bytes, but not where it finds them.
    """
    crc = 0
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            crc = zlib.crc32(f"{name} {value.dtype.str} {value.shape}".encode(), crc)
            crc = zlib.crc32(np.ascontiguousarray(value).data, crc)
        else:
            plain = value.item() if isinstance(value, np.generic) else value
            crc = zlib.crc32(f"{name} {plain!r}".encode(), crc)
    return crc


def _check_scene(path: Path, stored: str, scene_toml: str, scene: Scene) -> None:
    """Refuse a system that was condensed from another scene."""
    if not scene_toml:
        raise InputError(f"{path}: was made by hand, for no scene; condense this scene")
    if stored == digest(scene):
        return
    found = None
    with suppress(InputError):  # its mesh file may be gone
        found = body_difference(from_toml(scene_toml), scene)
    raise InputError(
        f"{path}: was condensed from a scene with another {found or 'mesh file'}; condense this "
        "scene again"
    )


@contextmanager
def _create(path: Path, kind: str, overwrite: bool) -> Iterator[h5py.File]:
    with new_hdf5(path, overwrite) as file:
        file.attrs["format"] = kind
        file.attrs["format_version"] = FORMAT_VERSION
        yield file


@contextmanager
def _open(path: Path, kind: str) -> Iterator[h5py.File]:
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != kind:
                raise InputError(f"{path}: is no {kind}; give a file that this program wrote")
            version = int(file.attrs.get("format_version", -1))
            if version != FORMAT_VERSION:
                raise InputError(
                    f"{path}: has format version {version}, this program reads {FORMAT_VERSION}; "
                    "make it again"
                )
            yield file
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError):
        raise InputError(f"{path}: is damaged or no HDF5 file; make it again") from None


def _write(group: h5py.Group, name: str, value: Any) -> None:
    """Write arrays as datasets, everything else as an attribute."""
    if isinstance(value, np.ndarray):
        big = value.size >= COMPRESS_FROM
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if big else {}
        if value.size and value.ndim:
            options["fletcher32"] = True  # a number that was damaged is an error, not a number
        group.create_dataset(name, data=value, **options)
    elif isinstance(value, tuple):
        group.attrs.create(name, list(value), dtype=h5py.string_dtype(), shape=(len(value),))
    else:
        group.attrs[name] = value


def _read(group: h5py.Group, name: str) -> Any:
    """Read what :func:`_write` wrote, in Python's own types."""
    if name in group:
        return np.asarray(group[name][()])
    if name not in group.attrs:
        raise InputError(f"'{group.name.rstrip('/')}/{name}' is missing; make the file again")
    value = group.attrs[name]
    if isinstance(value, np.ndarray):
        return [v.decode() if isinstance(v, bytes) else str(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _member(file: h5py.File, name: str) -> h5py.Group:
    if not isinstance(file.get(name), h5py.Group):
        raise InputError(f"'/{name}' is missing; make the file again")
    return typing.cast(h5py.Group, file[name])


def _check_lengths(record: Record) -> None:
    """Refuse tables whose arrays do not fit together."""
    n, n_loads = len(record.x), len(record.load_names)
    for name in NODE_FIELDS:
        if len(getattr(record, name)) != n:
            raise InputError(f"'/nodes/{name}' has not {n} rows; make the file again")
    for name in ("turning_points", "samples"):
        table: States = getattr(record, name)
        rows = len(table.s)
        for field in dataclasses.fields(table):
            shape = getattr(table, field.name).shape
            per_load = field.name in ("load", "load_displacement")
            wanted = (rows,) if len(shape) < 2 else (rows, n_loads if per_load else n)
            if shape != wanted:
                raise InputError(f"'/{name}/{field.name}' has a wrong shape; make the file again")
