"""Process for work with gmsh that may end or crash it, one fork for each job.

The process loads its modules once and serves until this one ends, so that only the first job pays
for its start.
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


def in_fork(work: Callable[..., Any], *arguments: Any) -> tuple[Any, int]:
    """Return what a function returns in a fork, or its exception; and the exit code of the fork.

    Returns None where the fork ends before the function returns.
    """
    server = _servers.get(os.getpid())
    if server is None or server.poll() is not None:
        server = _started()
    assert server.stdin is not None and server.stdout is not None
    try:
        pickle.dump((os.getcwd(), work, arguments), server.stdin)
        server.stdin.flush()
        answer, code = pickle.load(server.stdout)
    except (EOFError, OSError):
        return None, _end()
    except BaseException:
        _end()
        raise
    return (pickle.loads(answer) if answer else None), code


def _started() -> subprocess.Popen[bytes]:
    """Start the process in a session of its own, which no Ctrl-C reaches."""
    inherited = child_environment()
    paths = [str(Path(__file__).parents[3]), inherited.get("PYTHONPATH", "")]
    server = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # forks want no threads
        env=inherited
        | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
        start_new_session=True,
    )
    _servers[os.getpid()] = server
    return server


@atexit.register
def _end() -> int:
    """End the process and its fork; return its exit code."""
    server = _servers.pop(os.getpid(), None)
    if server is None:
        return 0
    if server.poll() is None:
        os.killpg(server.pid, signal.SIGKILL)
    with server:
        return server.wait()


def serve() -> None:
    """Do the jobs that standard input holds, each in a fork; write the answers."""
    import gmsh  # noqa: F401 - once, not in each fork

    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # keep output of commands in a .geo file apart from the answers
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        begin, end = os.pipe()
        fork = os.fork()
        if fork == 0:
            with os.fdopen(end, "wb") as pipe:
                pipe.write(_answer(*job))
            os._exit(0)
        os.close(end)
        with os.fdopen(begin, "rb") as pipe:
            answer = pipe.read()
        _, status = os.waitpid(fork, 0)
        pickle.dump((answer, os.waitstatus_to_exitcode(status)), out)
        out.flush()


def _answer(folder: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return a pickle of what a function returns in a folder, or of its exception."""
    try:
        os.chdir(folder)
        return pickle.dumps(work(*arguments))
    except Exception as error:
        return pickle.dumps(error)
