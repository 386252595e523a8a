"""Ranks that wait for rank 0, under a clock of the test's own."""

import pytest

from receding_fenicsx import mpi

pytestmark = pytest.mark.one_rank

LOOK = 1e-6
"""Seconds that a look takes."""


class Work:
    """Stands for the request that is complete when rank 0 has worked, and for the clock."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.now, self.looks = seconds, 0.0, 0

    def Test(self) -> bool:
        self.now += LOOK
        self.looks += 1
        return self.now >= self.seconds

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds


@pytest.mark.parametrize("seconds", [1e-5, 1e-3, 0.03, 1.0, 100.0])
def test_waiting_ranks_are_late_by_a_small_part_and_look_seldom(
    seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = Work(seconds)
    monkeypatch.setattr("receding_fenicsx.mpi.time.monotonic", lambda: work.now)
    monkeypatch.setattr("receding_fenicsx.mpi.time.sleep", work.sleep)
    mpi._wait_for_root(work)  # type: ignore[arg-type]
    late = work.now - seconds
    assert late <= min(mpi.POLL_SHARE * seconds, mpi.POLL_SECONDS) + LOOK
    # looks cost next to nothing beside a stage of a second
    assert work.looks <= 150 + seconds / mpi.POLL_SECONDS


def test_pauses_grow_with_the_time_waited_up_to_a_bound() -> None:
    pauses = [mpi.pause_after(waited) for waited in (0.0, 1e-4, 1e-2, 1.0, 1e4)]
    assert pauses[0] == 0.0
    assert pauses[1:3] == pytest.approx([1e-5, 1e-3])
    assert pauses[3] == pauses[4] == mpi.POLL_SECONDS
