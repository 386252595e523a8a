"""A run's folder DIR: made beside its place as ``DIR.part``, renamed when all of it is written.

A run that is interrupted leaves ``DIR.part``: the condensed system, the journal with its
checkpoints, and the record as far as there was time to write it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from receding_fenicsx.atomic import check_folder, new_file, sync, unwritable
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.evolution.journal import JOURNAL, has_checkpoint
from receding_fenicsx.output.storage.summary_file import read_summary
from receding_fenicsx.scene.identity import FREE_WHEN_FINISHED, FREE_WHEN_RESUMED, difference
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import from_toml, to_toml

SYSTEM, SCENE = "system.h5", "scene.toml"
"""The condensed system and the scene, in a run's folder."""


def part_of(path: Path) -> Path:
    """Return where a run lives until it is finished.

    Raises:
        InputError: ``path`` is the root of a file system, beside which nothing can be made.
    """
    place = Path(os.path.abspath(path))
    if not place.name:
        raise InputError(f"{path}: is no place for a run; give a folder that is not there yet")
    return place.with_name(f"{place.name}.part")


@contextmanager
def run_folder(
    path: Path, scene: Scene, overwrite: bool = False, resume: bool = False
) -> Iterator[Path]:
    """Give the folder to work in; on leaving without an error it becomes ``path``.

    Args:
        path: where the finished folder shall be.
        scene: what is run.
        overwrite: replace what an earlier run left there, and an interrupted one beside it.
        resume: go on with what an interrupted or a shorter run has left; begin where there is none.

    Yields:
        The folder to work in. When an error leaves it without a checkpoint, it is removed.

    Raises:
        InputError: the folder is there already or cannot be made, another run is working in it, or
            the run to be resumed is that of another scene.
        RecedingError: the disk is full.
    """
    path = Path(os.path.abspath(path))
    part = part_of(path)
    earlier = _earlier(path) if resume else None
    if earlier is None:
        check_folder(path, overwrite)
        if not overwrite and not resume and part.exists():
            os.close(_lock(part))
            raise InputError(
                f"{part}: holds an interrupted run; go on with it by --resume, or start anew by "
                "--overwrite"
            )
    else:
        _check_same(earlier, scene)
    try:
        part.mkdir(parents=True, exist_ok=True)
        lock = _lock(part)
        if earlier is None:
            _clear(part)
        elif earlier != part:
            _clear(part)
            for name in (SYSTEM, JOURNAL):
                shutil.copy2(earlier / name, part / name)
        with new_file(part / SCENE, overwrite=True) as beside:
            beside.write_text(to_toml(scene), encoding="utf-8")
    except OSError as error:
        if earlier != part:
            shutil.rmtree(part, ignore_errors=True)
        raise unwritable(path, error) from None
    try:
        yield part
        try:
            _publish(part, path, overwrite or earlier is not None)
        except OSError as error:
            raise unwritable(path, error) from None
    except BaseException as error:
        if not _has_news(part, earlier) and (
            isinstance(error, RecedingError) or not (part / SYSTEM).exists()
        ):
            shutil.rmtree(part, ignore_errors=True)
        raise
    finally:
        os.close(lock)


def has_run(path: Path) -> bool:
    """Return whether there is a run to resume, interrupted or finished."""
    return _earlier(Path(path)) is not None


def is_finished(path: Path, scene: Scene) -> bool:
    """Return whether a folder holds the whole run of a scene, so that nothing is left to resume.

    Raises:
        InputError: it holds the run of another scene, or one that failed.
    """
    path = Path(path)
    if part_of(path).exists() or not (path / "summary.json").is_file():
        return False
    summary = read_summary(path / "summary.json")
    if _earlier(path) is None:
        raise InputError(f"{path}: holds no run that can be resumed; choose another folder")
    _check_same(path, scene)
    if "failure" in summary:
        raise InputError(f"{path}: that run has failed ({summary['failure']}); change the scene")
    if difference(_scene_of(path), scene, FREE_WHEN_FINISHED) is not None:
        return False
    steady = summary["steady"]["reached"] and scene.history.until == "steady"
    wanted = scene.history.cycles if len(summary["dissipation_per_cycle"]) else 0
    return bool(steady or len(summary["dissipation_per_cycle"]) >= wanted)


def _earlier(path: Path) -> Path | None:
    """Return the folder of the run to be resumed: the interrupted one, or the finished one."""
    for folder, names in ((part_of(path), ()), (path, (JOURNAL,))):
        if all((folder / name).is_file() for name in (SYSTEM, SCENE, *names)):
            return folder
    return None


def _has_news(part: Path, earlier: Path | None) -> bool:
    """Return whether a folder holds a checkpoint that the run it goes on with did not have."""
    journal = part / JOURNAL
    if earlier is None or earlier == part:
        return has_checkpoint(journal)
    return journal.is_file() and journal.stat().st_size > (earlier / JOURNAL).stat().st_size


def _scene_of(folder: Path) -> Scene:
    try:
        return from_toml((folder / SCENE).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, InputError) as error:
        raise InputError(
            f"{folder / SCENE}: is damaged ({error}); start the run anew by --overwrite"
        ) from None


def _check_same(folder: Path, scene: Scene) -> None:
    """Refuse to go on with the run of another scene."""
    other = difference(_scene_of(folder), scene, FREE_WHEN_RESUMED)
    if other is not None:
        raise InputError(
            f"{folder}: was begun with another {other}; resume it with the same scene, or choose "
            "another folder"
        )


def _lock(part: Path) -> int:
    """Take hold of the folder for as long as this process lives; return the handle to close."""
    handle = os.open(part, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise InputError(
            f"{part}: another run is working there; wait for it, or choose another folder"
        ) from None
    except OSError:
        pass  # a file system without locks
    return handle


def _clear(folder: Path) -> None:
    for item in folder.iterdir():
        if item.is_dir():
            shutil.rmtree(item)
        else:
            item.unlink()


def _publish(part: Path, path: Path, overwrite: bool) -> None:
    """Put the finished folder into its place."""
    check_folder(path, overwrite)
    old = part.with_name(f".{path.absolute().name}.{os.getpid()}.old")
    if path.exists():
        os.replace(path, old)
    os.replace(part, path)
    with suppress(OSError):
        sync(part.parent)
    shutil.rmtree(old, ignore_errors=True)
