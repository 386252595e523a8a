"""What the documents tell to do works as it stands there: programs, commands, scripts, files."""

import contextlib
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cyclopts import MissingArgumentError
from drawn_text import REPORTS, check_words

import receding_fenicsx as rf
from receding_fenicsx import cli

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parent.parent
DOCUMENTS = (
    "README.md",
    "CONTRIBUTING.md",
    *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
)
NOTEBOOKS = sorted(f"docs/tutorials/{path.name}" for path in (ROOT / "docs/tutorials").glob("*.py"))
CHEAPER = {
    # plot draws the figures, snapshot the body
    "run": ["--set", "mesh.contact_elements=16", "--set", "history.cycles=9", "--pictures=none"],
    "condense": ["--set", "mesh.contact_elements=16"],
    "animate": ["--frames", "3"],
    "sweep": ["--set", "mesh.contact_elements=16", "--set", "history.cycles=2"],
}
"""What is added to a command, so that it takes a moment only."""
SCRIPTS = {
    "bash demos/run.sh frictionless_block": "order of convergence",
    "source .venv/bin/activate; receding-fenicsx doctor": "all requirements are met",
    "source .venv/bin/activate; python docs/build.py": "pages in results/site",
}
"""Lines of the documents that are run as they stand, and a part of what they say."""
once = pytest.mark.once


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def programs(name: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", text_of(name), re.S)


def scenes(name: str) -> list[str]:
    return re.findall(r"```toml\n(.*?)```", text_of(name), re.S)


def commands() -> list[list[str]]:
    """Return the words of each command that stands in a line of its own."""
    lines = [line for name in DOCUMENTS for line in text_of(name).splitlines()]
    code = re.findall(r"```.*?```", "\n".join(text_of(name) for name in DOCUMENTS), re.S)
    shown = [line for line in lines if line.startswith("    ") and line not in "\n".join(code)]
    return [shlex.split(line, comments=True) for line in shown]


@pytest.fixture
def beside_demos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder like the project's, for what the commands and programs write."""
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_program_in_the_readme_prints_what_it_says(
    beside_demos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (program,), (scene,) = programs("README.md"), scenes("README.md")
    (beside_demos / "block.toml").write_text(scene, encoding="utf-8")
    exec(compile(program, "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    (told,) = re.findall(r"```text\n(.*?)```", text_of("README.md"), re.S)
    # the last line is a residual, of round-off's size
    assert printed[:-1] == told.splitlines()[:-1]
    (residual, limit) = (lines.split()[-1] for lines in (printed[-1], told))
    assert float(residual) < 1e-12 and float(limit) < 1e-12
    for name in ("tractions.pdf", "zones.pdf"):
        assert (beside_demos / name).read_bytes().startswith(b"%PDF")


@once
def test_program_of_several_frictions_runs(
    beside_demos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (program,) = (text for text in programs("docs/usage.md") if "rf.condense" in text)
    exec(compile(program, "usage.md", "exec"), {})
    dissipation = [float(line.split()[1]) for line in capsys.readouterr().out.splitlines()]
    # the stronger the friction, the less slips: none of the three is that of another
    assert len(dissipation) == 3
    assert dissipation[0] > 1.5 * dissipation[1] > 1.5**2 * dissipation[2]


@once
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_run(beside_demos: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(rf.figures, "FIGURES", dict(rf.figures.FIGURES))  # one registers a figure
    exec(compile(text_of(name), name, "exec"), {"__name__": "__main__"})


BEFORE = {
    path.stem.partition("_")[2]: path.read_text()
    for path in Path(__file__).with_name("programs").glob("before_*.txt")
}
"""What a page's programs take for granted, on a coarse mesh."""


@once
@pytest.mark.parametrize("page", ["exchange", "grading", "joints", "shakedown", "uniqueness"])
def test_programs_of_a_how_to_page_run_one_after_another(beside_demos: Path, page: str) -> None:
    names: dict[str, object] = {"CHANGES": ["mesh.contact_elements=16"]}
    for program in [BEFORE.get(page, ""), *programs(f"docs/{page}.md")]:
        exec(compile(program, page, "exec"), names)


@once
@pytest.mark.parametrize("page", ["assemblies", "half_planes"])
def test_scene_of_a_how_to_page_is_valid(beside_demos: Path, page: str) -> None:
    (scene,) = scenes(f"docs/{page}.md")
    (beside_demos / "scene.toml").write_text(scene, encoding="utf-8")
    assert cli.main(["check", "scene.toml"]) == 0


@once
def test_keys_of_the_scenes_in_the_documents_are_known() -> None:
    # parts of scenes lack bodies and files; no key of them is unknown, and no value of a wrong kind
    parts = [part for name in DOCUMENTS if name != "docs/exchange.md" for part in scenes(name)]
    assert len(parts) > 12
    for part in parts:
        try:
            rf.from_toml(part)
        except rf.InputError as error:
            assert not re.search("unknown (key|table)|must be", str(error)), part


@once
def test_options_of_all_commands_in_the_documents_are_known() -> None:
    found = {
        line
        for name in (*DOCUMENTS, *NOTEBOOKS)
        for line in re.findall(
            r'receding-fenicsx ([a-z]+ [^`"\n]+)', text_of(name).replace("\\\n", "")
        )
    }
    assert len(found) > 20
    for line in found:
        words = shlex.split(line.partition(" > ")[0].replace("...", ""), comments=True)
        values = ["1/8" if "SLURM" in word else word for word in words]
        with contextlib.suppress(MissingArgumentError):
            cli.app.parse_args(values, exit_on_error=False, print_error=False)


def run_program(folder: Path, program: str) -> str:
    """Run a program in a process of its own, in a folder, and return what it prints."""
    (folder / "program.py").write_text(program, encoding="utf-8")
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    run = subprocess.run(
        [sys.executable, "program.py"],
        cwd=folder,
        env=rf.child_environment() | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.parametrize(
    "engine",
    [*(pytest.param(e, marks=once) for e in ("dask.distributed", "submitit")), "MPIPoolExecutor"],
)
def test_recipes_for_clusters_run_by_their_local_executors(
    beside_demos: Path, mpirun: Callable[..., Any], engine: str
) -> None:
    (program,) = (text for text in programs("docs/cluster.md") if engine in text)
    if engine == "MPIPoolExecutor":
        (beside_demos / "program.py").write_text(program, encoding="utf-8")
        done = mpirun(2, "-m", "mpi4py.futures", beside_demos / "program.py")
        assert done.returncode == 0, done.stderr
        printed = done.stdout
    else:
        pytest.importorskip(engine)
        printed = run_program(beside_demos, program)
    assert all(f"\n{friction}" in printed for friction in (0.2, 0.35, 0.5)), printed


def test_recipe_for_one_mpi_job_runs(beside_demos: Path, mpirun: Callable[..., Any]) -> None:
    (line,) = re.findall(r"^mpirun -n 3 receding-fenicsx (.*)$", text_of("docs/cluster.md"), re.M)
    done = mpirun(3, "-m", "receding_fenicsx", *shlex.split(line), *CHEAPER["sweep"])
    assert done.returncode == 0, done.stderr
    assert len((beside_demos / "results/mpi/sweep.csv").read_text().splitlines()) == 1 + 4


def test_a_body_condensed_out_of_core_is_the_same(beside_demos: Path) -> None:
    (options, command) = re.findall(
        r'^PETSC_OPTIONS="(.*)" MUMPS_OOC_TMPDIR=/scratch receding-fenicsx (.*)$',
        text_of("docs/cluster.md"),
        re.M,
    )[0]
    words = command.replace("SCENE", "demos/block.toml").split()
    words += CHEAPER["condense"]
    assert cli.main(words) == 0
    systems = [rf.read_system("FILE.h5")]
    subprocess.run(
        [sys.executable, "-m", "receding_fenicsx", *words, "--overwrite"],
        env=rf.child_environment()
        | {"PETSC_OPTIONS": options, "MUMPS_OOC_TMPDIR": str(beside_demos)},
        check=True,
    )
    systems.append(rf.read_system("FILE.h5"))
    np.testing.assert_allclose(systems[1].K, systems[0].K, atol=1e-13 * abs(systems[0].K).max())
    np.testing.assert_allclose(systems[1].r_star, systems[0].r_star, atol=1e-13)


@once
def test_recipe_for_snakemake_runs_by_its_local_executor(beside_demos: Path) -> None:
    pytest.importorskip("snakemake")
    (rules,) = re.findall(r"```text\n(rule .*?)```", text_of("docs/cluster.md"), re.S)
    coarse = rules.replace(" --pictures none", " --pictures none --set mesh.contact_elements=16")
    (beside_demos / "Snakefile").write_text(coarse, encoding="utf-8")
    run_program(
        beside_demos,
        "import os, sys\n"
        "os.environ['PATH'] = os.path.dirname(sys.executable) + os.pathsep + os.environ['PATH']\n"
        "os.execv(sys.executable, [sys.executable, '-m', 'snakemake', '--cores', '2'])\n",
    )
    found = (beside_demos / "results/flow").glob("*/summary.json")
    assert sorted(path.parent.name for path in found) == ["0.2", "0.5"]


@pytest.mark.parametrize("name", ["README.md", "docs/index.md"])
def test_first_scene_of_a_newcomer_runs_by_the_command_beside_it(
    beside_demos: Path, name: str
) -> None:
    (scene,) = scenes(name)
    (beside_demos / "block.toml").write_text(scene, encoding="utf-8")
    (line,) = re.findall(r"^receding-fenicsx (run .*)$", text_of(name), re.M)
    assert cli.main([*line.split(), *CHEAPER["run"]]) == 0
    assert (beside_demos / "results/mine/report.html").is_file()


@once
def test_array_jobs_of_a_sweep_write_its_table_together(beside_demos: Path) -> None:
    (script,) = re.findall(r"```sh\n(#!.*?)```", text_of("docs/cluster.md"), re.S)
    (jobs,) = re.findall(r"--array=1-(\d+)", script)
    line = script.replace("\\\n", "").splitlines()[-1]
    for job in range(int(jobs)):
        assert not (beside_demos / "results/map/sweep.csv").exists()
        words = shlex.split(line.replace("${SLURM_ARRAY_TASK_ID:-1}", str(job + 1)))
        assert cli.main([*words[1:], *CHEAPER["sweep"]]) == 0
    assert len((beside_demos / "results/map/sweep.csv").read_text().splitlines()) == 1 + 32


@once
def test_commands_of_the_documents_run(
    beside_demos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [words[1:] for words in commands() if words[0] == "receding-fenicsx"]
    found = []
    for words in asked:
        if words == ["doctor"]:
            continue
        assert cli.main([*words, *CHEAPER.get(words[0], [])]) == 0, " ".join(words)
        said = re.sub(r"[ \d.+-]*\d(e[-+]\d+)?", " #", capsys.readouterr().out)  # numbers, columns
        found += [f"$ {' '.join(words)}", *(" ".join(line.split()) for line in said.splitlines())]
    check_words(found, REPORTS / "commands.txt")
    mine = beside_demos / "results" / "mine"
    for name in ("report.html", "summary.json", "record.h5"):
        assert (mine / name).is_file()
    for kind in ("figures", "snapshots", "animations", "fields"):
        assert any((mine / kind).iterdir())
    (program,) = (text for text in programs("docs/usage.md") if "pyvista" in text)
    # in a process of its own: DOLFINx and VTK do not go well together
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=rf.child_environment()
    )
    assert "contact nodes" in done.stdout, done.stderr


@pytest.mark.parametrize(
    "line", [pytest.param(x, marks=once if "docs/build.py" in x else ()) for x in SCRIPTS]
)
def test_scripts_of_the_documents_run(tmp_path: Path, line: str) -> None:
    """In a folder of its own, by the environment of this interpreter."""
    prefix = Path(sys.prefix)
    if prefix.resolve().parent != ROOT.resolve():
        pytest.skip("this interpreter's environment is not one of the project's folder")
    if "docs/build.py" in line:
        pytest.importorskip("furo")
    root = shlex.quote(str(ROOT))
    placed = re.sub(r"(?<=\s)(demos|docs|\.venv)/", lambda m: f"{root}/{m[0]}", line)
    environment = rf.child_environment()
    environment["RECEDING_ENV"] = "pypi" if prefix.name == ".venv-pypi" else "debian"
    for name in ("PYTHONPATH", "VIRTUAL_ENV"):
        environment.pop(name, None)
    done = subprocess.run(
        ["bash", "-e", "-c", placed.replace("/.venv/", f"/{prefix.name}/")],
        cwd=tmp_path,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=800,
    )
    if done.returncode == 69:  # what the script needs cannot be installed here
        pytest.skip(done.stdout)
    assert done.returncode == 0 and SCRIPTS[line] in done.stdout, done.stdout
    for folder in re.findall(r"(?:written to|pages in) (results/\w+)", done.stdout):
        assert any((tmp_path / folder).iterdir())


@once
def test_no_line_for_the_shell_is_left_untried() -> None:
    lines = {" ".join(words) for words in commands() if words[0] != "receding-fenicsx"}
    activate, build = "source .venv/bin/activate", "python docs/build.py"
    setup, suite = "bash demos/run.sh --setup", "bash .ci/run"  # what runs this test
    some = {"bash tests/run.sh", "bash tests/run.sh tests/bulk/test_rings.py"}
    assert lines == {activate, build, setup, suite, "bash demos/run.sh"} | some


@once
def test_links_and_pictures_of_the_documents_exist() -> None:
    for name in (*DOCUMENTS, *NOTEBOOKS):
        code = r"^[^#\n].*" if name in NOTEBOOKS else r"(?s:```.*?```)"
        prose = re.sub(code, "", text_of(name), flags=re.M)
        for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", prose):
            if not link.startswith("http"):
                assert (ROOT / name).parent.joinpath(link).exists(), f"{name}: {link}"
