"""Run the cases of a study on one process or many; an interrupted study continues.

A study is ``cases -> measure -> combine``: a list of cases, each with a digest of all that its
outcome depends on and the arguments of ``measure``; this function, called in any process, which
returns a dictionary of JSON values (an error is the outcome of its case); and what rank 0 makes of
the outcomes. A new study is written as :func:`~receding_fenicsx.studies.sweep.sweep`: it passes
:func:`run_study` a :class:`Kind` and a :class:`Study`, whose ``combine`` calls
``runner.outcomes(cases, measure)``, also again with cases that depend on earlier outcomes.

The folder holds ``cases.jsonl``, a line for each finished case, and the file named by the kind,
which says what it is of: a study of another scene, or with other ``same``, does not continue it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import signal
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from receding_fenicsx import mpi, workers
from receding_fenicsx.atomic import make_folder, new_file, unwritable
from receding_fenicsx.environment import versions
from receding_fenicsx.errors import InputError, RecedingError, SolveError
from receding_fenicsx.scene.identity import difference, digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene, to_toml
from receding_fenicsx.store.run_folder import write_csv, write_summary
from receding_fenicsx.store.workspace import (
    CASES,
    Case,
    CaseFile,
    FolderKind,
    Outcome,
    locked,
    resumable,
)
from receding_fenicsx.timing import Countdown, Say

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")
Measure = Callable[..., Mapping[str, Any]]
"""Measures one case; called with its ``work``."""


@dataclass(frozen=True)
class StudyOptions:
    """Options of a study of many cases.

    Attributes:
        overwrite: replace an earlier study in the folder.
        resume: continue an earlier study of the same scene; its finished cases are kept, cases may
            have been added.
        executor: an executor of ``concurrent.futures`` that runs the cases, such as the
            ``MPIPoolExecutor`` of ``python -m mpi4py.futures``.
        folder: folder that paths of files among values are relative to; default: the working
            directory.
        shard: number of a share of the cases, from 1, and number of shares: other jobs run the
            others in the same folder, at the same time or later. The last one writes the results.
        progress: called on rank 0 with a text after every case.
    """

    overwrite: bool = False
    resume: bool = False
    executor: Executor | None = None
    folder: Path | None = None
    shard: tuple[int, int] | None = None
    progress: Say | None = None


@dataclass(frozen=True)
class Kind:
    """Kind of a study: its name, such as "sweep", and the files in its folder."""

    name: str
    file: str = ""  # says what the study is of
    results: tuple[str, ...] = ()  # are removed while cases are not finished
    shares: bool = True  # False: its cases depend on each other

    def check(self, out: str | Path | None, workers: int | None, options: StudyOptions) -> None:
        """Raise InputError on all ranks where a study cannot be run or written; collective."""
        comm = mpi.world()
        check_workers(workers, comm, options.executor)
        if options.shard is not None:
            number, shares = options.shard
            if not self.shares:
                raise InputError(
                    f"{self.name}: its cases depend on each other; leave the shard out"
                )
            if out is None or not 1 <= number <= shares:
                text = "needs 1 <= number <= count, and a folder"
                raise InputError(f"shard {number}/{shares}: {text}")
            if options.overwrite:
                raise InputError(
                    "--shard and --overwrite: shares use the folder together; omit one"
                )
        if out is not None:
            mpi.on_root(comm, lambda: self.continues(Path(out), options))

    def continues(self, path: Path, options: StudyOptions) -> bool:
        """Return whether a folder holds a study to continue; InputError: it may not be written."""
        resume = options.resume or options.shard is not None
        return self.folder.check(path, options.overwrite, resume) and resume

    @property
    def folder(self) -> FolderKind:
        """Kind of its folder."""
        marks = (self.file, *(name for name in self.results if name.endswith(".json")))
        return FolderKind(self.name, marks)


@dataclass(frozen=True)
class Study(Generic[T]):
    """A study of a scene."""

    scene: Scene | None  # None without one
    # runs cases by a :class:`Runner`, and makes the result of their outcomes
    combine: Callable[[Runner], T]
    # what must be the same where the study is continued, by its name in messages
    same: Mapping[str, Any] = field(default_factory=dict)
    content: Mapping[str, Any] = field(default_factory=dict)  # what else the file says


def run_study(
    kind: Kind,
    begin: Callable[[], Study[T]],
    out: str | Path | None = None,
    workers: int | None = None,
    options: StudyOptions = StudyOptions(),
) -> T | None:
    """Run a study; all ranks of an MPI job call this together, rank 0 hands out the cases.

    ``begin`` returns the study, called on rank 0 before anything is written; ``workers`` is the
    number of new processes of this machine that run the cases, None for this process.

    Returns:
        What the study has made of its outcomes on rank 0, None on the others.

    Raises:
        InputError: the folder holds another study, or the options contradict each other.
        Interrupted: a signal asked to end; the folder can be resumed.
    """
    kind.check(out, workers, options)

    def run(executor: Executor | None) -> T:
        study = begin()
        if out is None:
            return study.combine(Runner(kind, options, None, workers, executor))
        with (
            _opened(Path(out), kind, study, options) as file,
            resumable(Path(out), "between cases", "those that are finished"),
        ):
            runner = Runner(kind, options, file, workers, executor)
            result = study.combine(runner)
            if runner.complete:
                shutil.rmtree(Path(out) / SYSTEMS, ignore_errors=True)
            return result

    if options.executor is not None:
        return run(options.executor)
    return on_ranks(mpi.world(), run)


def check_workers(count: int | None, comm: MPI.Comm, executor: Executor | None = None) -> None:
    """Raise InputError for a wrong number of new processes."""
    if count is None:
        return
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 1024:
        raise InputError(f"workers = {count!r}: must be a whole number from 1 to 1024")
    if executor is not None or comm.size > 1:
        raise InputError(
            "workers: the cases are run by the ranks of the MPI job, or by the executor; leave "
            "workers out"
        )


def digest_of(*parts: Any) -> str:
    """Return the digest of values, arrays and dataclasses of such."""
    found = hashlib.sha256()
    for part in parts:
        if is_dataclass(part):  # without properties that were computed so far
            text = digest_of(*(getattr(part, each.name) for each in fields(part))).encode()
        elif isinstance(part, np.ndarray):
            text = repr((part.shape, part.dtype.str)).encode() + part.tobytes()
        else:
            text = repr(part).encode()
        found.update(b"%d:%s" % (len(text), text))
    return found.hexdigest()


def on_ranks(comm: MPI.Comm, work: Callable[[Executor | None], T]) -> T | None:
    """Call a function on rank 0, whose result it returns, with the other ranks as executor."""
    if comm.size == 1:
        return work(None)
    from mpi4py.futures import MPICommExecutor
    from petsc4py import PETSc  # noqa: F401 - its start is collective

    result: T | None = None
    error: BaseException | None = None
    kept = {}
    if comm.rank > 0:
        # rank 0 alone answers signals that ask to end: it withdraws the cases not begun
        with contextlib.suppress(ValueError):  # signals belong to the main thread
            for number in (signal.SIGINT, signal.SIGTERM):
                kept[number] = signal.signal(number, signal.SIG_IGN)
    try:
        with MPICommExecutor(comm, root=0) as executor:  # type: ignore[arg-type]
            if executor is not None:
                try:
                    result = work(executor)
                except BaseException as caught:
                    error = caught
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)

    def answer() -> T | None:
        if error is not None:
            raise error
        return result

    return mpi.on_root(comm, answer)


# -- cases in processes --------------------------------------------------------------------------


@dataclass
class Runner:
    """Runs cases, in the folder of a study or without one."""

    kind: Kind
    options: StudyOptions = StudyOptions()
    file: CaseFile | None = None  # of the finished cases
    workers: int | None = None
    executor: Executor | None = None
    complete: bool = True  # all cases so far are finished, in whatever share

    def __post_init__(self) -> None:
        """Read the finished cases; ``systems`` is for condensed systems until the last case."""
        self.folder = None if self.file is None else self.file.folder
        self.systems = None if self.folder is None else self.folder / SYSTEMS
        read = {} if self.file is None else self.file.read(final=True)
        # one that failed ends those that depend on it: it is tried again
        self.finished = {k: v for k, v in read.items() if self.kind.shares or not v.error}

    def outcomes(self, cases: Sequence[Case], measure: Measure) -> list[Outcome]:
        """Run the cases of this share that are not finished; return the outcomes of all."""
        finished = self.finished
        # cases of one body follow each other: a process keeps few condensed systems
        order = sorted(range(len(cases)), key=lambda number: cases[number].body)
        first, step = self.options.shard or (1, 1)
        share = order[first - 1 :: step]
        lacking = {k for k, c in enumerate(cases) if not c.error and c.identity not in finished}
        todo = {k: cases[k] for k in share if k in lacking}
        if lacking:
            self._remove_results()
        done, failed = len(share) - len(todo), 0
        tell = Countdown(self.options.progress, f"{self.kind.name}: case")
        play_all = ((number, play(case, measure)) for number, case in todo.items())
        if self.executor is not None or self.workers is not None:
            play_all = _elsewhere(todo, measure, self.workers, self.executor)
        with contextlib.closing(play_all) as played:
            for more, (number, outcome) in enumerate(played, 1):
                self._finish(cases[number], outcome)
                failed += bool(outcome.error)
                tell(done + more, len(share), f"{failed} failed")
        if self.file is not None and step > 1:
            finished = self.file.read() | finished
        missing = Outcome({}, "not finished, in another share", final=False)
        found = [
            Outcome({}, case.error) if case.error else finished.get(case.identity, missing)
            for case in cases
        ]
        self.complete = self.complete and all(outcome is not missing for outcome in found)
        return found

    def kept(self, case: Case, measure: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return the cells of a finished case, or measure it here; an error is raised, not kept."""
        if case.identity not in self.finished:
            self._remove_results()
            self._finish(case, Outcome(measure()))
        return self.finished[case.identity].cells

    def _remove_results(self) -> None:
        if self.folder is not None:
            for name in self.kind.results:
                (self.folder / name).unlink(missing_ok=True)

    def _finish(self, case: Case, outcome: Outcome) -> None:
        self.finished[case.identity] = outcome
        if self.file is not None:
            self.file.add(case, outcome)

    def write(self, files: Callable[[], Mapping[str, Any]]) -> None:
        """Write the results by their names, when all cases are finished.

        Contents are columns (.csv), a summary (.json), arrays (.npz), a figure (.png) or a text.
        """
        for name, content in files().items() if self.folder and self.complete else ():
            path = self.folder / name  # type: ignore[operator]
            if path.suffix == ".csv":
                write_csv(path, content, overwrite=True)
            elif path.suffix == ".json":
                write_summary(path, {**content, "versions": versions()}, overwrite=True)
            elif path.suffix == ".png":
                from receding_fenicsx.output.plots.style import save

                save(content, path)
            else:
                with new_file(path, overwrite=True) as beside, open(beside, "wb") as opened:
                    if path.suffix == ".npz":
                        np.savez_compressed(opened, **content)
                    else:
                        opened.write(content.encode())


def play(case: Case, measure: Measure) -> Outcome:
    """Measure one case; an error is its outcome."""
    try:
        return Outcome(dict(measure(*case.work)))
    except (InputError, SolveError) as error:
        return Outcome({}, str(error).replace("\n", " "))
    except Exception as error:
        text = f"{type(error).__name__}: {error}".replace("\n", " ")
        return Outcome({}, text, final=False)


def _elsewhere(
    cases: Mapping[int, Case], measure: Measure, count: int | None, executor: Executor | None
) -> Generator[tuple[int, Outcome], None, None]:
    """Run cases on an executor or on new processes; yield their numbers as they finish.

    When a new process dies, the cases begun are run again, each alone. Those not begun are
    withdrawn when the caller stops early.
    """
    waiting, alone = list(cases), list[int]()
    while waiting or alone:
        again = bool(alone)
        queue, most = (alone[:1], 1) if again else (waiting, min(count or len(cases), len(cases)))
        running: dict[Future[Outcome], int] = {}
        died: list[int] = []
        try:
            while running or (queue and not died):
                while queue and not died and len(running) < most:
                    number = queue.pop(0)
                    case = cases[number]
                    if executor is not None:
                        job = executor.submit(play, case, measure)
                    else:
                        job = workers.submit("study", play, case, measure, count=most, loud=True)
                    running[job] = number
                for job in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(job)
                    if executor is None and isinstance(job.exception(), BrokenExecutor):
                        died.append(number)
                    else:
                        yield number, job.result()
        except BrokenExecutor:
            raise RecedingError(
                "a process that ran a case was ended from outside; the finished cases are kept, "
                "continue by --resume"
            ) from None
        finally:
            for job in running:
                job.cancel()
            if executor is None:
                workers.end("study")
        if again:
            text = "its process was ended from outside, or crashed"
            yield from ((number, Outcome({}, text, final=False)) for number in died)
        alone = alone[1:] if again else died


# -- folder of finished cases --------------------------------------------------------------------

SYSTEMS = "systems"
"""Folder of the condensed systems."""


@contextlib.contextmanager
def _opened(path: Path, kind: Kind, study: Study[Any], options: StudyOptions) -> Iterator[CaseFile]:
    """Open the folder of a study, a new one or one to continue; yield its file of cases."""
    shard, scene = options.shard, study.scene
    content = {
        "format_version": 1,
        "title": "" if scene is None else scene.title,
        "same": dict(study.same),
        **study.content,
        "scene": "" if scene is None else to_toml(scene),
        "digest": "" if scene is None else digest(scene),
        "versions": versions(),
    }
    resume = options.resume or shard is not None
    if kind.continues(path, options):
        kind.folder.check_same(path, _other(path / kind.file, content, scene))
    make_folder(path)
    name = CASES if shard is None else f"cases.{shard[0]}-of-{shard[1]}.jsonl"
    try:
        with locked(path, shared=shard is not None):
            if not resume:
                for file in [*(path / name for name in kind.results), *path.glob("cases*.jsonl")]:
                    file.unlink(missing_ok=True)
                shutil.rmtree(path / SYSTEMS, ignore_errors=True)
            write_summary(path / kind.file, content, overwrite=True)
            with locked(path / name):
                yield CaseFile(path, name)
    except OSError as error:
        raise unwritable(path, error) from None


def _other(file: Path, content: Mapping[str, Any], scene: Scene | None) -> str | None:
    """Return what differs between a study and the one that a file is of; None where nothing."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        stored = known_scene(found["scene"]) if found["scene"] else None
        same, checksum = dict(found["same"]), found["digest"]
    except (OSError, ValueError, KeyError, TypeError, InputError):
        raise InputError(f"{file}: is damaged; start anew with --overwrite") from None
    if stored is None or scene is None:
        other = None if stored is scene else "scene"
    else:
        other = difference(stored, scene, frozenset({"title"}))
    if other is None and checksum != content["digest"]:
        other = "mesh file"
    own = json.loads(json.dumps(content["same"]))
    for name, value in same.items() if other is None else ():
        if own.get(name) != value:
            return f"{name}: it has {value}" if value else name
    return other
