import dataclasses
from pathlib import Path

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution import journal as journal_module
from receding_fenicsx.evolution.evolve import Progress, continue_history, evolve
from receding_fenicsx.evolution.journal import Journal, JournalFile
from receding_fenicsx.evolution.problem import problem_of_history
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem, eliminate_tangential
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

pytestmark = pytest.mark.one_rank

BLOCK = block_system(40, 20)
GAUSS_SEIDEL = SolverOptions(method="gauss-seidel", steps_per_leg=4)


@pytest.fixture(autouse=True)
def every_checkpoint_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "WRITING_SHARE", np.inf)


class Killed(BaseException):
    """Stands for what ends a process between two instructions."""


def equal(a: object, b: object, place: str = "record") -> None:
    """Fail unless two records are the same in every bit."""
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            equal(getattr(a, field.name), getattr(b, field.name), f"{place}.{field.name}")
    elif isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape, place
        assert a.tobytes() == b.tobytes(), place
    else:
        assert a == b, place


def play(
    system: ContactSystem,
    history: History,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
    *,
    journal: Journal,
    progress: Progress | None = None,
) -> Record:
    """Evolve a history from the end of a journal."""
    return continue_history(problem_of_history(system, history, solver, output), journal, progress)


def kill_after(cycle: int):  # type: ignore[no-untyped-def]
    def progress(number: int, cycles: int, message: str) -> None:
        if number == cycle:
            raise Killed

    return progress


def interrupted(
    path: Path,
    cycle: int,
    history: History,
    system: ContactSystem = BLOCK,
    solver: SolverOptions | None = None,
    every: int = 5,
) -> JournalFile:
    """Evolve until killed after a cycle; return the journal opened again."""
    with pytest.raises(Killed):
        journal = JournalFile(path, system, every)
        play(system, history, solver, progress=kill_after(cycle), journal=journal)
    journal.close()
    return JournalFile(path, system, every)


@pytest.mark.parametrize("solver", [SolverOptions(), GAUSS_SEIDEL], ids=lambda s: s.method)
def test_run_gone_on_with_has_samples_of_the_cycles_that_are_asked_for_then(
    tmp_path: Path, solver: SolverOptions
) -> None:
    wanted = OutputOptions(cycles=(0, 4, 9, 13))
    undisturbed = evolve(BLOCK, cyclic(14), solver, wanted)
    journal = interrupted(tmp_path / "journal", 10, cyclic(14), solver=solver)
    # of the finished cycles 0, 1, 2 and 9 were kept
    record = play(BLOCK, cyclic(14), solver, wanted, journal=journal)
    for table in ("samples", "events"):
        one, other = getattr(record, table), getattr(undisturbed, table)
        assert list(dict.fromkeys(one.cycle)) == [0, 4, 9, 13]
        np.testing.assert_array_equal(one.cycle, other.cycle)
    np.testing.assert_array_equal(record.samples.state, undisturbed.samples.state)
    for name in ("load", "P", "Q", "v", "w"):
        one, other = getattr(record.samples, name), getattr(undisturbed.samples, name)
        assert np.abs(one - other).max() <= 1e-11 * np.abs(other).max(), name
    # asking for them leaves no trace in the path
    equal(record.cycles, play(BLOCK, cyclic(14), solver, journal=Journal(5)).cycles)


@pytest.mark.parametrize(
    ("killed", "every", "cycles", "system", "solver"),
    [
        *((killed, 5, 24, BLOCK, None) for killed in (1, 5, 14, 23)),
        *((killed, 3, 8, block_system(16, 8), GAUSS_SEIDEL) for killed in (2, 7)),
        pytest.param(11, 5, 12, block_system(40, 20, poisson=0.4999), None, id="incompressible"),
        pytest.param(
            7, 5, 9, eliminate_tangential(block_system(16, 8, f=0.0)), None, id="normal form"
        ),
    ],
)
def test_run_gone_on_with_is_the_undisturbed_one_in_every_bit(
    tmp_path: Path,
    killed: int,
    every: int,
    cycles: int,
    system: ContactSystem,
    solver: SolverOptions | None,
) -> None:
    undisturbed = play(system, cyclic(cycles), solver, journal=Journal(every))
    journal = interrupted(tmp_path / "journal", killed, cyclic(cycles), system, solver, every)
    assert len(journal.cycles) == every * (killed // every) + 1
    equal(play(system, cyclic(cycles), solver, journal=journal), undisturbed)


def test_every_cut_leaves_the_checkpoints_before_it(tmp_path: Path) -> None:
    path, ends = tmp_path / "journal", []
    journal = JournalFile(path, BLOCK, 2)

    def note(number: int, cycles: int, message: str) -> None:
        journal.write()
        ends.append(path.stat().st_size)

    play(BLOCK, cyclic(6), journal=journal, progress=note)
    journal.close()
    whole = path.read_bytes()
    sizes = sorted(set(ends))
    assert len(sizes) == 4 and sizes[-1] == len(whole)  # after cycles 0, 2, 4 and 6
    random = np.random.default_rng(3)
    for cut in [0, 5, 31, *sizes, *random.integers(0, len(whole), 40).tolist()]:
        path.write_bytes(whole[:cut])
        opened = JournalFile(path, BLOCK, 2)
        kept = sum(cut >= size for size in sizes)
        assert len(opened.cycles) == max(0, 2 * kept - 1), cut
        opened.close()
        # what was cut off is gone from the file too
        assert path.stat().st_size == (sizes[kept - 1] if kept else 32)


def test_any_changed_bit_is_refused_or_leaves_the_checkpoints_before_it(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = interrupted(path, 11, cyclic(12))
    journal.close()
    whole, heads = path.read_bytes(), range(8 * 80)
    places = [*heads, *np.random.default_rng(5).integers(8 * len(whole), size=60).tolist()]
    for place in places:
        damaged = bytearray(whole)
        damaged[place // 8] ^= 1 << place % 8
        path.write_bytes(damaged)
        try:
            opened = JournalFile(path, BLOCK, 5)
        except InputError:
            assert place < 8 * 32, place  # in the title
            continue
        assert len(opened.cycles) < len(journal.cycles), place
        before, form = journal.cycles[: len(opened.cycles)], journal._format
        assert not before or form.pack(opened.cycles) == form.pack(before)
        opened.close()


def test_file_of_another_system_or_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    JournalFile(path, BLOCK, 5).close()
    for system in (block_system(16, 8), small_system(np.eye(2), {"a": [0, 1]}, 0.3)):
        with pytest.raises(InputError, match="another system"):
            JournalFile(path, system, 5)
    path.write_bytes(b"something else" * 10)
    with pytest.raises(InputError, match="another system"):
        JournalFile(path, BLOCK, 5)
    with pytest.raises(InputError, match="cannot be written"):
        JournalFile(tmp_path / "none" / "journal", BLOCK, 5)
