"""Process for work with gmsh that may end or crash it.

The process loads its modules once and serves until this one ends, so that only the first job pays
for its start. After a job that fails the next one gets a new process.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from receding_fenicsx.environment import child_environment

PROGRAM = "from receding_fenicsx.bulk.mesh.gmsh_process import serve; serve()"
"""Program of the process."""

_servers: dict[int, subprocess.Popen[bytes]] = {}
"""The process that serves this one, by the number of this one, as forks need their own."""


def in_child(work: Callable[..., Any], *arguments: Any) -> tuple[Any, int]:
    """Return what a function returns in the process, or its exception; and 0.

    Returns None and the exit code of the process where it ends before the function returns.
    """
    server = _servers.get(os.getpid())
    if server is None or server.poll() is not None:
        server = _started()
    assert server.stdin is not None and server.stdout is not None
    try:
        pickle.dump((os.getcwd(), work, arguments), server.stdin)
        server.stdin.flush()
        answer = pickle.load(server.stdout)
    except (EOFError, OSError, pickle.UnpicklingError):  # the last one: ended in its answer
        server.wait()
        return None, _end()
    except BaseException:
        _end()
        raise
    if isinstance(answer, Exception):
        _end()
    return answer, 0


def _started() -> subprocess.Popen[bytes]:
    """Start the process in a session of its own, which no Ctrl-C reaches."""
    inherited = child_environment()
    paths = [str(Path(__file__).parents[3]), inherited.get("PYTHONPATH", "")]
    server = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=inherited
        | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
        start_new_session=True,
    )
    _servers[os.getpid()] = server
    return server


@atexit.register
def _end() -> int:
    """End the process and its children; return its exit code."""
    server = _servers.pop(os.getpid(), None)
    if server is None:
        return 0
    if server.poll() is None:
        os.killpg(server.pid, signal.SIGKILL)
    with server:
        return server.wait()


def serve() -> None:
    """Do the jobs that standard input holds; write the answers."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # keep output of commands in a .geo file apart from the answers
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        out.write(_answer(*job))
        out.flush()


def _answer(folder: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return a pickle of what a function returns in a folder, or of its exception."""
    try:
        os.chdir(folder)
        return pickle.dumps(work(*arguments))
    except Exception as error:
        return pickle.dumps(error)
