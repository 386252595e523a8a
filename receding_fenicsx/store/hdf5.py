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
from typing import Any, get_args, get_type_hints

import h5py
import numpy as np

from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.problem import system_for
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.identity import body_difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.scene.toml_reader import type_adapter


@contextmanager
def new_hdf5(path: str | Path, overwrite: bool = False, kind: str = "") -> Iterator[h5py.File]:
    """Yield an open HDF5 file of a kind, "" for other programs; it is written on leaving.

    It is filled in memory, because HDF5 crashes at the interpreter's exit on a full disk.
    """
    with new_file(path, overwrite) as temporary:
        # attributes above 64 kB (a scene with long tables) need the layout of HDF5 1.8
        layout = ("v108", "v110")
        # file images in memory: those of HDF5 1.10 have wrong checksums; with a newer h5py, a file
        # in a Python object crashes the garbage collector after an error
        old = h5py.version.hdf5_version_tuple < (1, 14, 0)
        memory, how = io.BytesIO(), {} if old else {"driver": "core", "backing_store": False}
        with h5py.File(memory if old else temporary, "w", libver=layout, **how) as file:
            file.attrs.update({"format": kind, "format_version": 1} if kind else {})
            yield file
            file.flush()
            image = b"" if old else file.id.get_file_image()
        image = memory.getvalue() if old else image
        with open(temporary, "wb") as plain:
            if kind:
                plain.write(_title(kind, hashlib.sha256(image).hexdigest()))
            plain.write(image)


def _title(kind: str, digest: str) -> bytes:
    """Return HDF5's user block: kind, format version 1 and digest of all that follows it."""
    return f"{kind} 1\nsha256 {digest}\n".encode().ljust(512, b"\0")


@contextmanager
def open_file(path: str | Path, kind: str) -> Iterator[h5py.File]:
    """Yield a file of :func:`new_hdf5`.

    InputError: it does not exist, is of another kind or format version, or a bit of it has changed.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        with open(path, "rb") as plain:
            title = plain.read(512)
            # files of the first version have no title, but HDF5's own checksums
            bare = title.startswith(b"\x89HDF")
            intact = bare or title == _title(kind, hashlib.file_digest(plain, "sha256").hexdigest())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    wrong = f"is damaged, was changed, or is not a {kind} of format version 1"
    damaged = InputError(f"{path}: {wrong}; create it again")
    if not intact:
        raise damaged
    try:
        with h5py.File(path, "r") as file:
            about = file.attrs.get("format"), file.attrs.get("format_version")
            if bare and about != (kind, 1):
                raise damaged
            yield file
    except OSError:
        raise damaged from None
    except KeyError as error:
        raise InputError(f"{path}: is of another version of this program ({error})") from None


def read(group: h5py.Group, name: str) -> Any:
    """Read a value that :func:`write_all` wrote, as an array or a Python type."""
    if name in group:
        return np.asarray(group[name][()])
    value = group.attrs[name]
    if isinstance(value, np.ndarray):
        return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in value)
    return value.item() if isinstance(value, np.generic) else value


def _place(group: h5py.Group, kind: type, name: str) -> h5py.Group:
    """Return the group of a value: /nodes for the arrays over the nodes of a Record."""
    of_nodes = "x points f g0 weight edge f_backward held cohesion shear_limit".split()
    return group["nodes"] if kind is Record and name in of_nodes else group


def write_all(group: h5py.Group, data: Any, prefix: str = "") -> None:
    """Write a dataclass: arrays as datasets, inner ones as groups, else attributes but for None."""
    if isinstance(data, Record):
        group.create_group("nodes")
    for field in dataclasses.fields(data):
        name, value = field.name, getattr(data, field.name)
        place, key = _place(group, type(data), name), prefix + name
        if name == "choices":  # instants with several continuations
            group.attrs[name] = json.dumps([asdict(choice) for choice in value])
        elif name == "probes" and isinstance(data, ContactSystem) and value is not None:
            write_all(group, value, "probes/")  # attributes too are those of the file
        elif dataclasses.is_dataclass(value):
            write_all(group.create_group(name), value)
        elif isinstance(value, np.ndarray):
            # large ones are compressed, without loss
            how = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
            place.create_dataset(key, data=value, **(how if value.size >= 4096 else {}))
        elif isinstance(value, tuple):
            place.attrs.create(key, list(value), dtype=h5py.string_dtype(), shape=(len(value),))
        elif value is not None:
            place.attrs[key] = value


def _read_all(group: h5py.Group, kind: Any, prefix: str = "") -> Any:
    """Read a dataclass that :func:`write_all` wrote."""
    values: dict[str, Any] = {}
    hints = get_type_hints(kind)
    for name, optional in ((f.name, f.default is None) for f in dataclasses.fields(kind)):
        place = _place(group, kind, name)
        types = (t for t in (hints[name], *get_args(hints[name])) if isinstance(t, type))
        inner = next((t for t in types if dataclasses.is_dataclass(t)), None)
        if name == "choices":
            stored = group.attrs.get(name, "[]")
            values[name] = type_adapter(tuple[Choice, ...]).validate_json(stored)
        elif optional and name not in place and name not in place.attrs:
            continue
        elif inner is None:
            values[name] = read(place, prefix + name)
        elif kind is ContactSystem:
            values[name] = _read_all(group, inner, f"{name}/")
        else:
            values[name] = _read_all(place[name], inner)
    return kind(**values)


def write_record(path: str | Path, record: Record, overwrite: bool = False) -> None:
    """Write ``record.h5``; InputError where the file exists already or cannot be written."""
    with new_hdf5(path, overwrite, "receding_fenicsx record") as file:
        write_all(file, record)


def read_record(path: str | Path) -> Record:
    """Read ``record.h5``; InputError where it does not exist, is not a record, or is damaged."""
    with open_file(path, "receding_fenicsx record") as file:
        record: Record = _read_all(file, Record)
        return record


def write_system(path: str | Path, system: ContactSystem, overwrite: bool = False) -> None:
    """Write a condensed system with its scene and the digest of the scene keys it depends on.

    InputError where the file exists already or cannot be written.
    """
    with new_hdf5(path, overwrite, "receding_fenicsx contact system") as file:
        write_all(file, system)
        file.attrs["description"] = inspect.getdoc(ContactSystem) or ""
        file.attrs["digest"] = digest(known_scene(system.scene_toml)) if system.scene_toml else ""


def read_system(path: str | Path, scene: Scene | None = None) -> ContactSystem:
    """Read a condensed system; with a scene, that it will be used for, with its friction and gap.

    InputError: the file does not exist, is damaged, or was condensed from a scene with another
    body, material, mesh, contact edge, load, support or symmetry.
    """
    with open_file(path, "receding_fenicsx contact system") as file:
        system: ContactSystem = _read_all(file, ContactSystem)
        condensed_from = file.attrs["digest"]
    if scene is None:
        return system
    if not system.scene_toml:
        raise InputError(f"{path}: was not condensed from a scene; condense this scene")
    if condensed_from != digest(scene):
        found = "mesh file"
        with suppress(InputError):  # the mesh file of that scene may no longer exist
            known = known_scene(system.scene_toml)
            # digests of other versions of this program differ
            meshed = "mesh file" if any(body.mesh for body in known.bodies) else ""
            found = body_difference(known, scene) or meshed
        if found:
            raise InputError(f"{path}: was condensed from a scene with another {found}; renew it")
    try:
        return system_for(scene, system)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
