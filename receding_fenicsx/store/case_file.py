"""Finished cases of a study in its folder, a line with a checksum for each."""

from __future__ import annotations

import json
import os
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from receding_fenicsx.atomic import unwritable

CASES = "cases.jsonl"
"""Name of the file; those of shares have a number in it."""


@dataclass(frozen=True)
class Case:
    """One case of a study.

    Attributes:
        identity: digest of all that its outcome depends on, "" where it cannot be run.
        work: arguments of the study's function ``measure``, which other processes can take.
        labels: what the file says of it, for a reader.
        body: digest of its condensed system: cases of one body follow each other.
        error: why it cannot be run.
    """

    identity: str
    work: tuple[Any, ...] = ()
    labels: tuple[Any, ...] = ()
    body: str = ""
    error: str = ""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    Attributes:
        cells: what was measured: numbers, texts, and lists and dictionaries of such; nothing where
            the case failed.
        error: why it failed, "" where it did not.
        final: whether it would fail again; False after a lack of memory or room, say.
    """

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
