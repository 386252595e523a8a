"""Pictures of a run: drawn beside each other, errors of the processes, progress."""

import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest

import receding_fenicsx as rf
from receding_fenicsx import read_scene, workers
from receding_fenicsx.pictures import begin_figures
from receding_fenicsx.studies import run as study
from receding_fenicsx.timing import Countdown, Timer, duration

BLOCK = Path(__file__).parents[1] / "demos" / "block.toml"
SMALL = ["mesh.contact_elements=12", "history.cycles=1", "output.samples_per_leg=4"]
COMM = MPI.COMM_WORLD


def test_pictures_of_a_run_are_counted_and_those_in_pdf_are_the_figures(
    shared_tmp_path: Path,
) -> None:
    heard: list[str] = []
    scene = replace(read_scene(BLOCK, SMALL), history=rf.HistoryOptions("monotonic"))
    for pdf in (False, True):
        options = study.RunOptions(all_pictures=pdf, pdf=pdf, progress=heard.append)
        study.run(scene, shared_tmp_path / str(pdf), options, COMM)

    def compare() -> None:
        few, all_ = (
            {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.p*")}
            for folder in (shared_tmp_path / "False", shared_tmp_path / "True")
        )
        pages = {name for name in all_ if name.endswith(".pdf")}
        # PDF only where asked for, one for each figure
        assert not any(name.endswith(".pdf") for name in few)
        assert {f"{name[:-4]}.png" for name in pages} == {
            n for n in all_ if n.startswith("fig") and n not in pages
        }
        # a picture is the same beside few others and beside many
        assert few.items() < all_.items()
        for name, pictures, count in (("False", few, 1), ("True", all_, 2)):
            costs = rf.read_summary(shared_tmp_path / name / "summary.json")["timings"]
            assert costs["pictures"] > 0.0
            assert sum("snapshots" in name for name in pictures) == count
            assert any(h.startswith(f"pictures of the body: {count - 1} of {count}") for h in heard)

    rf.on_root(COMM, compare)


@pytest.mark.one_rank
@pytest.mark.parametrize("ends", [False, True])
def test_figures_are_drawn_beside_as_here_even_if_that_process_ends(
    ends: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = rf.run(read_scene(BLOCK, SMALL), comm=MPI.COMM_SELF)
    assert record is not None
    here = rf.figures.plot_all(record, tmp_path / "here", "png", everything=False)
    monkeypatch.delitem(sys.modules, "receding_fenicsx.output.plots.figures")
    process = workers.result("pictures", workers.submit("pictures", os.getpid))
    os.kill(process, signal.SIGSTOP)  # so that it is killed while it has the job
    finish = begin_figures(record, tmp_path / "beside", "png", False)
    assert not (tmp_path / "beside").exists()
    os.kill(process, signal.SIGKILL if ends else signal.SIGCONT)
    finish()
    for path in here:
        assert (tmp_path / "beside" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.one_rank
def test_countdown_tells_the_time_left_and_a_timer_the_time_spent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, ends = iter([0.0, 2.0, 6.0]), iter([1.0, 3.0, 10.0, 17.0])
    heard: list[Any] = []
    with monkeypatch.context() as patched:
        patched.setattr(time, "monotonic", lambda: next(clock))
        tell = Countdown(heard.append, "frames:")
        for done, name in enumerate(("a", "b", "c")):
            tell(done, 4, name)
        patched.setattr(time, "perf_counter", lambda: next(ends))
        timer = Timer()
        for _ in range(2):
            with timer("mesh"):
                pass
    # 2 s for the first frame, 6 s for two of them
    assert heard == [
        "frames: 0 of 4, a",
        "frames: 1 of 4, b, about 6 s left",
        "frames: 2 of 4, c, about 6 s left",
    ]
    assert [(step.done, step.total) for step in heard] == [(0, 4), (1, 4), (2, 4)]
    assert [*map(duration, (99.0, 101.0, 5900.0, 9000.0))] == ["99 s", "2 min", "98 min", "2.5 h"]
    assert timer.seconds["mesh"] == 2.0 + 7.0  # of a stage that comes twice
