"""Work of rank 0 and of all ranks: results, and errors that reach every rank."""

from mpi4py import MPI

import pytest

import receding_fenicsx as rf
from receding_fenicsx import mpi

comm = MPI.COMM_WORLD


@pytest.mark.parametrize("failing", [{0}, {1}, {0, 1}])
def test_an_error_of_some_ranks_is_raised_on_all_by_its_own_words_or_the_lowest(
    failing: set[int],
) -> None:
    def work() -> int:
        if comm.rank in failing:
            raise rf.InputError(f"rank {comm.rank} fails")
        return comm.rank

    if min(failing) >= comm.size:
        assert rf.on_all(comm, work) == comm.rank
        return
    told = comm.rank if comm.rank in failing else min(failing)
    with pytest.raises(rf.InputError, match=f"rank {told} fails"):
        rf.on_all(comm, work)


def test_rank_0_alone_works_and_its_errors_are_those_of_all() -> None:
    worked: list[int] = []
    assert rf.on_root(comm, lambda: worked.append(7) or 3) == (3 if comm.rank == 0 else None)  # type: ignore[func-returns-value]
    assert worked == [7] * (comm.rank == 0)
    assert rf.on_root(None, lambda: 5) == 5  # a process without MPI

    def stopped() -> None:
        raise rf.Interrupted("kept", 143)

    with pytest.raises(rf.Interrupted, match="kept") as caught:
        rf.on_root(comm, stopped)
    assert caught.value.exit_code == 143


@pytest.mark.one_rank
def test_an_error_in_a_script_ends_the_job_by_its_code(monkeypatch: pytest.MonkeyPatch) -> None:
    ends: list[tuple[int, str]] = []
    monkeypatch.setattr(mpi.sys, "excepthook", lambda *_: None)
    monkeypatch.setattr(mpi, "leave", lambda _, code, text: ends.append((code, text)))
    mpi._set_hook.__wrapped__()
    for error in (ValueError("a"), rf.InputError("b"), rf.Interrupted("c", 143)):
        mpi.sys.excepthook(type(error), error, None)
    assert ends == [(1, "ValueError: a"), (2, "InputError: b"), (143, "Interrupted: c")]
