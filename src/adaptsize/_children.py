"""Child processes: isolated, limited, and ended with all that they have started.

An isolated child (``python -I``) imports nothing from the working folder, which may come from
others.  Generators and readers of other packages crash, hang, print, and ignore signals.

A supervisor stands between a caller and a program that may start others.  It ends everything that
the program has started when the program ends, or when the caller ends or closes the pipe to it.
The caller cannot do that itself when it is killed.

Only small modules of Python are imported here, so that it is ready after a few hundredths of a
second.
"""

import contextlib
import json
import math
import os
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

#: Holds the folders from which an isolated child imports.  It ignores PYTHONPATH.
_PATH = "ADAPTSIZE_PATH"
_HEAD = f"import os, sys; sys.path[:] = os.environ[{_PATH!r}].split(os.pathsep)\n"
_SUPERVISE = f"from {__name__} import _supervise; _supervise(int(sys.argv[1]), sys.argv[2])"
#: Number of <sys/prctl.h>: orphans of descendants become children of this process.
_SET_CHILD_SUBREAPER = 36
#: Processes that the system cannot end within this time are left to it.
_PATIENCE = 5.0
#: A process that a signal has ended has this code and the number of the signal, as in a shell.
_SIGNALLED = 128


def isolated(program: str, *arguments: object) -> list[str]:
    """Return the command that runs a Python program with the `environment` of a child.

    Its output is not buffered, in the C library either: it may end without cleanup or by a signal.
    """
    return [sys.executable, "-I", "-u", "-c", _HEAD + program, *map(str, arguments)]


def environment() -> dict[str, str]:
    """Return the environment of a child that imports from the folders of this process.

    The working folder is not among them, even where this process imports from it, unless it holds
    this package.
    """
    try:
        here = os.getcwd()
    except OSError:  # it has been removed
        here = ""
    paths = {os.path.abspath(path): None for path in sys.path if path not in ("", here)}
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    return {**os.environ, _PATH: os.pathsep.join({**paths, package: None})}


def start(command: list[str], folder: str | Path, **streams: Any) -> "subprocess.Popen[bytes]":
    """Start a child in a folder, with a pipe to it.

    Ctrl-C in the terminal does not reach it: its parent receives it and ends the child.
    """
    own_group: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        own_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    env = environment()
    return subprocess.Popen(
        command, cwd=folder, env=env, stdin=subprocess.PIPE, **streams, **own_group
    )


def pipe_of(stream: IO[bytes] | None) -> IO[bytes]:
    """Return the end here of a pipe to a child that was started with it."""
    assert stream is not None, "the child was started with this pipe"
    return stream


def supervised(folder: Path) -> list[str]:
    """Return the command of a supervisor whose job is in a folder, which it removes in the end.

    It waits for a line with the job, see `job_line`.
    """
    return isolated(_SUPERVISE, os.getpid(), folder)


def job_line(command: list[str], seconds: float) -> bytes:
    """Return the line for a supervisor: a command, and its limit of processor time."""
    return json.dumps([command, seconds]).encode() + b"\n"


def how_it_ended(code: int) -> str:
    """Return the name of the signal that ended a process, or ``exit code n``."""
    try:
        return signal.Signals(-code if code < 0 else code - _SIGNALLED).name
    except ValueError:
        return f"exit code {code}"


@contextlib.contextmanager
def limits(seconds: float, memory: float = math.inf) -> Iterator[None]:
    """Limit further processor time of this process, and bytes, and those of what it starts.

    Windows has no such limits, and of memory only Linux.  Lower ones that are there are kept.
    """
    if sys.platform == "win32":
        yield
        return
    import resource

    until = time.process_time() + seconds
    wanted = {resource.RLIMIT_CORE: 0, resource.RLIMIT_CPU: until, resource.RLIMIT_DATA: memory}
    before = {kind: resource.getrlimit(kind) for kind, value in wanted.items() if value < math.inf}
    for kind, (_, hard) in before.items():
        value = math.ceil(wanted[kind])
        resource.setrlimit(
            kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard)
        )
    try:
        yield
    finally:
        for kind, values in before.items():
            resource.setrlimit(kind, values)


def _supervise(caller: int, folder: str) -> None:
    """Run a job in a folder, and exit like it."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    line = sys.stdin.buffer.readline()
    if not line:  # the caller has ended
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)
    command, seconds = json.loads(line)
    with limits(seconds):
        job = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
    ending = threading.Lock()  # whoever gets it first ends the job, and this process
    threading.Thread(target=_end_with, args=(caller, job, folder, ending), daemon=True).start()
    code = job.wait()
    ending.acquire()
    _kill_all(job)
    os._exit(code if code >= 0 else _SIGNALLED - code)


def _end_with(
    caller: int, job: "subprocess.Popen[bytes]", folder: str, ending: threading.Lock
) -> None:
    """Wait until the caller has ended or closed the pipe, and end everything."""
    if sys.platform == "win32":
        sys.stdin.buffer.read()
    else:  # another child of the caller may keep the pipe open
        while os.getppid() == caller and not select.select([0], [], [], 0.5)[0]:
            pass
    ending.acquire()
    _kill_all(job)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _kill_all(job: "subprocess.Popen[bytes]") -> None:
    """Kill the job and all processes that it started.  SIGKILL: hung generators ignore others."""
    until = time.monotonic() + _PATIENCE
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    if not children.exists():
        job.kill()
        if sys.platform != "win32":
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(job.pid, signal.SIGKILL)
        return
    # On Linux, orphans become children of this process.  When it has none left, all have ended.
    while time.monotonic() < until:
        for pid in map(int, children.read_text(encoding="ascii").split()):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(0.005)
