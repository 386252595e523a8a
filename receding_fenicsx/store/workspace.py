"""Folders of results: which may be written to, who is using one, how an interrupted one goes on.

Those of one piece are written beside their place and renamed when they are complete
(:meth:`FolderKind.new`). Runs, sweeps and curves are filled bit by bit, under a lock, and are
continued by ``--resume`` if they are of the same scene.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from receding_fenicsx.atomic import make_folder, sync, unwritable
from receding_fenicsx.errors import InputError, Interrupted


@dataclass(frozen=True)
class FolderKind:
    """Kind of a folder of results: its name, and the files that show that a folder is one."""

    name: str
    marks: tuple[str, ...]
    resumable: bool = True

    def check(self, path: Path, overwrite: bool = False, resume: bool = False) -> bool:
        """Return whether a folder holds such results; InputError where it is not to be written."""
        if overwrite and resume:
            raise InputError("--resume and --overwrite: give one of them")
        if not path.exists():
            return False
        if not path.is_dir():
            raise InputError(f"{path}: is a file; give a new folder")
        try:
            # what a write has left behind, or is about to rename, is nothing to lose
            if all(item.suffix == ".tmp" for item in path.iterdir()):
                return False
        except OSError as error:
            reason = f"cannot be read ({error.strerror})"
            raise InputError(f"{path}: {reason}; choose another folder") from None
        if not any((path / mark).is_file() for mark in self.marks):
            raise InputError(f"{path}: already exists, no folder of a {self.name}; choose another")
        if not overwrite and not resume:
            ways = "continue it with --resume, or " if self.resumable else ""
            raise InputError(f"{path}: already exists as a {self.name}; {ways}use --overwrite")
        return True

    def check_same(self, path: Path, other: str | None) -> None:
        """Raise InputError if ``other`` names what a folder is of, and what continues it is not."""
        if other is not None:
            raise InputError(f"{path}: is a {self.name} with another {other}; choose a new folder")

    @contextmanager
    def new(self, path: Path, overwrite: bool = False) -> Iterator[Path]:
        """Yield a folder beside ``path`` that takes its place at the end of the block."""
        path = Path(os.path.abspath(path))
        beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        make_folder(beside)
        try:
            yield beside
            self.publish(beside, path, overwrite)
        except OSError as error:
            raise unwritable(path, error) from None
        finally:
            shutil.rmtree(beside, ignore_errors=True)

    def publish(self, beside: Path, path: Path, overwrite: bool) -> None:
        """Rename a finished folder to its final name; an earlier one is removed after that."""
        self.check(path, overwrite)
        old = path.with_name(f".{path.name}.{os.getpid()}.old")
        if path.exists():
            os.replace(path, old)
        os.replace(beside, path)
        with suppress(OSError):
            sync(path.parent)
        shutil.rmtree(old, ignore_errors=True)


@contextmanager
def locked(path: Path, wait: bool = False, shared: bool = False) -> Iterator[None]:
    """Keep a folder or file to this process, or to those that share it, or ``wait`` for others."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT)
    try:
        try:
            mode = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
            fcntl.flock(handle, mode | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise InputError(f"{path}: another run is using this folder; wait for it") from None
        except OSError:
            pass  # the file system has no locks
        yield
    finally:
        os.close(handle)


def interruption(
    signalled: KeyboardInterrupt | SystemExit, where: str, folder: Path, held: str
) -> Interrupted:
    """Return the error to raise where a signal ends what a folder can continue."""
    code = signalled.code if isinstance(signalled, SystemExit) else 130  # 128 + SIGINT
    text = f"interrupted {where}; {folder} holds {held}; continue by --resume"
    return Interrupted(text, int(code or 1))


@contextmanager
def resumable(
    folder: Path | None, where: str, held: str = "the whole history", file: str = ""
) -> Iterator[None]:
    """Say how to continue from what a file of a folder holds where a signal ends the block."""
    try:
        yield
    except Interrupted:
        raise
    except (KeyboardInterrupt, SystemExit) as signalled:
        if folder is None or not (folder / file).exists():
            raise
        raise interruption(signalled, where, folder, held) from None


CASES = "cases.jsonl"
"""Name of the file; those of shares have a number in it."""


@dataclass(frozen=True)
class Case:
    """One case of a study."""

    identity: str  # digest of all that its outcome depends on, "" where it cannot be run
    # arguments of the study's function ``measure``, which other processes can take
    work: tuple[Any, ...] = ()
    labels: tuple[Any, ...] = ()  # what the file says of it, for a reader
    body: str = ""  # digest of its condensed system: cases of one body follow each other
    error: str = ""  # why it cannot be run


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case: JSON values or an error; ``final``: it would fail again."""

    cells: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    final: bool = True


class CaseFile:
    """Finished cases in a folder, which one process at a time may add to."""

    def __init__(self, folder: Path, name: str = CASES) -> None:
        """Hold the file; an unfinished line is removed."""
        self.folder, self.path = folder, folder / name
        if self.path.is_file():
            os.truncate(self.path, self.path.read_bytes().rfind(b"\n") + 1)

    def read(self, final: bool = False) -> dict[str, Outcome]:
        """Return the outcomes of all shares by the identities of their cases.

        ``final`` leaves out cases that may succeed when they are tried again.
        """
        found: dict[str, Outcome] = {}
        for path in sorted(self.folder.glob("cases*.jsonl")):
            for line in path.read_bytes().splitlines():
                checksum, _, text = line.partition(b" ")
                if checksum == b"%08x" % zlib.crc32(text):  # else damaged, or still being written
                    row = json.loads(text)
                    outcome = Outcome(row["cells"], row["error"], row["final"])
                    earlier = found.get(row["identity"])
                    if outcome.final or not (final or (earlier and earlier.final)):
                        found[row["identity"]] = outcome
        return found

    def add(self, case: Case, outcome: Outcome) -> None:
        """Write a finished case to the disk."""
        row = {"case": case.labels, "identity": case.identity, **asdict(outcome)}
        text = json.dumps(row, ensure_ascii=False).encode()
        try:
            with self.path.open("ab") as file:
                file.write(b"%08x %s\n" % (zlib.crc32(text), text))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise unwritable(self.path, error) from None
