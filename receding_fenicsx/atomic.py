"""Files that are either whole or not there: written beside their place, then renamed into it."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from receding_fenicsx.errors import NO_ROOM, InputError, RecedingError


@contextmanager
def new_file(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """Give a name beside ``path`` to write to; on leaving it is flushed to disk and renamed.

    Args:
        path: where the finished file shall be.
        overwrite: replace a file that is there already.

    Yields:
        The name to write to.

    Raises:
        InputError: the file is there already, or its folder cannot be written to.
        RecedingError: the disk is full.
    """
    path = Path(path)
    check_file(path, overwrite)
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield beside
        sync(beside)
        os.replace(beside, path)
        sync(path.parent)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        beside.unlink(missing_ok=True)


IMAGES = (1, 14, 0)
"""HDF5 from which on images of files in memory are whole: those of 1.10 have wrong checksums. With
a newer h5py in turn a Python object as file crashes the collector of garbage after an error."""


@contextmanager
def new_hdf5(path: Path, overwrite: bool = False) -> Iterator[h5py.File]:
    """Give an HDF5 file to fill; on leaving it is written as :func:`new_file` does.

    It is filled in memory: HDF5 crashes the interpreter at its end where a disk is full.

    Args:
        path: where the finished file shall be.
        overwrite: replace a file that is there already.

    Yields:
        The open file.
    """
    with new_file(path, overwrite) as beside:
        # attributes above 64 kB (a scene with long tables) need the layout of HDF5 1.8
        layout = ("v108", "v110")
        if h5py.version.hdf5_version_tuple < IMAGES:
            memory = io.BytesIO()
            with h5py.File(memory, "w", libver=layout) as file:
                yield file
            image = memory.getvalue()
        else:
            with h5py.File(beside, "w", driver="core", backing_store=False, libver=layout) as file:
                yield file
                file.flush()
                image = file.id.get_file_image()
        beside.write_bytes(image)


def make_folder(path: Path) -> None:
    """Make a folder, and those that it is in, unless it is there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None


def check_room(path: Path, size: int) -> None:
    """Raise unless a file of so many bytes can be written at ``path`` now.

    For files that other libraries write, which crash where a disk is full.
    """
    try:
        with tempfile.TemporaryFile(dir=path.parent) as file:
            file.write(bytes(size))
    except OSError as error:
        raise unwritable(path, error) from None


def unwritable(path: Path, error: OSError) -> RecedingError:
    """Return the error to be raised where a file cannot be written."""
    text = f"{path}: cannot be written ({error.strerror or error})"
    if error.errno in NO_ROOM:
        return RecedingError(f"{text}; make room or choose another disk")
    return InputError(f"{text}; choose another place")


def check_file(path: Path, overwrite: bool = False) -> None:
    """Raise InputError unless a file may be made at ``path``."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not overwrite:
        raise InputError(f"{path}: is there already; choose another name or give --overwrite")
    if not path.parent.is_dir():
        raise InputError(f"{path}: its folder does not exist; make it first")


def check_folder(path: Path, overwrite: bool = False) -> None:
    """Raise InputError unless a run's folder may be made at ``path``."""
    path = Path(path)
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"{path}: is a file; give a folder that is not there yet")
    try:
        empty = not any(path.iterdir())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); choose another folder"
        ) from None
    if empty:
        return
    if not overwrite:
        raise InputError(f"{path}: is there already; choose another folder or give --overwrite")
    if not (path / "summary.json").is_file():
        raise InputError(
            f"{path}: holds no earlier run, so it is not replaced; choose another folder"
        )


def sync(path: Path) -> None:
    """Have a file's content, or a folder's names, written to disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
