"""Run folders: written as ``DIR.part``, renamed to ``DIR`` when the run has finished.

An interrupted run leaves ``DIR.part`` with the condensed system, the journal with its checkpoints,
and the record as far as it was written.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from receding_fenicsx.atomic import make_folder, new_file, read_text, unwritable
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.evolution.histories import CORNERS
from receding_fenicsx.evolution.journal import JOURNAL, checkpoints
from receding_fenicsx.evolution.probes import probe_names
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.identity import difference
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene, to_toml
from receding_fenicsx.store.hdf5 import read_record, read_system
from receding_fenicsx.store.workspace import CASES, FolderKind, locked

if TYPE_CHECKING:
    from mpi4py import MPI


SYSTEM, SCENE = "system.h5", "scene.toml"
"""File names of the condensed system and of the scene in a run folder."""
RUN = FolderKind("run", ("summary.json",))


def part_of(path: Path) -> Path:
    """Return the folder ``DIR.part`` of an unfinished run."""
    place = Path(os.path.abspath(path))
    if not place.name:
        raise InputError(f"{path}: cannot be a run's folder; give the name of a new folder")
    return place.with_name(f"{place.name}.part")


@contextmanager
def run_folder(
    path: Path, scene: Scene, overwrite: bool = False, resume: bool = False
) -> Iterator[Path]:
    """Create the folder ``DIR.part`` of a run; rename it to ``path`` at the end of the block.

    ``overwrite`` replaces an earlier run, finished or interrupted; ``resume`` continues an
    interrupted or a shorter one, and starts a new one if there is none. After an error the working
    folder is removed unless it holds a checkpoint.
    """
    path = Path(os.path.abspath(path))
    part = part_of(path)
    earlier = _earlier(path) if resume else None
    if earlier is not None:
        _check_same(earlier, scene)
    else:
        if RUN.check(path, overwrite, resume) and resume:
            raise InputError(f"{path}: holds no run that can be resumed; choose another folder")
        if not overwrite and not resume and part.exists():
            with locked(part):  # in use, or left behind
                ways = "continue it with --resume, or replace it with --overwrite"
                raise InputError(f"{part}: holds an interrupted run; {ways}")
    make_folder(part)
    with locked(part):
        try:
            for item in part.iterdir() if earlier != part else ():
                shutil.rmtree(item) if item.is_dir() else item.unlink()
            for item in earlier.iterdir() if earlier and earlier != part else ():
                if item.name in (SYSTEM, CORNERS, CASES, JOURNAL):
                    (shutil.copytree if item.is_dir() else shutil.copy2)(item, part / item.name)
            with new_file(part / SCENE, overwrite=True) as beside:
                beside.write_text(to_toml(scene), encoding="utf-8")
        except (OSError, RecedingError) as error:
            if earlier != part:
                shutil.rmtree(part, ignore_errors=True)
            raise (unwritable(path, error) if isinstance(error, OSError) else error) from None
        try:
            yield part
            try:
                RUN.publish(part, path, overwrite or earlier is not None)
            except OSError as error:
                raise unwritable(path, error) from None
        except BaseException as error:
            # a checkpoint that the resumed run did not have
            before = 0 if earlier is None or earlier == part else checkpoints(earlier)
            news = checkpoints(part) > before
            if not news and (
                isinstance(error, RecedingError)
                or not any((part / name).exists() for name in (SYSTEM, CASES))
            ):
                shutil.rmtree(part, ignore_errors=True)
                if earlier == path and isinstance(error, InputError):
                    # a damaged file is that of the finished run, which stays
                    error.args = tuple(s.replace(f"{part}/", f"{path}/") for s in error.args)
            raise


@contextmanager
def shared_folder(
    comm: MPI.Comm, path: str | Path | None, scene: Scene, overwrite: bool, resume: bool
) -> Iterator[Path | None]:
    """Open and close a run's folder on rank 0, None without one; errors are raised on all."""
    if path is None:
        yield None
        return
    with ExitStack() as stack:
        opened = run_folder(Path(path), scene, overwrite, resume)
        folder = on_root(comm, lambda: stack.enter_context(opened))
        yield folder
        on_root(comm, stack.close)


def read_run(folder: Path) -> tuple[Scene, ContactSystem, Record]:
    """Read scene, condensed system and record of a finished run."""
    record = read_record(folder / "record.h5")
    if record.scene is None:
        raise InputError(f"{folder / 'record.h5'}: has no scene; give the folder of a run")
    return record.scene, read_system(folder / SYSTEM, record.scene), record


def has_run(path: Path) -> bool:
    """Return whether there is an interrupted or a finished run to resume."""
    return _earlier(Path(path)) is not None


def is_finished(path: Path, scene: Scene) -> bool:
    """Return whether a folder holds a scene's finished run; InputError if another one's."""
    path = Path(path)
    if part_of(path).exists() or not (path / "summary.json").is_file():
        return False
    summary = read_summary(path / "summary.json")
    if _earlier(path) is None:
        raise InputError(f"{path}: holds no run that can be resumed; choose another folder")
    _check_same(path, scene)
    if "failure" in summary:
        raise InputError(f"{path}: that run has failed ({summary['failure']}); change the scene")
    if difference(_scene_of(path), scene, frozenset({"history.cycles", "history.until"})):
        return False
    until, limit = scene.history.until, summary.get("limit")
    cycles = len(summary["dissipation_per_cycle"])
    played = not cycles or cycles >= scene.history.cycles
    if until == "limit":
        return limit is not None and bool(limit["reached"] or played)
    if limit is not None and limit["jumped"]:
        return False  # its last cycle does not follow the one before
    return bool(played or (summary["steady"]["reached"] and until == "steady"))


def _earlier(path: Path) -> Path | None:
    """Return the folder of the run to resume, the interrupted one first; None if there is none."""
    part = part_of(path)
    for folder, names in ((part, (SYSTEM,)), (part, (CASES,)), (path, (SYSTEM, JOURNAL))):
        if all((folder / name).exists() for name in (SCENE, *names)):
            return folder
    return None


def forget_system(part: Path) -> None:
    """Remove the condensed system of a working folder, and what was evolved with it."""
    for name in (SYSTEM, CORNERS):
        (part / name).unlink(missing_ok=True)
    shutil.rmtree(part / JOURNAL, ignore_errors=True)


def _scene_of(folder: Path) -> Scene:
    try:
        return known_scene(read_text(folder / SCENE))
    except InputError as error:
        raise InputError(f"{folder / SCENE}: is damaged ({error}); use --overwrite") from None


def _check_same(folder: Path, scene: Scene) -> None:
    """Raise InputError if a folder holds the run of another scene."""
    stored = _scene_of(folder)
    # none of these keys changes the finished cycles
    free = {"title", "fatigue", "units", "shakedown", "accuracy", "mode", "wear"}
    free |= {"history.cycles", "history.until", "output.cycles"}
    if {stored.output.samples_per_leg, scene.output.samples_per_leg} == {None, 40}:
        free |= {"output.samples_per_leg"}  # the default, written out or not
    RUN.check_same(folder, difference(stored, scene, frozenset(free)))


def write_summary(path: Path, summary: Mapping[str, Any], overwrite: bool = False) -> None:
    """Write a summary as JSON; numbers that are not finite become null."""
    from pydantic_core import to_json

    with new_file(path, overwrite) as beside:
        text = to_json(summary, indent=2, inf_nan_mode="null", fallback=lambda v: v.tolist())
        beside.write_bytes(text + b"\n")


def read_summary(path: str | Path) -> dict[str, Any]:
    """Read a summary; InputError where there is none."""
    try:
        summary = json.loads(read_text(path))
    except ValueError:
        raise InputError(f"{path}: is damaged or not a JSON file; run the scene again") from None
    needed = {"title", "steady", "turning_points", "dissipation_per_cycle"}
    if not isinstance(summary, dict) or not needed <= summary.keys():
        raise InputError(f"{path}: is not a summary of a run; run the scene again")
    return summary


def write_probes(folder: Path, record: Record) -> list[Path]:
    """Write and return ``NAME.csv`` for each probe of a record, with ``probe.to_table()``."""
    made = [folder / f"{name}.csv" for name in probe_names(record)]
    for path in made:
        make_folder(folder)
        write_csv(path, record.probe(path.stem).to_table(), overwrite=True)
    return made


def write_csv(path: Path, columns: Mapping[str, Any], overwrite: bool = False) -> None:
    """Write columns of equal length by their names as CSV; numbers keep all their digits."""
    lists = [each.tolist() if hasattr(each, "tolist") else each for each in columns.values()]
    with new_file(path, overwrite) as beside, open(beside, "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows(zip(*lists, strict=True))
