"""Sweep of a scene over a grid of values, on one process, on many, or on the ranks of an MPI job.

table = rf.sweep(scene, {"contact.friction": [0.1, 0.2], "history.minimum": [0.0, 0.5]}, "out")
table["dissipation_last_cycle"], table.grid("steady"), table.to_pandas()
"""

from __future__ import annotations

import hashlib
import inspect
import pickle
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from receding_fenicsx import mpi
from receding_fenicsx.arrays import check_types
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.workspace import interruption
from receding_fenicsx.studies.sweep import processes
from receding_fenicsx.studies.sweep.cases import Case, grid_of
from receding_fenicsx.studies.sweep.folder import SweepFolder, SweepKind, sweep_folder
from receding_fenicsx.studies.sweep.table import ERROR, SweepTable
from receding_fenicsx.studies.sweep.worker import Measure, Outcome, Task
from receding_fenicsx.timing import Countdown

if TYPE_CHECKING:
    from mpi4py import MPI

MAX_WORKERS = 1024


@dataclass(frozen=True)
class SweepOptions:
    """Options of a sweep.

    Attributes:
        overwrite: replace an earlier sweep in the folder.
        resume: go on with an earlier sweep of the same scene over the same keys; its finished cases
            are kept, values may have been added.
        executor: an executor of ``concurrent.futures`` that plays the cases, such as the
            ``MPIPoolExecutor`` of ``python -m mpi4py.futures``.
        folder: folder that paths of files among the values are relative to; default: the working
            directory.
        shard: number of a share of the cases, from 1, and number of shares: other jobs play the
            others in the same folder, at the same time or later. The last one writes the table.
        progress: called on rank 0 with a text after every case.
    """

    overwrite: bool = False
    resume: bool = False
    executor: Executor | None = None
    folder: Path | None = None
    shard: tuple[int, int] | None = None
    progress: Callable[[str], None] | None = None


def sweep(
    scene: Scene,
    over: Mapping[str, Any],
    out: str | Path | None = None,
    workers: int | None = None,
    measure: Measure | None = None,
    options: SweepOptions = SweepOptions(),
) -> SweepTable | None:
    """Play a scene for every combination of values; all ranks of an MPI job call this together.

    Cases of the same body, mesh, contact edges, loads and supports share one condensed system. A
    case that fails is a row with its reason. Under ``mpirun -n R``, rank 0 hands out the cases and
    the others play them.

    Args:
        scene: the scene that is changed.
        over: values of each key "table.key" or "load.NAME.key": a list, or a dictionary of values
            by the names that the table shows.
        out: folder for ``sweep.csv``, ``sweep.json`` (what the sweep is of) and ``cases.jsonl``
            (finished cases, from which an interrupted sweep goes on). None writes nothing.
        workers: number of new processes of this machine that play the cases; default: this process.
        measure: function that takes a dictionary of numbers and texts from the record of a case;
            default: the headline numbers. For MPI and executors it must be a function of a module.
        options: further options.

    Returns:
        The table on rank 0, None on the others. Rows of other shares that are not finished say so.

    Raises:
        InputError: a key or a value cannot be used in any combination, the folder holds another
            sweep, or the options contradict each other. Nothing has been computed then.
        Interrupted: a signal asked to end; the folder can be resumed.
    """
    check_types(
        "sweep",
        scene=(scene, Scene),
        over=(over, Mapping),
        out=(out, str, Path, None),
        measure=(measure, Callable, None),
        options=(options, SweepOptions),
    )
    comm = mpi.world()
    alone = comm.size == 1 or options.executor is not None
    _check_workers(workers, measure, options, comm)
    if options.shard is not None:
        number, count = options.shard
        if out is None or not 1 <= number <= count:
            raise InputError(f"shard {number}/{count}: needs 1 <= number <= count, and a folder")

    def prepare() -> SweepKind:
        if scene.accuracy.tolerance is not None:
            raise InputError(
                "[accuracy] tolerance: a sweep solves all its cases on the scene's mesh; omit it"
            )
        return SweepKind(scene, grid_of(scene, over, options.folder), _identity(measure))

    if alone:
        return _swept(prepare(), out, measure, options, _player(workers, options.executor))
    return _on_ranks(comm, prepare, out, measure, options)


def _on_ranks(
    comm: MPI.Comm,
    prepare: Callable[[], SweepKind],
    out: str | Path | None,
    measure: Measure | None,
    options: SweepOptions,
) -> SweepTable | None:
    """Sweep on the ranks of an MPI job; errors of rank 0 are raised on all of them."""
    from mpi4py.futures import MPICommExecutor
    from petsc4py import PETSc  # noqa: F401 - its start is collective

    kind = mpi.on_root(comm, prepare)
    table: SweepTable | None = None
    error: BaseException | None = None
    executors = MPICommExecutor(comm, root=0)  # type: ignore[arg-type]
    with _signals_on_root_only(comm), executors as executor:
        if executor is not None:
            try:
                player = _player(None, executor)
                table = _swept(mpi.given(kind), out, measure, options, player)
            except BaseException as caught:
                error = caught

    def answer() -> SweepTable:
        if error is not None:
            raise error
        return mpi.given(table)

    return mpi.on_root(comm, answer)


@contextmanager
def _signals_on_root_only(comm: MPI.Comm) -> Iterator[None]:
    """Let rank 0 alone answer signals that ask to end: it withdraws the cases not begun."""
    kept = {}
    if comm.rank > 0:
        with suppress(ValueError):  # signals belong to the main thread
            for number in (signal.SIGINT, signal.SIGTERM):
                kept[number] = signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


Player = Callable[[Mapping[int, Task]], processes.Played]


def _player(workers: int | None, executor: Executor | None) -> Player:
    """Return the function that plays the cases."""
    if executor is not None:
        return lambda tasks: processes.on_executor(executor, tasks)
    if workers is not None:
        return lambda tasks: processes.on_processes(tasks, workers)
    return processes.in_this_process


def _swept(
    kind: SweepKind,
    out: str | Path | None,
    measure: Measure | None,
    options: SweepOptions,
    player: Player,
) -> SweepTable:
    """Play the cases that are not finished, and return the table."""
    cases = kind.grid.cases
    with ExitStack() as stack:
        folder = None
        finished: dict[str, Outcome] = {}
        if out is not None:
            replaces = options.overwrite, options.resume
            opened = sweep_folder(Path(out), kind, *replaces, options.shard)
            folder = stack.enter_context(opened)
            finished = folder.finished
        systems = None if folder is None else folder.systems
        # cases of one body follow each other: a process keeps few condensed systems
        order = sorted(range(len(cases)), key=lambda number: cases[number].body)
        first, step = options.shard or (1, 1)
        share = order[first - 1 :: step]
        tasks = {
            number: Task(scene, case.body, systems, measure, (*kind.grid.keys, ERROR))
            for number, case, scene in ((k, cases[k], cases[k].scene) for k in share)
            if scene is not None and case.identity not in finished
        }
        done = len(share) - len(tasks), len(share)
        _play(player(tasks), done, cases, folder, finished, options.progress)
        if folder is not None and step > 1:
            finished = folder.all() | finished
        rows = (_row(kind.grid.keys, case, finished) for case in cases)
        table = SweepTable(kind.grid.keys, kind.grid.labels, tuple(rows))
        if folder is not None and all(c.scene is None or c.identity in finished for c in cases):
            folder.publish(table)
    return table


def _play(
    played: processes.Played,
    done: tuple[int, int],
    cases: tuple[Case, ...],
    folder: SweepFolder | None,
    finished: dict[str, Outcome],
    progress: Callable[[str], None] | None,
) -> None:
    """Keep each of the cases that are played as it finishes; ``done`` of how many are finished."""
    failed, tell = 0, Countdown(progress, "sweep: case")
    try:
        with closing(played):
            for count, (number, outcome) in enumerate(played, 1):
                finished[cases[number].identity] = outcome
                if folder is not None:
                    folder.add(cases[number], outcome)
                failed += bool(outcome.error)
                tell(done[0] + count, done[1], f"{failed} failed")
    except (KeyboardInterrupt, SystemExit) as signalled:
        if folder is None:
            raise
        where = f"after {len(finished)} of {len(cases)} cases"
        raise interruption(signalled, where, folder.path, "them") from None


def _row(keys: tuple[str, ...], case: Case, finished: Mapping[str, Outcome]) -> dict[str, Any]:
    """Return the row of a case."""
    text = case.error if case.scene is None else "not finished, in another share"
    outcome = finished.get(case.identity, Outcome({}, text))
    return {**dict(zip(keys, case.labels, strict=True)), **outcome.cells, ERROR: outcome.error}


def _check_workers(
    workers: int | None, measure: Measure | None, options: SweepOptions, comm: MPI.Comm
) -> None:
    """Raise InputError for a wrong number of workers, or a function that cannot be sent to them."""
    if workers is not None:
        if isinstance(workers, bool) or not isinstance(workers, int):
            raise InputError(f"workers = {workers!r}: must be a whole number")
        if not 1 <= workers <= MAX_WORKERS:
            raise InputError(f"workers = {workers}: must be from 1 to {MAX_WORKERS}")
        if options.executor is not None or comm.size > 1:
            raise InputError(
                "workers: the cases are played by the ranks of the MPI job, or by the executor; "
                "leave workers out"
            )
    if measure is not None and (workers is not None or options.executor or comm.size > 1):
        import cloudpickle

        try:
            # new processes of this machine take functions of the main program too
            (pickle if workers is None else cloudpickle).dumps(measure)
        except Exception as error:
            raise InputError(
                f"measure: cannot be sent to another process ({error}); make it a function of a "
                "module, without open files"
            ) from None


def _identity(measure: Measure | None) -> str:
    """Return a text that changes with the function's name and program text."""
    if measure is None:
        return ""
    name = getattr(measure, "__qualname__", type(measure).__qualname__)
    try:
        text = inspect.getsource(measure)
    except (OSError, TypeError):
        return name
    return f"{name} {hashlib.sha256(text.encode()).hexdigest()[:16]}"
