"""Pytest on one rank or many: all ranks see the same outcomes, rank 0 reports, nobody hangs.

After each phase of each test the ranks exchange their outcomes by a non-blocking collective on a
communicator of their own. What fails on one rank fails on every rank, so that they stay in step.
A rank that has failed waits for the others for ``rank_wait`` seconds only: if they do not come they
are held in a collective that will never be complete, so it prints its traceback and ends the job.
mpi-pytest hangs there under ``mpirun``, or starts MPI and DOLFINx anew for each test.
"""

from __future__ import annotations

import array
import contextlib
import faulthandler
import io
import os
import shutil
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, NoReturn

# Before NumPy loads, for those who call pytest themselves.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401 - PyPI's stack wants to be loaded before mpi4py

from mpi4py import MPI

import pytest
import pytest_timeout

POLL_SECONDS = 0.001
LAUNCHER_SECONDS = 0.5
"""A rank's pause before it ends the job: MPICH's launcher drops what it has not passed on yet."""
PASSED, FAILED = range(2)

HERE = Path(__file__).parent
SERIAL_FOLDERS = "half_plane", "interface", "reference"
"""Folders whose tests work on arrays, or compare whole runs with closed forms: on one rank only."""
ONCE_FOLDERS = "accuracy", "interface", "measures", "reference", "studies"
"""Folders whose tests use no more of other packages than the rest: all of them are ``once``."""
SHARE = os.environ.get("RECEDING_TESTS_SHARE", "")
"""Which part of the tests marked ``once`` is run, "0" or "1"; all of them without it."""

comm = MPI.COMM_WORLD.Dup()
stderr_stream = sys.__stderr__
"""Set to the terminal's own stream once pytest has configured its capture."""
failures: list[str] = []
"""Texts of the failures so far: an aborted session has no closing report."""


def say(text: str) -> None:
    """Write to the terminal's own error stream, whichever rank this is."""
    if stderr_stream is not None:
        stderr_stream.write(text)
        stderr_stream.flush()


def abort(reason: str) -> NoReturn:
    """Print the failures so far and the reason, and end the job on every rank."""
    text = "\n".join([*failures, f"aborted by rank {comm.rank}: {reason}"])
    say(f"\n{text}\n")
    sys.stdout.flush()
    time.sleep(LAUNCHER_SECONDS)
    comm.Abort(1)
    raise SystemExit(1)


def exchange(step: str, outcome: int, patience: float) -> list[int] | None:
    """Return the outcomes of all ranks in a step of the session, None if the others do not come.

    Numbers above FAILED are failures. A rank that has failed waits some seconds (``patience``); one
    that has not until the others come: pytest-timeout or another rank's patience ends that.
    """
    mine = array.array("q", [zlib.crc32(step.encode()), outcome])
    gathered = array.array("q", [0] * (2 * comm.size))
    request = comm.Iallgather([mine, MPI.INT64_T], [gathered, MPI.INT64_T])
    begin = time.monotonic()
    while not request.Test():
        if outcome >= FAILED and time.monotonic() - begin > patience:
            return None
        time.sleep(POLL_SECONDS)
    if len(set(gathered[::2])) > 1:
        say(f"\nthe ranks are out of step: rank {comm.rank} is at {step}\n")
        time.sleep(0.5)  # lets every rank say where it is
        abort("the ranks are out of step")
    return list(gathered[1::2])


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the patience of a failing rank."""
    parser.addini("rank_wait", "seconds that a failing rank waits for the others", default="5")


@pytest.hookimpl(trylast=True)  # after the terminal's own
def pytest_configure(config: pytest.Config) -> None:
    """Let rank 0 alone report, and let a rank that mpirun ends show where it was."""
    global stderr_stream
    if comm.size == 1:
        return
    stderr_stream = os.fdopen(os.dup(2), "w")
    pytest_timeout.dump_stacks = dump_stacks
    faulthandler.register(signal.SIGTERM, file=stderr_stream, chain=True)
    if comm.rank > 0:
        config.get_terminal_writer()._file = io.StringIO()


def dump_stacks(_: object) -> None:
    """Show where this rank is when its time has run out; the others do when mpirun ends them."""
    faulthandler.dump_traceback(stderr_stream or sys.stderr)
    time.sleep(LAUNCHER_SECONDS)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what one rank can show: its module is serial, or it or its module is ``one_rank``.

    Of two environments tried beside each other each takes a part of what is marked ``once``.
    In modules and folders of such tests ``one_rank(False)`` and ``once(False)`` mark the others.
    """
    room = item.path.relative_to(HERE).parts[0]

    def marked(name: str, folders: tuple[str, ...]) -> bool:
        mark = item.get_closest_marker(name)
        return room in folders if mark is None else mark.args != (False,)

    if comm.size > 1 and marked("one_rank", SERIAL_FOLDERS):
        pytest.skip("one process is enough")
    # the second environment, PyPI's packages, takes longer for the others
    part = "0" if zlib.crc32(item.nodeid.encode()) % 16 < 9 else "1"
    if marked("once", ONCE_FOLDERS) and SHARE not in ("", part):
        pytest.skip("the other environment tries it")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Remember what could not be collected."""
    if report.failed:
        failures.append(f"collecting {report.nodeid} on rank {comm.rank}:\n{report.longreprtext}")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Make the outcome of a test's phase the worst one of all ranks."""
    report = yield
    if comm.size > 1:
        agree(report, float(item.config.getini("rank_wait")))
    return report


def agree(report: pytest.TestReport, patience: float) -> None:
    """Exchange the outcome of a phase of a test: what fails on any rank fails on all of them."""
    failed = report.outcome == "failed"
    step = f"the {report.when} of {report.nodeid}"
    outcomes = exchange(step, FAILED if failed else PASSED, patience)
    if failed:
        failures.append(f"{report.nodeid} failed on rank {comm.rank}:\n{failure_text(report)}")
    if outcomes is None:
        abort(f"{step} failed here, and the other ranks did not come within {patience:g} s")
    if failed and comm.rank > 0:
        say(f"\n{failures[-1]}\n")
    elif FAILED in outcomes and not failed:
        report.outcome = "failed"
        report.longrepr = f"failed on rank {outcomes.index(FAILED)}, which says why above"
        if hasattr(report, "wasxfail"):
            del report.wasxfail


def failure_text(report: pytest.TestReport) -> str:
    """Return a report's traceback and what the test had printed."""
    captured = [f"--- {name}\n{text}" for name, text in report.sections if text]
    return "\n".join([report.longreprtext, *captured])


def pytest_internalerror(excrepr: object) -> None:
    """Show an error of pytest itself where the terminal would not."""
    if comm.rank > 0:
        say(f"\npytest failed on rank {comm.rank}:\n{excrepr}\n")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> Generator[None, None, None]:
    """End every rank with the same exit code, and no rank while others still test."""
    if comm.size > 1:
        patience = float(session.config.getini("rank_wait"))
        codes = exchange("the end of the session", int(exitstatus) * FAILED, patience)
        if codes is None:
            abort(f"pytest ended here with exit code {int(exitstatus)} while the others go on")
        session.exitstatus = max(codes) // FAILED
    yield


@pytest.fixture
def shared_tmp_path(tmp_path: Path) -> Path:
    """A temporary folder that is the same one on every rank."""
    return Path(comm.bcast(str(tmp_path)))


@pytest.fixture
def mpirun() -> Callable[..., Any]:
    """Run this interpreter under MPI: ``mpirun(2, "-m", "receding_fenicsx", "check", path)``.

    Further keywords go to ``subprocess.run``. Skips the test where it runs under MPI itself.
    """
    if comm.size > 1:
        pytest.skip("starts mpirun itself")
    # PyPI's MPI cannot be started by another one
    beside = Path(sys.executable).with_name("mpiexec")
    program = str(beside) if beside.exists() else shutil.which("mpirun.openmpi") or "mpirun"
    environment = outer_environment()

    def run(
        ranks: int, *arguments: str | Path, timeout: float = 300, **options: Any
    ) -> subprocess.CompletedProcess[str]:
        command = [program, "-n", str(ranks), sys.executable, *map(str, arguments)]
        options = {"env": environment, "capture_output": True, "text": True, **options}
        return subprocess.run(command, check=False, timeout=timeout, **options)

    return run


def outer_environment() -> dict[str, str]:
    """Return the environment without what MPI put into it for this very process."""
    inner = (
        *("PMIX_", "OMPI_COMM_", "OMPI_MCA_ess", "OMPI_MCA_orte", "OMPI_MCA_pmix", "OPAL_"),
        *("PMI_", "HYDI_", "MPI_LOCALNRANKS", "MPI_LOCALRANKID"),
    )
    environment = {k: v for k, v in os.environ.items() if not k.startswith(inner)}
    return environment | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
    }
