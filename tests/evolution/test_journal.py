import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from models import block_system
from small import assert_same_bits, cyclic, small_system, table

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution import journal as journal_module
from receding_fenicsx.evolution.evolve import Progress, continue_history, evolve
from receding_fenicsx.evolution.journal import Journal, JournalFolder, packed
from receding_fenicsx.evolution.problem import problem_of_history
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem, eliminate_tangential
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

pytestmark = pytest.mark.one_rank

BLOCK = block_system(40, 20)
GAUSS_SEIDEL = SolverOptions(method="gauss-seidel", steps_per_leg=4)
STATIC = replace(GAUSS_SEIDEL, on_jump="static")


@pytest.fixture(autouse=True)
def every_checkpoint_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "WRITING_SHARE", np.inf)


class Killed(BaseException):
    """Stands for what ends a process between two instructions."""


def play(*parts: Any, journal: Journal, progress: Progress | None = None) -> Record:
    """Evolve a history, of a system with options, from the end of a journal."""
    return continue_history(problem_of_history(*parts), journal, progress)


def interrupted(
    path: Path,
    cycle: int,
    history: History,
    system: ContactSystem = BLOCK,
    solver: SolverOptions | None = None,
    every: int = 5,
) -> JournalFolder:
    """Evolve until killed after a cycle; return the journal opened again."""

    def progress(number: int, cycles: int, message: str) -> None:
        if number == cycle:
            raise Killed

    with pytest.raises(Killed):
        journal = JournalFolder(path, system, every)
        play(system, history, solver, progress=progress, journal=journal)
    return JournalFolder(path, system, every)


@pytest.mark.parametrize("solver", [SolverOptions(), GAUSS_SEIDEL], ids=lambda s: s.method)
def test_run_gone_on_with_has_samples_of_the_cycles_that_are_asked_for_then(
    tmp_path: Path, solver: SolverOptions
) -> None:
    wanted = OutputOptions(cycles=(0, 4, 9, 13))
    undisturbed = evolve(BLOCK, cyclic(14), solver, wanted)
    journal = interrupted(tmp_path / "journal", 10, cyclic(14), solver=solver)
    # of the finished cycles 0, 1, 2 and 9 were kept
    record = play(BLOCK, cyclic(14), solver, wanted, journal=journal)
    for part in ("samples", "events"):
        one, other = getattr(record, part), getattr(undisturbed, part)
        assert list(dict.fromkeys(one.cycle)) == [0, 4, 9, 13]
        np.testing.assert_array_equal(one.cycle, other.cycle)
    np.testing.assert_array_equal(record.samples.state, undisturbed.samples.state)
    for name in ("load", "P", "Q", "v", "w"):
        one, other = getattr(record.samples, name), getattr(undisturbed.samples, name)
        assert np.abs(one - other).max() <= 1e-11 * np.abs(other).max(), name
    # asking for them leaves no trace in the path
    assert_same_bits(record.cycles, play(BLOCK, cyclic(14), solver, journal=Journal(5)).cycles)


JUMPER = small_system([[2.0, 1.5], [1.5, 2.0]], {"a": [1.0, 1.0], "b": [0.0, -1.0]}, 2.0)
JUMPS = table(JUMPER, [[0, 0], [1, 0]], [[1, 0], [0.25, 1], [1, 0]], 5)
"""A node that jumps once, in cycle 1."""
FORKED = small_system([[1.0, 0.9], [0.9, 1.0]], {"a": [1.3, 1.0], "b": [0.0, 1.0]}, 1.5)
FORKS = table(FORKED, [[0, 0], [1, 0], [0, 1]], [[0, 1], [0, 0.5], [0, 1]], 4)
"""A node that has three answers to the first load."""


@pytest.mark.parametrize(
    ("killed", "every", "history", "system", "solver"),
    [
        *((killed, 5, cyclic(24), BLOCK, None) for killed in (1, 5, 14, 23)),
        *((killed, 3, cyclic(8), block_system(16, 8), GAUSS_SEIDEL) for killed in (2, 7)),
        (11, 5, cyclic(12), block_system(40, 20, poisson=0.4999), None),
        (7, 5, cyclic(9), eliminate_tangential(block_system(16, 8, f=0.0)), None),
        (5, 2, replace(cyclic(20), until_limit=True), block_system(12, 6), None),
        *((2, 1, JUMPS, JUMPER, solver) for solver in (STATIC, replace(STATIC, method="events"))),
        *((2, 1, FORKS, FORKED, solver) for solver in (None, SolverOptions(branch=2))),
    ],
)
def test_run_gone_on_with_is_the_undisturbed_one_in_every_bit(
    tmp_path: Path,
    killed: int,
    every: int,
    history: History,
    system: ContactSystem,
    solver: SolverOptions | None,
) -> None:
    undisturbed = play(system, history, solver, journal=Journal(every))
    journal = interrupted(tmp_path / "journal", killed, history, system, solver, every)
    assert len(journal.cycles) == every * (killed // every) + 1
    # a file that a kill left half written is none
    (tmp_path / "journal" / ".9.npz.tmp").write_bytes(b"half")
    journal = JournalFolder(tmp_path / "journal", system, every)
    assert not list((tmp_path / "journal").glob(".*"))
    assert_same_bits(play(system, history, solver, journal=journal), undisturbed)
    # of these the totals and doubts are not those of an unjudged beginning
    unique = undisturbed.uniqueness
    assert unique is not None and undisturbed.jumps == (system is JUMPER)
    assert len(undisturbed.choices) == (system is FORKED and solver is not None)
    small = system is JUMPER or system is FORKED
    assert unique.certified == (not small and solver is None)


def test_any_changed_bit_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = interrupted(path, 11, cyclic(12))
    files, before = sorted(path.iterdir()), packed(journal.cycles, BLOCK).items()
    assert [file.name for file in files] == ["0.npz", "1.npz", "6.npz"]
    for seed, file in enumerate(files):
        whole = file.read_bytes()
        for place in np.random.default_rng(seed).integers(8 * len(whole), size=60).tolist():
            damaged = bytearray(whole)
            damaged[place // 8] ^= 1 << place % 8
            file.write_bytes(damaged)
            with suppress(InputError):
                opened = packed(JournalFolder(path, BLOCK, 5).cycles, BLOCK)
                assert all(table.tobytes() == opened[name].tobytes() for name, table in before)
        for cut in (0, 100, len(whole) // 2, len(whole) - 1):
            file.write_bytes(whole[:cut])
            with pytest.raises(InputError, match=f"^{file}: is damaged"):
                JournalFolder(path, BLOCK, 5)
        file.write_bytes(whole)
    files[1].unlink()
    assert len(JournalFolder(path, BLOCK, 5).cycles) == 1


def test_folder_of_another_system_or_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    interrupted(path, 6, cyclic(8))
    for system in (block_system(16, 8), small_system(np.eye(2), {"a": [0, 1]}, 0.3)):
        with pytest.raises(InputError, match=rf"^{path}/0\.npz: .* \(of another system\); remove"):
            JournalFolder(path, system, 5)
    with np.load(path / "0.npz") as file:
        tables = dict(file)
    without = re.sub('"jumps": [0-9]+, ', "", str(tables["about"]))
    np.savez(path / "0.npz", **tables | {"about": np.array(without)})
    with pytest.raises(InputError, match=rf"^{path}/0\.npz: .* \(of another version\); remove"):
        JournalFolder(path, BLOCK, 5)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=f"{tmp_path}/file.*cannot be written"):
        JournalFolder(tmp_path / "file" / "journal", BLOCK, 5)
    (tmp_path / "rights" / "0.npz").mkdir(parents=True)
    unread = rf"^{tmp_path}/rights/0\.npz: cannot be read \(Is a directory\); check its rights$"
    with pytest.raises(InputError, match=unread):
        JournalFolder(tmp_path / "rights", BLOCK, 5)
