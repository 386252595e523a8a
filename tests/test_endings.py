"""How runs end that cannot go on: one line, the right code, nothing half-written."""

import itertools
import json
import os
import re
import shutil
import string
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

import receding_fenicsx as rf
from receding_fenicsx.cli import main
from receding_fenicsx.output.plots.labels import load_symbol, peak, shown_name
from receding_fenicsx.studies import run as study

comm = MPI.COMM_WORLD

SCENE = Path(__file__).with_name("endings.toml").read_text()


def write(path: Path, text: str | bytes) -> Path:
    """Write a file on rank 0 and let all ranks wait for it."""
    if comm.rank == 0:
        path.write_bytes(text.encode() if isinstance(text, str) else text)
    comm.barrier()
    return path


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Run the program on bad input; return its one line."""
    assert main([str(argument) for argument in arguments]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == (comm.rank == 0)
    return comm.bcast(err)


# -- numbers, names, places ----------------------------------------------------------------------


@pytest.mark.one_rank
@pytest.mark.parametrize(
    "program", ["import not_there", "import ctypes; ctypes.CDLL('libno.so.1')"]
)
def test_library_that_cannot_be_loaded_is_told_with_where_to_look(
    program: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "gmsh.py").write_text(program)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    assert main(["check", str(write(tmp_path / "scene.toml", SCENE))]) == 1
    (told,) = capsys.readouterr().err.splitlines()
    assert re.search("error: .*(not_there|libno.so.1).*; see receding-fenicsx doctor", told)


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("variable", "value", "code", "words"),
    [
        ("CC", "no-cc", 1, "forms cannot be compiled: .*no-cc.*; see receding-fenicsx doctor"),
        ("XDG_CACHE_HOME", "/dev/null", 2, "forms cannot be kept there .*; set XDG_CACHE_HOME"),
    ],
)
def test_forms_that_cannot_be_compiled_or_kept_are_told_in_one_line(
    tmp_path: Path, variable: str, value: str, code: int, words: str
) -> None:
    scene = write(tmp_path / "scene.toml", SCENE)
    done = subprocess.run(
        [sys.executable, "-m", "receding_fenicsx", "check", str(scene)],
        env=rf.child_environment() | {"XDG_CACHE_HOME": str(tmp_path), variable: value},
        capture_output=True,
        text=True,
    )
    (told,) = (x for x in done.stderr.splitlines() if not x.startswith("/bin/sh"))
    assert done.returncode == code and re.search(f"error: .*{words}", told), told


def test_marks_of_utf_8_at_the_start_of_files_are_passed_over(shared_tmp_path: Path) -> None:
    mark = b"\xef\xbb\xbf"
    text = SCENE + '[[contact]]\ninitial_gap = {file = "gap.csv"}\n'
    write(shared_tmp_path / "gap.csv", mark + b"-2, 0.5\n2, 0.25\n")
    found = rf.read_scene(write(shared_tmp_path / "marked.toml", mark + text.encode()))
    assert found == rf.read_scene(write(shared_tmp_path / "plain.toml", text))
    assert found.contacts[0].initial_gap == {"x": [-2.0, 2.0], "value": [0.5, 0.25]}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("scene.toml", b"\xff", "/scene.toml: is not a text file in UTF-8"),
        ("scene.toml", b"", "/scene.toml: is damaged (the scene is empty); use --overwrite"),
        ("journal/0.npz", bytes(500), "/journal/0.npz: is damaged"),
        ("journal", None, ": holds no run that can be resumed; choose another folder"),
        ("system.h5", b"", "/system.h5: is damaged"),
        ("system.h5", b"\x89HDF\r\n\x1a\n", "/system.h5: is damaged"),
        ("summary.json", b'{"turning_points": 3}', "/summary.json: is not a summary of a run"),
        ("summary.json", b"[1]", "/summary.json: is not a summary of a run; run the scene again"),
        ("summary.json", b"{", "/summary.json: is damaged or not a JSON file; run the scene again"),
    ],
)
@pytest.mark.one_rank
def test_damaged_run_is_not_resumed_and_leaves_nothing_beside_it(
    name: str,
    content: bytes | None,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    finished: Path,
) -> None:
    shutil.copytree(finished, tmp_path / "run")
    if content is None:
        shutil.rmtree(tmp_path / "run" / name)
    else:
        (tmp_path / "run" / name).write_bytes(content)
    more = ["--set", "history.cycles=9", "--resume", "--out", str(tmp_path / "run")]
    told = refused(capsys, "run", write(tmp_path / "scene.toml", SCENE), *more)
    assert f"{tmp_path / 'run'}{words}" in told
    assert sorted(os.listdir(tmp_path)) == ["run", "scene.toml"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished run of 4 cycles."""
    out, options = tmp_path_factory.mktemp("finished") / "run", study.RunOptions(pictures=False)
    study.run(rf.from_toml(SCENE, ["history.cycles=4"]), out, options, MPI.COMM_SELF)
    return out


@pytest.mark.one_rank
@pytest.mark.parametrize("option", ["--error", "--starts=3"])
def test_a_finished_run_is_not_gone_on_with_for_an_error_or_starts(
    option: str, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--set", "history.cycles=4", "--resume", option, "--out", str(finished)]
    told = refused(capsys, "run", write(tmp_path / "scene.toml", SCENE), *more)
    needs = f"the run is finished, {option.partition('=')[0]} needs a new one"
    assert told.endswith(f"error: {finished}: {needs}; give --overwrite, not --resume\n")


# -- a full disk ---------------------------------------------------------------------------------

FULL_DISK = (Path(__file__).parent / "programs" / "full_disk.txt").read_text()


@pytest.mark.one_rank
def test_full_disk_ends_in_one_line_and_the_run_can_be_gone_on_with(tmp_path: Path) -> None:
    scene, system = tmp_path / "scene.toml", tmp_path / "system.h5"
    scene.write_text(SCENE)
    assert main(["condense", str(scene), "--out", str(system)]) == 0
    # nothing is condensed, compiled or drawn in what follows
    command = ["run", str(scene), "--system", str(system), "--pictures", "none"]
    assert main([*command, "--out", str(tmp_path / "whole")]) == 0
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "whole").rglob("*.*")}
    assert sizes["system.h5"] < sizes["1.npz"] < sizes["record.h5"]
    limits = [*range(1000, sizes["record.h5"], sizes["record.h5"] // 12), sizes["record.h5"] - 1]
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path), json.dumps(limits), *command],
        capture_output=True,
        text=True,
        env=rf.child_environment(),
    )
    # HDF5's own clean-up at the interpreter's end used to crash
    assert done.returncode == 0, done.stderr
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    assert [code for _, code, _ in outcomes] == [1] * len(limits)
    lines = done.stderr.splitlines()
    assert len(lines) == len(limits)
    assert all("cannot be written (File too large); make room" in line for line in lines)
    for name in ("system.h5", ".npz", "record.h5"):
        assert any(f"{name}: cannot" in line for line in lines)
    for limit, _, left in outcomes:
        assert not (tmp_path / str(limit)).exists()
        assert {Path(name).suffix for name in left} <= {".h5", ".npz", ".toml"}
    assert not outcomes[0][2] and "0.npz" in outcomes[-1][2]
    again = [*command[:2], *command[4:], "--resume", "--out"]
    assert main([*again, str(tmp_path / str(limits[-1]))]) == 0
    one, two = (rf.read_record(tmp_path / out / "record.h5") for out in ("whole", str(limits[-1])))
    for key in ("v", "w", "P", "Q", "state"):
        assert np.array_equal(getattr(one.turning_points, key), getattr(two.turning_points, key))


@pytest.mark.one_rank
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no full device")
def test_output_into_a_full_file_is_an_error(tmp_path: Path) -> None:
    scene = write(tmp_path / "scene.toml", SCENE)
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "receding_fenicsx", "check", str(scene)]
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, env=rf.child_environment()
        )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "standard output: cannot be written (No space left on device)" in done.stderr


# -- names of loads in pictures and pages --------------------------------------------------------

COMMANDS = "\\$&{}_^"


@pytest.mark.one_rank
def test_every_name_of_a_load_can_be_drawn() -> None:
    parser = MathTextParser("agg")
    names = [a for a in string.printable if a.isprintable() and a != " "]
    names += ["".join(pair) for pair in itertools.product(COMMANDS, repeat=2)]
    names += ["\\mathrm{x}", "$a$", "p & q", "shear \\ bend", "a very long name of $"]
    for name in names:
        parser.parse(f"$p/{peak(load_symbol(name))}$")
        # as text beside mathematics it stays text
        text = f"{shown_name(name)} at $0.3$ of its largest"
        assert parser.parse(text) is not None
        assert text.count("$") - text.count("\\$") == 2
    # each letter is drawn as itself or its likeness; a prime is a zero of a font of symbols
    likeness = str.maketrans(
        {"#": "♯", "^": "∧", "~": "∼", "-": "−", "'": "0", "`": "0", '"': "00"}
    )
    for letter in names[: string.printable.index(" ")]:
        _, _, _, glyphs, _ = MathTextParser("path").parse(f"${load_symbol(f'x{letter}x')}$")
        shown = "".join(chr(glyph[2]) for glyph in glyphs)
        assert shown == f"x{letter}x".translate(likeness), letter
