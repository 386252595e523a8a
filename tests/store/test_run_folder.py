import errno
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

import receding_fenicsx as rf
from receding_fenicsx.evolution.histories import CORNERS
from receding_fenicsx.evolution.journal import JOURNAL
from receding_fenicsx.store.run_folder import SCENE, SYSTEM, forget_system, has_run, run_folder
from receding_fenicsx.store.workspace import CASES, FolderKind, locked, resumable

pytestmark = pytest.mark.one_rank

BLOCK_FILE = Path(__file__).parents[2] / "demos" / "block.toml"
BLOCK = rf.read_scene(BLOCK_FILE)
LOCK = Path(__file__).parents[1] / "programs" / "holds_a_folder.txt"
INTERRUPTED = "holds an interrupted run; continue it with --resume, or replace it with --overwrite"


class Killed(BaseException):
    """Stands for what ends a process between two instructions."""


def fill(folder: Path, text: str = "{}") -> None:
    """Put into a folder what a run leaves there."""
    (folder / SYSTEM).write_text(text)
    (folder / JOURNAL).mkdir(exist_ok=True)
    (folder / JOURNAL / "0.npz").touch()
    for name in (CORNERS, CASES):
        (folder / name).touch()
    (folder / "summary.json").write_text(text)


def refused(words: str, out: Path, **how: bool) -> None:
    """Assert that a run is not let into a folder that is named, rather than at its end."""
    named = rf"^{re.escape(str(out))}(\.part)?: {words}$"
    with pytest.raises(rf.InputError, match=named), run_folder(out, BLOCK, **how):
        pytest.fail("was let in")


def interrupt(out: Path, **how: bool) -> None:
    """Work in a run's folder until killed."""
    with pytest.raises(Killed), run_folder(out, BLOCK, **how) as folder:
        fill(folder)
        raise Killed


KIND = FolderKind("curve", ("curve.json", "cases/sweep.json"))
ONCE = FolderKind("study", ("nodes.csv",), resumable=False)


@pytest.mark.parametrize(
    "opened", [partial(run_folder, scene=BLOCK), ONCE.new], ids=["run", "study"]
)
def test_folder_appears_whole_or_not_at_all_and_is_replaced_when_asked(
    opened: Callable[..., Any], tmp_path: Path
) -> None:
    out, name = tmp_path / "deep" / "out", "nodes.csv" if opened == ONCE.new else "summary.json"
    for number in range(2):
        with pytest.raises(RuntimeError), opened(out, overwrite=number > 0) as folder:
            (folder / name).write_text("half")
            raise RuntimeError
        assert os.listdir(out.parent) == ["out"][:number]
        with opened(out, overwrite=number > 0) as folder:
            (folder / name).write_text(str(number))
            assert (out / name).read_text() == "0" if number else not out.exists()
        assert os.listdir(out.parent) == ["out"]
        assert {*os.listdir(out), SCENE} == {name, SCENE}
        assert (out / name).read_text() == str(number)
    (tmp_path / "empty").mkdir()  # holds nothing to lose
    with opened(tmp_path / "empty") as folder:
        (folder / name).touch()
    late = tmp_path / "late"
    with pytest.raises(rf.InputError, match="already exists"), opened(late) as folder:
        (folder / name).write_text("mine")
        late.mkdir()  # meanwhile
        (late / name).write_text("of another")
    assert (late / name).read_text() == "of another"


def test_only_runs_are_replaced(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with run_folder(out, BLOCK) as folder:
        (folder / "summary.json").touch()
    refused("already exists as a run; continue it with --resume, or use --overwrite", out)
    # it is finished, without a journal
    refused("holds no run that can be resumed; choose another folder", out, resume=True)
    (tmp_path / "thesis.tex").write_text("years of work")
    refused("already exists, no folder of a run; choose another", tmp_path, overwrite=True)
    refused("is a file; give a new folder", tmp_path / "thesis.tex", overwrite=True)
    assert (tmp_path / "thesis.tex").exists()


def test_interrupted_run_is_neither_forgotten_nor_taken_for_finished(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert not has_run(out)
    interrupt(out)
    assert os.listdir(tmp_path) == ["run.part"]
    assert has_run(out)
    refused(INTERRUPTED, out)
    with run_folder(out, BLOCK, resume=True) as folder:
        assert folder == tmp_path / "run.part" and (folder / SYSTEM).exists()
    assert os.listdir(tmp_path) == ["run"]
    interrupt(out, overwrite=True)
    assert sorted(os.listdir(tmp_path)) == ["run", "run.part"]
    with run_folder(out, BLOCK, overwrite=True) as folder:
        assert os.listdir(folder) == [SCENE]
        fill(folder, "new")
    assert (out / SYSTEM).read_text() == "new"


def test_run_without_a_checkpoint_is_kept_only_if_a_signal_ended_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, full = tmp_path / "run", Mock(side_effect=OSError(errno.ENOSPC, "full"))
    room = r"\(full\); make room or choose another disk$"
    with monkeypatch.context() as disk, pytest.raises(rf.RecedingError, match=room):
        disk.setattr("receding_fenicsx.store.run_folder.to_toml", full)
        run_folder(out, BLOCK).__enter__()
    assert os.listdir(tmp_path) == []
    with pytest.raises(rf.InputError), run_folder(out, BLOCK) as folder:
        (folder / SYSTEM).write_text("condensed")
        raise rf.InputError("its first leg fails, and would again")
    assert os.listdir(tmp_path) == []
    with pytest.raises(Killed), run_folder(out, BLOCK) as folder:
        (folder / SYSTEM).write_text("condensed")
        raise Killed
    assert os.listdir(tmp_path) == ["run.part"]
    forget_system(tmp_path / "run.part")  # killed before there was one
    refused(INTERRUPTED, out)
    interrupt(out, resume=True)
    # its checkpoints outlive a failure of the run that goes on with them
    with pytest.raises(rf.InputError), run_folder(out, BLOCK, resume=True):
        raise rf.InputError("its next leg fails")
    assert has_run(out)


def test_finished_run_stays_until_the_longer_one_is_finished_too(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with run_folder(out, BLOCK) as folder:
        fill(folder, "short")
    longer = replace(BLOCK, history=replace(BLOCK.history, cycles=900))
    with pytest.raises(Killed), run_folder(out, longer, resume=True) as folder:
        assert set(os.listdir(folder)) == {CASES, CORNERS, JOURNAL, SCENE, SYSTEM}
        fill(folder, "on the way")
        raise Killed
    assert (out / SYSTEM).read_text() == "short"
    with run_folder(out, longer, resume=True) as folder:
        # of the run that has come further
        assert (folder / SYSTEM).read_text() == "on the way"
        fill(folder, "long")
    assert (out / SYSTEM).read_text() == "long"
    assert "cycles = 900" in (out / SCENE).read_text()
    forget_system(out)  # of the mesh before: its numbers are kept
    assert set(os.listdir(out)) == {CASES, SCENE, "summary.json"}


def test_folder_in_use_is_left_alone(tmp_path: Path) -> None:
    out, part = tmp_path / "run", tmp_path / "run.part"
    interrupt(out)
    # a lock belongs to a process: another one takes it
    words = [sys.executable, *map(str, (LOCK, out, BLOCK_FILE))]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, env=rf.child_environment())
    try:
        assert child.stdout is not None and child.stdout.readline() == b"locked\n"
        for how in ({}, {"resume": True}, {"overwrite": True}):
            refused("another run is using this folder; wait for it", out, **how)
        threading.Timer(0.05, child.kill).start()
        with locked(part, wait=True):
            assert child.wait() < 0
    finally:
        child.kill()
        child.communicate()
    interrupt(out, resume=True)


@pytest.mark.parametrize(
    ("kind", "files", "how", "answer"),
    [
        (KIND, (), {}, False),
        (KIND, (), {"resume": True}, False),
        (KIND, (".curve.json.7.tmp",), {}, False),  # another process is about to rename it
        (KIND, ("curve.json",), {"resume": True}, True),
        (KIND, ("cases/sweep.json",), {"overwrite": True}, True),
        (KIND, ("curve.json",), {}, "as a curve; continue it with --resume, or use --overwrite"),
        (ONCE, ("nodes.csv",), {}, "already exists as a study; use --overwrite"),
        (KIND, ("thesis.tex",), {"overwrite": True}, "no folder of a curve; choose another"),
        (KIND, ("nodes.csv",), {"resume": True}, "exists, no folder of a curve; choose another"),
        (KIND, (), {"overwrite": True, "resume": True}, "give one of them"),
    ],
)
def test_only_results_of_the_kind_are_replaced_or_continued_and_only_when_asked(
    kind: FolderKind,
    files: tuple[str, ...],
    how: dict[str, bool],
    answer: bool | str,
    tmp_path: Path,
) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    if isinstance(answer, bool):
        assert kind.check(tmp_path, **how) == answer
        return
    with pytest.raises(rf.InputError, match=f"^({tmp_path}|--resume and --overwrite): .*{answer}$"):
        kind.check(tmp_path, **how)
    assert all((tmp_path / name).read_text() == "mine" for name in files)


def test_an_interruption_keeps_its_code_and_tells_how_to_go_on_where_it_can(tmp_path: Path) -> None:
    signalled = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt) as bare, resumable(tmp_path, "here", file="system.h5"):
        raise signalled
    assert bare.value is signalled
    kept = f"^interrupted here; {tmp_path} holds the whole history; continue by --resume$"
    with pytest.raises(rf.Interrupted, match=kept) as told:
        with resumable(tmp_path, "here"):
            raise SystemExit(143)
    assert told.value.exit_code == 143
