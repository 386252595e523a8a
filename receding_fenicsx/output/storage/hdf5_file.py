"""HDF5 files of a kind and a format version; values as datasets or attributes."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from receding_fenicsx.atomic import new_hdf5
from receding_fenicsx.errors import InputError

FORMAT_VERSION = 1
COMPRESSED_SIZE = 4096
"""Number of values from which an array is compressed (without loss)."""


@contextmanager
def create(path: Path, kind: str, overwrite: bool) -> Iterator[h5py.File]:
    """Yield a new file of a kind; it takes its place when it is complete.

    Raises:
        InputError: the file exists already or cannot be written.
    """
    with new_hdf5(path, overwrite) as file:
        file.attrs["format"] = kind
        file.attrs["format_version"] = FORMAT_VERSION
        yield file


@contextmanager
def open_file(path: Path, kind: str) -> Iterator[h5py.File]:
    """Yield a file that :func:`create` made; errors of what is read there name the file.

    Raises:
        InputError: the file does not exist, is of another kind, or is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != kind:
                raise InputError(f"{path}: is not a {kind}; give a file that this program wrote")
            version = int(file.attrs.get("format_version", -1))
            if version != FORMAT_VERSION:
                raise InputError(
                    f"{path}: has format version {version}, this program reads {FORMAT_VERSION}; "
                    "create it again"
                )
            yield file
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError):
        raise InputError(f"{path}: is damaged or not an HDF5 file; create it again") from None


def write(group: h5py.Group, name: str, value: Any) -> None:
    """Write arrays as datasets, everything else as an attribute."""
    if isinstance(value, np.ndarray):
        big = value.size >= COMPRESSED_SIZE
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if big else {}
        if value.size and value.ndim:
            options["fletcher32"] = True  # a damaged file then raises an error when it is read
        group.create_dataset(name, data=value, **options)
    elif isinstance(value, tuple):
        group.attrs.create(name, list(value), dtype=h5py.string_dtype(), shape=(len(value),))
    else:
        group.attrs[name] = value


def read(group: h5py.Group, name: str) -> Any:
    """Read a value that :func:`write` wrote, as an array or a Python type."""
    if name in group:
        return np.asarray(group[name][()])
    if name not in group.attrs:
        raise InputError(f"'{group.name.rstrip('/')}/{name}' is missing; create the file again")
    value = group.attrs[name]
    if isinstance(value, np.ndarray):
        return [v.decode() if isinstance(v, bytes) else str(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def member(file: h5py.File, name: str) -> h5py.Group:
    """Return a group of a file.

    Raises:
        InputError: there is none of this name.
    """
    if not isinstance(file.get(name), h5py.Group):
        raise InputError(f"'/{name}' is missing; create the file again")
    return typing.cast(h5py.Group, file[name])
