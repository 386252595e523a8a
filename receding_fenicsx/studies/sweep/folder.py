"""Folder of a sweep: its finished cases, kept one by one, and the table in the end."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from receding_fenicsx.atomic import make_folder, unwritable
from receding_fenicsx.environment import versions
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.identity import difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import from_toml, to_toml
from receding_fenicsx.store.summary_file import write_summary
from receding_fenicsx.store.workspace import FolderKind, locked
from receding_fenicsx.studies.sweep.cases import Case, Grid
from receding_fenicsx.studies.sweep.table import SweepTable
from receding_fenicsx.studies.sweep.worker import Outcome

PROVENANCE, CASES, TABLE, SYSTEMS = "sweep.json", "cases.jsonl", "sweep.csv", "systems"
"""Files of a sweep: what it is of, finished cases, table; folder of its condensed systems."""
ALL_CASES = "cases*.jsonl"
"""Files of finished cases, those of shards too."""
SWEEP = FolderKind("sweep", (PROVENANCE,))
FORMAT_VERSION = 1


@dataclass(frozen=True)
class SweepKind:
    """What a sweep is of: cases of another scene, other keys or other numbers do not mix with it.

    Attributes:
        scene: the scene that is changed.
        grid: its cases.
        measure: text that identifies the function that takes the numbers, "" for the default one.
    """

    scene: Scene
    grid: Grid
    measure: str = ""


class SweepFolder:
    """Open folder of a sweep.

    Attributes:
        path: the folder.
        finished: outcomes of the finished cases by the identity of their scenes.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        """Read the finished cases; keep the open file that takes the others."""
        self.path, self._file = path, file
        self.finished = {key: outcome for key, outcome in self.all().items() if outcome.final}

    @property
    def systems(self) -> Path:
        """Folder of the condensed systems."""
        return self.path / SYSTEMS

    def all(self) -> dict[str, Outcome]:
        """Read the cases of all shards, those that may succeed when they are tried again too."""
        found: dict[str, Outcome] = {}
        for path in sorted(self.path.glob(ALL_CASES)):
            for line in path.read_bytes().splitlines():
                checksum, _, text = line.partition(b" ")
                if checksum == b"%08x" % zlib.crc32(text):  # else damaged, or still being written
                    row = json.loads(text)
                    outcome = Outcome(row["cells"], row["error"], row["final"])
                    if outcome.final or not getattr(found.get(row["identity"]), "final", False):
                        found[row["identity"]] = outcome
        return found

    def add(self, case: Case, outcome: Outcome) -> None:
        """Write a finished case to the disk: a line with a checksum.

        Raises:
            RecedingError: the disk is full.
        """
        row = {"case": case.labels, "identity": case.identity, **asdict(outcome)}
        text = json.dumps(row, ensure_ascii=False).encode()
        try:
            self._file.write(b"%08x %s\n" % (zlib.crc32(text), text))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise unwritable(Path(self._file.name), error) from None

    def publish(self, table: SweepTable) -> None:
        """Write the table; the condensed systems are removed."""
        table.write_csv(self.path / TABLE, overwrite=True)
        shutil.rmtree(self.systems, ignore_errors=True)


@contextlib.contextmanager
def sweep_folder(
    path: Path,
    kind: SweepKind,
    overwrite: bool = False,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep, a new one or one to go on with.

    Args:
        path: the folder; it is created unless it exists.
        kind: what the sweep is of.
        overwrite: replace an earlier sweep.
        resume: keep the finished cases of an earlier sweep, if there is one.
        shard: number of a share of the cases, from 1, and number of shares, which are played by
            processes of their own at the same time; an earlier sweep is gone on with.

    Raises:
        InputError: the folder holds something else, or a sweep of another scene, over other keys or
            with other numbers; or another process is using it.
        RecedingError: the disk is full.
    """
    if shard is not None and overwrite:
        raise InputError("--shard and --overwrite: shares use the folder together; give a new one")
    resume = resume or shard is not None
    if SWEEP.check(path, overwrite, resume) and resume:
        _check_same(path, kind)
    make_folder(path)
    file = path / (CASES if shard is None else f"cases.{shard[0]}-of-{shard[1]}.jsonl")
    try:
        with locked(path, shared=shard is not None):
            if not resume:
                for old in (path / TABLE, *path.glob(ALL_CASES)):
                    old.unlink(missing_ok=True)
                shutil.rmtree(path / SYSTEMS, ignore_errors=True)
            _write_provenance(path, kind)
            with locked(file), open(file, "ab") as opened:
                content = file.read_bytes()
                os.truncate(file, content.rfind(b"\n") + 1)  # an unfinished line
                folder = SweepFolder(path, opened)
                scenes = [case for case in kind.grid.cases if case.scene is not None]
                if any(case.identity not in folder.finished for case in scenes):
                    (path / TABLE).unlink(missing_ok=True)
                yield folder
    except OSError as error:
        raise unwritable(path, error) from None


def _check_same(path: Path, kind: SweepKind) -> None:
    """Raise InputError if a folder holds another sweep."""
    try:
        found = json.loads((path / PROVENANCE).read_text(encoding="utf-8"))
        scene = from_toml(found["scene"])
        keys, measure, checksum = found["over"].keys(), found["measure"], found["digest"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, InputError):
        raise InputError(
            f"{path / PROVENANCE}: is damaged; start a new sweep with --overwrite"
        ) from None
    other = difference(scene, kind.scene, frozenset({"title"}))
    if other is None and checksum != digest(kind.scene):
        other = "mesh file"
    if set(keys) != set(kind.grid.keys):
        other = f"key: it is over {', '.join(keys)}"
    if other is None and measure != kind.measure:
        other = "function measure"
    SWEEP.check_same(path, other)


def _write_provenance(path: Path, kind: SweepKind) -> None:
    over = dict(zip(kind.grid.keys, kind.grid.labels, strict=True))
    content: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "title": kind.scene.title,
        "over": over,
        "cases": len(kind.grid.cases),
        "measure": kind.measure,
        "scene": to_toml(kind.scene),
        "digest": digest(kind.scene),
        "versions": versions(),
    }
    write_summary(path / PROVENANCE, content, overwrite=True)
