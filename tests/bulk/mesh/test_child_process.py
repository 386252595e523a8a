import os
import signal
import time
from pathlib import Path

import pytest

from receding_fenicsx.bulk.mesh.gmsh_process import in_child


def test_the_process_answers_raises_or_ends_and_the_next_one_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, code = in_child(os.getpid)
    assert code == 0 and one != os.getpid() and in_child(os.getpid)[0] == one
    error, code = in_child(int, "no number")
    assert isinstance(error, ValueError) and code == 0
    # what has failed may have left something behind
    assert in_child(os.getpid)[0] != one
    assert in_child(os._exit, 3) == (None, 3)
    assert in_child(signal.raise_signal, signal.SIGSEGV) == (None, -signal.SIGSEGV)
    monkeypatch.chdir(tmp_path)
    assert in_child(os.getcwd)[0] == str(tmp_path)


def test_the_process_starts_again_after_it_was_killed() -> None:
    server = in_child(os.getpid)[0]
    os.kill(server, signal.SIGKILL)
    time.sleep(0.1)
    again, code = in_child(os.getpid)
    if again is None:  # it was still seen alive
        assert code == -signal.SIGKILL
        again, _ = in_child(os.getpid)
    assert again != server


def test_what_interrupts_waiting_ends_the_work() -> None:
    class Interrupted(Exception):
        pass

    def interrupt(*_: object) -> None:
        raise Interrupted

    server = in_child(os.getpid)[0]
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(Interrupted):
            in_child(time.sleep, 3600.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert in_child(os.getpid)[0] != server
