"""HDF5 files of records and of condensed systems; groups and names are those of the dataclasses."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from receding_fenicsx.atomic import new_file
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
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.interface.system import ContactSystem, ProbeMatrix
from receding_fenicsx.scene.identity import body_difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene

FORMAT_VERSION = 1
TITLE_BYTES = 512
"""Size of the title, HDF5's user block: kind, format version and digest of all that follows it."""


@contextmanager
def new_hdf5(path: str | Path, overwrite: bool = False, kind: str = "") -> Iterator[h5py.File]:
    """Yield an open HDF5 file of a kind; on leaving it is written as by :func:`new_file`.

    The file is filled in memory, because HDF5 crashes at the interpreter's exit on a full disk. One
    of kind "" is for other programs, without title.
    """
    about = {"format": kind, "format_version": FORMAT_VERSION} if kind else {}
    with new_file(path, overwrite) as temporary:
        # attributes above 64 kB (a scene with long tables) need the layout of HDF5 1.8
        layout = ("v108", "v110")
        # first HDF5 release whose file images in memory are used. Those of 1.10 have wrong
        # checksums; with a newer h5py, a file in a Python object crashes the garbage collector
        # after an error
        if h5py.version.hdf5_version_tuple < (1, 14, 0):
            memory = io.BytesIO()
            with h5py.File(memory, "w", libver=layout) as file:
                file.attrs.update(about)
                yield file
            image = memory.getvalue()
        else:
            with h5py.File(
                temporary, "w", driver="core", backing_store=False, libver=layout
            ) as file:
                file.attrs.update(about)
                yield file
                file.flush()
                image = file.id.get_file_image()
        with open(temporary, "wb") as plain:
            if kind:
                plain.write(_title(kind, hashlib.sha256(image).hexdigest()))
            plain.write(image)


def _title(kind: str, digest: str) -> bytes:
    """Return the title of a file of a kind."""
    return f"{kind} {FORMAT_VERSION}\nsha256 {digest}\n".encode().ljust(TITLE_BYTES, b"\0")


@contextmanager
def open_file(path: str | Path, kind: str) -> Iterator[h5py.File]:
    """Yield a file of :func:`new_hdf5`, of a kind and with the digest of its title, if it has one.

    InputError: the file does not exist, is of another kind or format version, or a bit of it has
    changed since it was written.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        with open(path, "rb") as plain:
            title = plain.read(TITLE_BYTES)
            # the program once wrote files without a title, but with HDF5's own checksums
            bare = title.startswith(b"\x89HDF")
            intact = bare or title == _title(kind, hashlib.file_digest(plain, "sha256").hexdigest())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    damaged = InputError(
        f"{path}: is damaged, was changed, or is not a {kind} of format version "
        f"{FORMAT_VERSION}; create it again"
    )
    if not intact:
        raise damaged
    try:
        with h5py.File(path, "r") as file:
            about = file.attrs.get("format"), file.attrs.get("format_version")
            if bare and about != (kind, FORMAT_VERSION):
                raise damaged
            yield file
    except OSError:
        raise damaged from None
    except KeyError as error:
        raise InputError(
            f"{path}: was written by another version of this program ({error}); create it again"
        ) from None


def write(group: h5py.Group, name: str, value: Any) -> None:
    """Write arrays as datasets, everything else as an attribute."""
    if isinstance(value, np.ndarray):
        # number of values from which an array is compressed (without loss)
        big = value.size >= 4096
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if big else {}
        group.create_dataset(name, data=value, **options)
    elif isinstance(value, tuple):
        group.attrs.create(name, list(value), dtype=h5py.string_dtype(), shape=(len(value),))
    else:
        group.attrs[name] = value


def read(group: h5py.Group, name: str) -> Any:
    """Read a value that :func:`write` wrote, as an array or a Python type."""
    if name in group:
        return np.asarray(group[name][()])
    value = group.attrs[name]
    if isinstance(value, np.ndarray):
        return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in value)
    return value.item() if isinstance(value, np.generic) else value


def _as_tuples(value: Any) -> Any:
    """Return a value from JSON with tuples for lists."""
    if isinstance(value, dict):
        return {key: _as_tuples(item) for key, item in value.items()}
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


NODE_FIELDS = (
    *("x", "points", "f", "g0", "weight", "edge"),
    *("f_backward", "held", "cohesion", "shear_limit"),
)
"""Arrays of a Record in the group /nodes; those of the second line where there are such: friction
of two directions, supports that hold nodes, other branches of the law."""
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


def write_record(path: str | Path, record: Record, overwrite: bool = False) -> None:
    """Write ``record.h5``; InputError where the file exists already or cannot be written."""
    with new_hdf5(path, overwrite, "receding_fenicsx record") as file:
        nodes = file.create_group("nodes")
        for field in dataclasses.fields(record):
            value = getattr(record, field.name)
            if value is None:
                continue
            if field.name == "choices":  # instants with several continuations
                file.attrs["choices"] = json.dumps([asdict(choice) for choice in value])
            elif field.name in GROUPS:
                group = file.create_group(field.name)
                for inner in dataclasses.fields(value):
                    write(group, inner.name, getattr(value, inner.name))
            else:
                write(nodes if field.name in NODE_FIELDS else file, field.name, value)


def read_record(path: str | Path) -> Record:
    """Read ``record.h5``; InputError where it does not exist, is not a record, or is damaged."""
    with open_file(path, "receding_fenicsx record") as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(Record):
            if field.name == "choices":
                stored = json.loads(file.attrs.get("choices", "[]"))
                values["choices"] = tuple(Choice(**_as_tuples(choice)) for choice in stored)
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
    return Record(**values)


def write_system(path: str | Path, system: ContactSystem, overwrite: bool = False) -> None:
    """Write a condensed system with its scene and the digest of the scene keys it depends on.

    InputError where the file exists already or cannot be written.
    """
    values = {f.name: getattr(system, f.name) for f in dataclasses.fields(system)}
    probes = values.pop("probes")
    if probes is not None:
        values |= {f"probes/{f.name}": getattr(probes, f.name) for f in dataclasses.fields(probes)}
    values = {name: value for name, value in values.items() if value is not None}
    with new_hdf5(path, overwrite, "receding_fenicsx contact system") as file:
        for name, value in values.items():
            write(file, name, value)
        file.attrs["description"] = inspect.getdoc(ContactSystem) or ""
        file.attrs["digest"] = digest(known_scene(system.scene_toml)) if system.scene_toml else ""


def read_system(path: str | Path, scene: Scene | None = None) -> ContactSystem:
    """Read a condensed system; with a scene, that it will be used for, with its friction and gap.

    InputError: the file does not exist, is damaged, or was condensed from a scene with another
    body, material, mesh, contact edge, load, support or symmetry.
    """
    with open_file(path, "receding_fenicsx contact system") as file:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(ContactSystem):
            optional = field.default is None
            stored = field.name in file or field.name in file.attrs
            if field.name != "probes" and (not optional or stored):
                values[field.name] = read(file, field.name)
        probes = None
        if "probes" in file:
            names, at, rows = (read(file, f"probes/{name}") for name in ("names", "points", "rows"))
            probes = ProbeMatrix(names, at, rows)
        system = ContactSystem(**values, probes=probes)
        condensed_from = file.attrs["digest"]
    if scene is None:
        return system
    if not system.scene_toml:
        raise InputError(f"{path}: was not condensed from a scene; condense this scene")
    if condensed_from != digest(scene):
        found, same = None, False
        with suppress(InputError):  # the mesh file of that scene may no longer exist
            known = known_scene(system.scene_toml)
            found = body_difference(known, scene)
            # digests of other versions of this program differ
            same = digest(known) == digest(scene) and not any(b.mesh for b in known.bodies)
        if not same:
            raise InputError(
                f"{path}: was condensed from a scene with another {found or 'mesh file'}; condense "
                "this scene again"
            )
    try:
        return system_for(scene, system)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
