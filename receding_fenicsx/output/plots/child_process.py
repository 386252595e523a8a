"""A separate Python process that answers requests: drawing beside the computation.

It is started afresh, never forked, and does not join the MPI job. It ends with its parent.
"""

from __future__ import annotations

import os
import pickle
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any

from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import RecedingError

NO_SIGNAL = getattr(socket, "MSG_NOSIGNAL", 0)
"""Flag that replaces SIGPIPE by an error: PETSc ends the job at this signal."""
CLOSE_SECONDS = 5.0
"""Time that a process has to end by itself."""


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS
        return os.cpu_count() or 1


class ChildProcess:
    """A process that answers requests in their order.

    Attributes:
        process: the process.
        connection: to its input and output.
        log: what its libraries print.
    """

    def __init__(self, target: str, variables: Mapping[str, str] | None = None) -> None:
        """Start the process, without waiting until it is ready.

        Args:
            target: ``module:function``, called in the process first; it returns the function that
                answers a request, with a function that sends answers as second argument.
            variables: environment variables of the process.
        """
        module, name = target.split(":")
        root = str(Path(__file__).resolve().parents[3])
        program = (
            f"import sys; sys.path.insert(0, {root!r}); "
            f"from {module} import {name}; from {__name__} import serve; serve({name})"
        )
        self.log: IO[bytes] = tempfile.TemporaryFile()
        self.connection, other = socket.socketpair()
        with other:
            self.process = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=other.fileno(),
                stdout=other.fileno(),
                stderr=self.log,
                env={**(variables or {}), **child_environment()},
            )
        self.answers = self.connection.makefile("rb")

    def ask(self, request: object) -> None:
        """Send a request.

        Raises:
            OSError: the process has ended.
        """
        self.connection.sendall(pickle.dumps(request), NO_SIGNAL)

    def answer(self, seconds: float | None = None) -> Any:
        """Wait for the next answer; end the process if there is none after some seconds.

        Raises:
            EOFError: the process has ended.
        """
        timer = threading.Timer(seconds or threading.TIMEOUT_MAX, self.process.kill)
        timer.daemon = True
        timer.start()
        try:
            return pickle.load(self.answers)
        except (OSError, pickle.UnpicklingError):
            raise EOFError from None
        finally:
            timer.cancel()

    def close(self, seconds: float = CLOSE_SECONDS) -> None:
        """End the process; after some seconds by force."""
        self._disconnect()
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()

    def kill(self) -> str:
        """End the process by force; return the last line that it wrote, or its exit status."""
        self._disconnect()
        self.process.kill()
        status = self.process.wait()
        self.log.seek(0)
        lines = self.log.read().decode(errors="replace").strip().splitlines()
        self.log.close()
        return lines[-1] if lines else f"the process ended with status {status}"

    def _disconnect(self) -> None:
        self.answers.close()
        self.connection.close()


Work = Callable[[Any, Callable[[Any], None]], None]
"""Function that answers a request; its second argument sends an answer."""


def serve(prepare: Callable[[], Work]) -> None:
    """Answer requests read from standard input until it ends; main program of the process."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with answers

    def send(answer: object) -> None:
        pickle.dump(answer, answers)
        answers.flush()

    requests = _read_requests()
    work = prepare()
    for request in requests:
        try:
            work(request, send)
        except BrokenPipeError:
            return
        except Exception as error:
            send(_picklable(error))


def _read_requests() -> Iterator[Any]:
    """Yield the requests; end the process at once when its parent has ended."""
    waiting: SimpleQueue[Any] = SimpleQueue()

    def read() -> None:
        while True:
            try:
                waiting.put(pickle.load(sys.stdin.buffer))
            except (EOFError, OSError, pickle.UnpicklingError):
                os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    while True:
        yield waiting.get()


def _picklable(error: Exception) -> Exception:
    """Return an error as it is if it belongs to the program or the system, else its text."""
    if isinstance(error, RecedingError | OSError):
        return error
    return RecedingError(f"{type(error).__name__}: {error}".splitlines()[0])
