"""Files that are either whole or not there: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from receding_fenicsx.errors import InputError


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
        # HDF5 says why in the middle of a long text
        inner = re.search(r"error message = '([^']+)'", str(error))
        reason = inner[1] if inner else error.strerror or error
        raise InputError(f"{path}: cannot be written ({reason}); choose another place") from None
    finally:
        beside.unlink(missing_ok=True)


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
