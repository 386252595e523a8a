"""Runs that are interrupted, killed and gone on with, as a whole: folders, ranks, signals."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from small import assert_same_bits

from receding_fenicsx import cli, environment
from receding_fenicsx.errors import Interrupted
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.store.hdf5 import read_record
from receding_fenicsx.store.run_folder import read_summary
from receding_fenicsx.studies import run as study

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
SMALL = ["mesh.contact_elements=24", "output.checkpoint_cycles=5"]
comm = MPI.COMM_WORLD


def small(*overrides: str) -> Scene:
    scene = read_scene(BLOCK, [*SMALL, *overrides])
    return replace(scene, history=replace(scene.history, until=None))


def stop_at(cycle: int) -> Callable[[str], None]:
    """Return a listener that interrupts once a cycle has been passed."""

    def say(text: str) -> None:
        if text.startswith(f"evolve: cycle {cycle} "):
            raise KeyboardInterrupt

    return say


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_interrupted_run_leaves_a_usable_record_and_goes_on_bitwise(
    shared_tmp_path: Path, method: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "receding_fenicsx")
    scene = small(f"solver.method={method}", "solver.steps_per_leg=4", "history.cycles=14")
    whole, out = shared_tmp_path / "whole", shared_tmp_path / "run"
    study.run(scene, whole, study.RunOptions(pictures=False), comm)
    with pytest.raises(Interrupted, match=r"after cycle 12 of 14.*run.part.*--resume") as caught:
        study.run(scene, out, study.RunOptions(pictures=False, progress=stop_at(12)), comm)
    assert caught.value.exit_code == 130
    comm.Barrier()
    part = shared_tmp_path / "run.part"
    assert sorted(os.listdir(shared_tmp_path)) == ["run.part", "whole"]
    if comm.rank == 0:
        record, undisturbed = read_record(part / "record.h5"), read_record(whole / "record.h5")
        np.testing.assert_array_equal(
            record.cycles.dissipation, undisturbed.cycles.dissipation[:12]
        )
        assert read_summary(part / "summary.json")["failure"] == "interrupted after cycle 12 of 14"
    comm.Barrier()
    heard: list[str] = []
    study.run(
        scene, out, study.RunOptions(pictures=False, resume=True, progress=heard.append), comm
    )
    comm.Barrier()
    assert sorted(os.listdir(shared_tmp_path)) == ["run", "whole"]
    if comm.rank == 0:
        # neither meshed nor condensed again, and only the cycles after the checkpoint
        assert "resumes from the checkpoint after cycle 10\n" in caplog.text
        assert not any(text.startswith(("mesh", "assemble", "condense")) for text in heard)
        assert [t.split()[2] for t in heard if "cycle" in t] == ["11", "12", "13", "14"]
        assert_same_bits(read_record(out / "record.h5"), undisturbed)
        told = read_summary(out / "summary.json")
        assert "failure" not in told
        assert told["uniqueness"] == read_summary(whole / "summary.json")["uniqueness"]
        assert told["uniqueness"]["margin"] > 1.0
    comm.Barrier()


@pytest.mark.one_rank
def test_a_signal_leaves_a_run_that_can_be_gone_on_with(tmp_path: Path) -> None:
    out, part = tmp_path / "run", tmp_path / "run.part"
    arguments = ["run", str(BLOCK), "--out", str(out), "--pictures", "none"]
    settings = ["mesh.contact_elements=40", "history.cycles=100000", "history.until=steady"]
    settings += ["solver.steady_tolerance=1e-16"]
    arguments += [part for setting in settings for part in ("--set", setting)]
    process = subprocess.Popen(
        [sys.executable, "-m", "receding_fenicsx", *arguments, "--verbose"],
        env=environment.child_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
        # a test run in the background is deaf to SIGINT, and its children would be
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        # logged cycle by cycle: byte by byte, so that nothing is read beyond
        assert any(b"cycle 3 of" in line for line in process.stderr)  # type: ignore[union-attr]
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == 130
    assert stdout == b""
    told = [x for x in stderr.decode().splitlines() if not re.match(r"\d\d:\d\d:\d\d ", x)]
    assert len(told) == 1, told
    assert "interrupted after cycle" in told[0] and f"{part} holds the record" in told[0]
    assert os.listdir(tmp_path) == ["run.part"]
    reached = len(read_record(part / "record.h5").cycles.dissipation)
    assert reached >= 3
    more = reached + 3
    assert cli.main([*arguments, "--resume", "--set", f"history.cycles={more}"]) == 0
    assert len(read_record(out / "record.h5").cycles.dissipation) == more
