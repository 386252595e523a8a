"""Reading of text files; atomic writing under a temporary name in the same folder, then renamed."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from receding_fenicsx.errors import NO_ROOM, InputError, RecedingError


def read_text(path: str | Path, label: str = "") -> str:
    """Return the text of a regular file in UTF-8, without the mark that may begin it.

    Messages begin with the label, by default the path. Devices and pipes are refused: they may have
    no end.
    """
    label = label or str(path)
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a device or a pipe"
            raise InputError(f"{label}: cannot be read, it is {kind}; give a file")
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{label}: no such file; check the path") from None
    except UnicodeDecodeError:
        raise InputError(f"{label}: is not a text file in UTF-8; export it as one") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{label}: cannot be read ({reason}); check the path") from None


@contextmanager
def new_file(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary name to write to; on leaving, flush the file to disk and rename it.

    The file may exist only with ``overwrite``, and its folder has to be writable (InputError). The
    disk may be full (RecedingError).
    """
    path = Path(path)
    check_file(path, overwrite)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        sync(temporary)
        os.replace(temporary, path)
        sync(path.parent)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        temporary.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Create a folder and its parents unless they exist."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None


def unwritable(path: Path, error: OSError) -> RecedingError:
    """Return the error to raise where a file cannot be written."""
    text = f"{path}: cannot be written ({error.strerror or error})"
    if error.errno in NO_ROOM:
        return RecedingError(f"{text}; make room or choose another disk")
    return InputError(f"{text}; choose another place")


def check_file(path: Path, overwrite: bool = False) -> None:
    """Raise InputError unless a file may be created at ``path``."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not overwrite:
        raise InputError(f"{path}: already exists; choose another name or give --overwrite")
    if not path.parent.is_dir():
        raise InputError(f"{path}: its folder does not exist; create it first")


def sync(path: Path) -> None:
    """Flush a file's content, or a folder's names, to disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
