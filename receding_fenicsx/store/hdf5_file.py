"""HDF5 files; a title with a digest of the whole file; values as datasets or attributes."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError

FORMAT_VERSION = 1
TITLE_BYTES = 512
"""Size of the title, HDF5's user block: kind, format version and digest of all that follows it."""
COMPRESSED_SIZE = 4096
"""Number of values from which an array is compressed (without loss)."""
HDF5_WITH_IMAGES = (1, 14, 0)
"""First HDF5 release whose file images in memory are used. Those of 1.10 have wrong checksums; with
a newer h5py, a file in a Python object crashes the garbage collector after an error."""


@contextmanager
def new_hdf5(path: Path, overwrite: bool = False, kind: str = "") -> Iterator[h5py.File]:
    """Give an open HDF5 file; on leaving it is written as by :func:`new_file`.

    The file is filled in memory, because HDF5 crashes at the interpreter's exit on a full disk.

    Args:
        path: path of the finished file.
        overwrite: replace an existing file.
        kind: kind of a file for :func:`open_file`; "" for a file of other programs, without title.

    Yields:
        The open file.
    """
    about = {"format": kind, "format_version": FORMAT_VERSION} if kind else {}
    with new_file(path, overwrite) as temporary:
        # attributes above 64 kB (a scene with long tables) need the layout of HDF5 1.8
        layout = ("v108", "v110")
        if h5py.version.hdf5_version_tuple < HDF5_WITH_IMAGES:
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
def open_file(path: Path, kind: str) -> Iterator[h5py.File]:
    """Yield a file of :func:`new_hdf5`, of a kind and with the digest of its title.

    Raises:
        InputError: the file does not exist, is of another kind or format version, or a bit of it
            has changed since it was written.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        with open(path, "rb") as plain:
            title = plain.read(TITLE_BYTES)
            intact = title == _title(kind, hashlib.file_digest(plain, "sha256").hexdigest())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if not intact:
        raise InputError(
            f"{path}: is damaged, was changed, or is not a {kind} of format version "
            f"{FORMAT_VERSION}; create it again"
        )
    try:
        with h5py.File(path, "r") as file:
            yield file
    except KeyError as error:
        raise InputError(
            f"{path}: was written by another version of this program ({error}); create it again"
        ) from None


def write(group: h5py.Group, name: str, value: Any) -> None:
    """Write arrays as datasets, everything else as an attribute."""
    if isinstance(value, np.ndarray):
        big = value.size >= COMPRESSED_SIZE
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
        return [v.decode() if isinstance(v, bytes) else str(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value
