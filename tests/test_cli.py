import errno
import io
import logging
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest

import receding_fenicsx as rf
from receding_fenicsx import RunOptions, StudyOptions, cli, environment
from receding_fenicsx.errors import InputError, InputErrors, SolveError
from receding_fenicsx.output.plots.figures import draw_all
from receding_fenicsx.studies import run as study
from receding_fenicsx.terminal import progress
from receding_fenicsx.timing import Countdown

DEMOS = Path(__file__).parents[1] / "demos"
BLOCK = str(DEMOS / "block.toml")
SMALL = [
    *("--set", "mesh.contact_elements=40"),
    *("--set", "history.cycles=2"),
    *("--set", "solver.method=events"),
]
Run = Callable[..., "subprocess.CompletedProcess[str]"]
root = MPI.COMM_WORLD.rank == 0
ERROR = "receding-fenicsx: error: "


# -- every command in this process, on all ranks -------------------------------------------------


ROUND = ['material.kinematics="axisymmetric"', "load.p0.span=[0.0, 1.0]"]


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["contact.span=[-1.0, 1.0]"],
        ["solver.symmetry=none"],
        ROUND,
        [*ROUND, "mesh.degree=1", "material.poisson=0.49"],
        [*ROUND, "contact.span=[0.5, 1.5]"],
    ],
)
def test_check_and_condense_tell_the_nodes_and_the_symmetry_of_the_run(
    changes: list[str], shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = ["mesh.contact_elements=16", "history.cycles=1", *changes]
    settings = [word for change in wanted for word in ("--set", change)]
    assert cli.main(["check", BLOCK, *settings]) == 0
    out = ["--out", str(shared_tmp_path / "system.h5")]
    assert cli.main(["condense", BLOCK, *settings, *out]) == 0
    said = capsys.readouterr().out
    record = rf.run(rf.read_scene(BLOCK, wanted))
    if record is not None:
        body, part = ("half of the", "half") if record.half else ("the whole", "whole")
        nodes = f"{len(record.x)} contact nodes, {body} body"
        assert said.startswith(f"{BLOCK}: can be modelled; {nodes}, loads p0, 1 cycles\n")
        nodes = f"\n{record.modelled_nodes} contact nodes of the {part} body"
        assert said.endswith(f"{nodes}, written to {out[1]}\n")
        assert ("\nwarning: [mesh] degree: elements of" in said) == ("mesh.degree=1" in changes)


@pytest.mark.once
@pytest.mark.one_rank
@pytest.mark.parametrize("name", sorted(path.name for path in DEMOS.glob("*.toml")))
def test_every_demo_scene_can_be_modelled(name: str) -> None:
    assert cli.main(["check", str(DEMOS / name)]) == 0


ALL = ["--out", "o", "--overwrite", "--workers", "3", "--shard", "2/5"]
SHARE, RESUME = (
    StudyOptions(True, False, None, DEMOS, (2, 5)),
    StudyOptions(False, True, None, DEMOS),
)
PARTS = ["--overwrite", "--system", "s.h5", "--pdf", "--error", "--starts", "4", "--workers", "3"]
WHOLE = RunOptions(
    True, system_file=Path("s.h5"), pdf=True, error=True, starts=4, workers=3,
    snapshots=False, all_pictures=True,
)  # fmt: skip


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("name", "words", "call"),
    [
        ("run", [*PARTS, "--pictures", "figures"], [WHOLE]),
        ("run", ["--pictures", "all"], [RunOptions(snapshots=True, all_pictures=True)]),
        ("run", ["--pictures", "none"], [RunOptions(pictures=False, snapshots=False)]),
        ("run", ["--resume", "--tolerance", "0.01"], [RunOptions(resume=True)]),
        ("sweep", [*ALL, "--over", "a.b=1,2"], [{"a.b": [1, 2]}, 3, SHARE]),
        ("sweep", ["--over", "a.b=1", "--resume"], [{"a.b": [1]}, None, RESUME]),
        ("shakedown", ALL, [3, SHARE]),
        ("wear", ["--overwrite"], [StudyOptions(True)]),
        ("wear", ["--resume"], [StudyOptions(resume=True)]),
        (
            "joint_curve",
            [*ALL, "--drive", "Q", "--from", "0.1", "--to", "0.4", "--count", "3"],
            ["Q", pytest.approx([0.1, 0.2, 0.4]), 3, SHARE],
        ),
        ("snapshot", ["--cycle", "3", "--leg", "1", "--at", "0.25"], [3, "1", 0.25]),
        ("animate", ["--cycle", "3", "--frames", "7", "--stress", "sxy"], [3, 7, "sxy"]),
        (
            "export",
            "--cycle 3 --leg 1 --at 0.5 --since 0.25 --overwrite".split(),
            [(3, "1", 0.5), 0.25, True],
        ),
    ],
)
def test_every_option_of_a_command_arrives_in_its_call(
    name: str, words: list[str], call: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []

    def note(*arguments: Any, **named: Any) -> None:
        seen.extend([*arguments, *named.values()])
        raise InputError("seen")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rf, name, note)
    of_folder = name in ("snapshot", "animate")
    out = [] if of_folder or "--out" in words else ["--out", "o"]
    source = "o" if of_folder else BLOCK
    assert cli.main([name.partition("_")[0], source, *words, *out]) == 2
    known = [x for x in seen if not (callable(x) or isinstance(x, rf.Scene | MPI.Comm))]
    known = [replace(x, progress=None) if hasattr(x, "progress") else x for x in known]
    assert "--tolerance" not in words or seen[0].accuracy.tolerance == 0.01
    places = [Path(BLOCK), Path("o")] if name == "export" else [Path("o")]
    assert [x for x in known if isinstance(x, Path)] == places
    assert [x for x in known if not isinstance(x, Path)] == call


def test_run_prints_a_table_and_no_progress_into_a_file(
    shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shared_tmp_path / "run"
    words = [*SMALL, "--pictures", "figures", "--resume", "--out", str(out)]
    assert cli.main(["run", BLOCK, *words]) == 0
    captured, told = capsys.readouterr(), f"{out}: nothing to resume, starting from rest\n"
    assert captured.err == f"receding-fenicsx: {told}" * root
    if root:
        for word in ("81 contact nodes", "stick half width", "dissipation", " MB", str(out)):
            assert word in captured.out
        assert len(captured.out.splitlines()) <= 10
        # all figures, and no picture of the body
        known = {name for name, _ in draw_all(rf.read_record(out / "record.h5"))}
        assert {path.stem for path in (out / "figures").iterdir()} == known
        assert not (out / "snapshots").exists()
    else:
        assert captured.out == ""


@pytest.mark.one_rank
def test_a_study_tells_where_its_table_is_or_who_writes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cases, path = cli.Cases(out=tmp_path, shard="1/3"), tmp_path / "sweep.csv"
    cases.show("rows", path.name)
    path.touch()
    cases.show("rows", path.name)
    share = f"share 1/3 is finished; the last one writes {path}"
    assert capsys.readouterr().out == f"rows\n{share}\nrows\nwritten to {path}\n"


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "receding-fenicsx: interrupted\n"),
        (InputError("a: b"), 2, "receding-fenicsx: error: a: b\n"),
        (SolveError("c\nd"), 1, "receding-fenicsx: error: c d\n"),
        (MemoryError(), 1, "receding-fenicsx: error: out of memory; use fewer contact_elements"),
        (rf.Interrupted("kept", 143), 143, "receding-fenicsx: kept\n"),
        (InputErrors("a: b", "c"), 2, f"{ERROR}a: b\n{ERROR}c\n"),
        *(
            (OSError(getattr(errno, name), "full", "f"), 1, f"{ERROR}f: cannot be written (full)\n")
            for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO")
        ),
        *(
            (OSError(getattr(errno, name), "no", "f"), 2, f"{ERROR}f: cannot be used (no)\n")
            for name in ("ENAMETOOLONG", "EACCES", "EPERM", "ENOTDIR", "ELOOP")
        ),
        (OSError(errno.EMFILE, "many", "f"), 1, "internal error: OSError: [Errno"),
        (BrokenPipeError(), 0, ""),
        (ModuleNotFoundError("No module 'g'"), 1, "receding-fenicsx: error: No module 'g'; see"),
        (ZeroDivisionError("o"), 1, "internal error: ZeroDivisionError: o"),
    ],
)
@pytest.mark.one_rank
def test_each_end_has_its_exit_code(
    error: BaseException,
    code: int,
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr(study, "check", broken)
    monkeypatch.setattr(sys, "stdout", sys.stdout)
    assert cli.main(["check", BLOCK]) == code
    told = capsys.readouterr().err
    internal = line.startswith("internal")  # shows where it comes from
    assert line in told if internal else told.startswith(line)
    lines = line.count("\n") or bool(line)
    assert told.count("\n") == lines or (internal and "Traceback" in told)


def test_doctor_lists_what_works(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", sys.executable)
    assert cli.main(["doctor"]) == 0
    out = capsys.readouterr().out
    if root:
        rows = dict(re.split("  +", line, maxsplit=1) for line in out.splitlines()[:-1])
        own = {"python": platform.python_version(), "receding_fenicsx": rf.__version__}
        own["C compiler"] = sys.executable  # that of the environment
        for name in "numpy scipy numba matplotlib pyvista vtk pillow imageio-ffmpeg loky".split():
            own[name] = metadata.version(name)
        assert {name: rows[name] for name in own} == own
        for name, words in {
            "dolfinx": r"0\.\d+", "petsc": r"3\.\d+\.\d+", "MUMPS": r"5\.[0-9.]+, works",
            "gmsh": r"4\.\d+", "h5py": r"3\.\d+", "BLAS": r".* 1 thread\(s\)",
            "off-screen rendering": "works", "mpirun": r"\S",
        }.items():  # fmt: skip
            assert re.match(words, rows[name]), rows[name]
        assert out.endswith("\nall requirements are met\n")
    else:
        assert out == ""


def test_doctor_says_what_is_missing_and_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    child = environment._child
    ends = {"mumps": "raise SystemExit(3)", "pyvista": "import os; os.abort()"}
    monkeypatch.setattr(
        environment, "_child", lambda text: child(next(ends[k] for k in ends if k in text))
    )
    monkeypatch.setitem(sys.modules, "gmsh", None)  # makes importing it fail
    which = environment.shutil.which
    monkeypatch.setattr(environment.shutil, "which", lambda k: None if "c" in k else which(k))
    assert cli.main(["doctor"]) == 1
    out = capsys.readouterr().out
    if root:
        lines = {line.split("  ")[0].strip(): line for line in out.splitlines()}
        for name, words in {
            "gmsh": ("MISSING", "pip install gmsh"),
            "C compiler": ("MISSING", "install gcc"),
            "MUMPS": ("MISSING", "exit code 3", "use a PETSc built with MUMPS"),
            "off-screen rendering": ("MISSING", "exit code -6", "apt install libosmesa6"),
        }.items():
            assert all(word in lines[name] for word in words), lines[name]
        assert "some requirements are missing" in out


def test_help_and_version_end_with_code_0(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, word in (
        (["--help"], "receding-fenicsx COMMAND"),
        (["joint", "--help"], "[default: 30]"),
        (["animate", "--help"], "choices:"),
        (["--version"], "."),
    ):
        assert cli.main(arguments) == 0
        said = capsys.readouterr()
        assert (word in said.out) == root and said.err == ""


@pytest.mark.one_rank
@pytest.mark.parametrize("command", [["export", "none.h5"], ["import", "none.toml"]])
def test_systems_are_exchanged_without_mpi(
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    assert cli.main([*command, "--out", str(tmp_path / "out")]) == 2
    assert "no such file" in capsys.readouterr().err


# -- as a program of its own, on one rank and more -----------------------------------------------


PROGRAMS = Path(__file__).parent / "programs"
FAILS_ALONE = (PROGRAMS / "fails_alone.txt").read_text()
"""A program of which one rank fails while the other goes on to a collective."""
MESHED = f"""rf.condense(rf.read_scene({BLOCK!r}, {SMALL[1::2]!r}), MPI.COMM_SELF)
        try: os.kill(os.getpid(), signal.SIGTERM)
        finally: print("rank 1: ends in order", file=sys.stderr, flush=True)"""
WAYS = {
    "command": f"study.check = work; sys.exit(cli.main(['check', {BLOCK!r}]))",
    "script": "work(None, MPI.COMM_WORLD)",
}


@pytest.mark.parametrize(
    ("way", "rank", "failure", "collective", "code"),
    [
        ("command", 0, "raise ValueError", "comm.Ibcast(bytearray(9)).Wait()", 1),
        ("command", 1, "raise ValueError", "rf.on_root(comm, comm.Barrier)", 1),
        ("command", 1, "raise rf.InputError", "comm.Barrier()", 2),
        ("command", 1, MESHED, "comm.bcast(1)", 143),
        ("script", 0, "raise rf.InputError", "rf.on_root(comm, lambda: None)", 2),
    ],
)
def test_rank_that_fails_alone_ends_the_job(
    way: str, rank: int, failure: str, collective: str, code: int, mpirun: Run, tmp_path: Path
) -> None:
    script = tmp_path / "alone.py"
    given = {"rank": rank, "failure": failure, "collective": collective}
    script.write_text(FAILS_ALONE.format(**given) + WAYS[way])
    done = mpirun(2, script, timeout=60)
    assert done.returncode == code
    assert "only here" in done.stderr
    assert done.stderr.count("rank 1: ") == rank


@pytest.mark.parametrize("way", WAYS)
def test_ranks_that_fail_together_do_not_abort_the_job(
    way: str, mpirun: Run, tmp_path: Path
) -> None:
    script = tmp_path / "together.py"
    given = {"rank": "comm.rank", "failure": "raise rf.InputError('wrong')", "collective": "pass"}
    script.write_text(FAILS_ALONE.format(**given) + WAYS[way])
    done = mpirun(2, script)
    assert done.returncode == (2 if way == "command" else 1)
    assert "mpi_abort" not in done.stderr.lower()
    assert done.stderr.count("receding-fenicsx: error: ") == (way == "command")


@pytest.mark.one_rank
def test_import_and_help_wait_for_no_library_and_set_threads_before_them() -> None:
    clean = {k: v for k, v in environment.child_environment().items() if "NUM_THREADS" not in k}
    done = subprocess.run(
        [sys.executable, "-c", (PROGRAMS / "prints_late_imports.txt").read_text()],
        env=clean | {"OMP_NUM_THREADS": "3"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout.splitlines()[-3:] == ["set()", "1 3", "set()"]


@pytest.mark.one_rank
def test_a_terminal_shows_stage_and_bar_and_erases_them(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with progress() as say:
        say("mesh [1]")
        Countdown(say, "frames:")(1, 4, "b, of many")
    shown = re.sub(r"\x1b\[[\d;?]*\w", "", screen.getvalue())
    assert " mesh [1]" in shown
    assert f" 0:00:00 {'━' * 4}╺{'━' * 11} frames: 1 of 4, b, about 0 s left" in shown  # 16 long
    assert screen.getvalue().endswith("\x1b[2K")  # erased
    with progress(verbose=1) as say:
        say("condense")
    assert "condense" not in screen.getvalue()  # the log tells of it


@pytest.mark.one_rank
def test_v_shows_the_log_and_v_twice_every_change_of_state() -> None:
    for verbose, level in enumerate(("WARNING", "INFO", "DEBUG", "DEBUG")):
        with progress(verbose):
            assert logging.getLevelName(logging.getLogger("receding_fenicsx").level) == level
