"""Child processes: isolated, limited, and ended with all that they have started.

An isolated child (``python -I``) imports nothing from the working folder, which may come from
others.  Generators and readers of other packages crash, hang, print, and ignore signals.

A supervisor (`adaptsize._supervisor`) stands between a caller and a program that may start others.
"""

import contextlib
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from adaptsize import _supervisor
from adaptsize._supervisor import SIGNALLED

#: Holds the folders from which an isolated child imports.  It ignores PYTHONPATH.
_PATH = "ADAPTSIZE_PATH"
_HEAD = f"import os, sys; sys.path[:] = os.environ[{_PATH!r}].split(os.pathsep)\n"


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


def ends_within(child: "subprocess.Popen[bytes]", seconds: float) -> bool:
    """Return whether a child ends within a time.

    On Linux this is noticed at once.  Otherwise Python looks every 50 ms, about as long as Mmg
    takes for 4000 triangles.
    """
    if sys.platform == "linux":
        try:
            file = os.pidfd_open(child.pid)
        except OSError:  # ended, or not supported by the system
            pass
        else:
            try:
                ended = select.poll()
                ended.register(file, select.POLLIN)
                ended.poll(1000.0 * seconds)
            finally:
                os.close(file)
            return child.poll() is not None
    try:
        child.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def supervised(folder: Path) -> list[str]:
    """Return the command of a supervisor whose job is in a folder, which it removes in the end.

    It waits for the job, see `job_line`.
    """
    # Without `site`, whose folders it does not need.  A module is compiled once.
    package, name = os.path.split(os.path.splitext(_supervisor.__file__)[0])
    program = f"import sys; sys.path.append(sys.argv.pop()); from {name} import main; main()"
    options = [sys.executable, "-I", "-S", "-u", "-c", program]
    return [*options, str(os.getpid()), str(folder), package]


def how_it_ended(code: int) -> str:
    """Return the name of the signal that ended a process, or ``exit code n``."""
    try:
        return signal.Signals(-code if code < 0 else code - SIGNALLED).name
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
