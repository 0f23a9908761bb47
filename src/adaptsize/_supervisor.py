"""The processes between a caller and a mesh generator.

The supervisor starts the job as a child of its own.  It ends everything that the job has started
when the job ends, or when the caller ends or closes the pipe to it.  The caller cannot do that
itself when it is killed.

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
from functools import partial
from pathlib import Path

from adaptsize._isolated import isolated

#: Numbers of <sys/prctl.h>.
_SET_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36
#: Processes that the system cannot end within this time are left to it.
_PATIENCE = 5.0


def supervised(folder: Path) -> list[str]:
    """Return the command of a supervisor whose job is in a folder."""
    return isolated(_SUPERVISE, os.getpid(), folder)


def supervise(caller: int, folder: str) -> int:
    """Run a job in ``folder``; return its exit code.

    The caller sends a line with the command and the limit of processor time in seconds.
    """
    _prctl(_SET_CHILD_SUBREAPER, 1)
    line = sys.stdin.buffer.readline()
    if not line:
        _end_everything(None, folder)
    command, seconds = json.loads(line)
    prepare = partial(_prepare_job, os.getpid(), seconds)
    job = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=None if sys.platform == "win32" else prepare,  # noqa: PLW1509  (no thread yet)
    )
    ending = threading.Lock()  # whoever gets it first ends the job, and this process
    threading.Thread(target=_end_with, args=(caller, job, folder, ending), daemon=True).start()
    code = job.wait()
    ending.acquire()
    _kill_all(job)
    return code


def _prepare_job(supervisor: int, seconds: float) -> None:
    """Make this process die with the supervisor, or after so many seconds of processor time."""
    _prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != supervisor:  # it died before
        os._exit(1)
    limit_processor_time(seconds)


def limit_processor_time(seconds: float) -> None:
    """Have the system end this process after so many more seconds of processor time.

    Windows has no such limit.
    """
    if seconds == math.inf or sys.platform == "win32":
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    limit = math.ceil(time.process_time() + seconds)
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


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
    _end_everything(job, folder)


def _end_everything(job: "subprocess.Popen[bytes] | None", folder: str) -> None:
    if job is not None:
        _kill_all(job)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _kill_all(job: "subprocess.Popen[bytes]") -> None:
    """Kill the job and all processes that it started.  SIGKILL: hung generators ignore others."""
    until = time.monotonic() + _PATIENCE
    if sys.platform != "linux":
        job.kill()
        if sys.platform != "win32":
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(job.pid, signal.SIGKILL)
        return
    # Orphans become children of this process.  When it has none left, all have ended.
    while time.monotonic() < until:
        for pid in _descendants(os.getpid()):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(0.005)


def _descendants(ancestor: int) -> set[int]:
    """Return the children of a process, their children, and so on."""
    parent = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # the process may have ended meanwhile
            # The name of the program, in parentheses, may contain any characters.
            words = stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            parent[int(stat.parent.name)] = int(words[1])
    found = {ancestor}
    grown = True
    while grown:
        children = {number for number, above in parent.items() if above in found} - found
        found |= children
        grown = bool(children)
    return found - {ancestor}


def exit_like(code: int) -> None:
    """Exit with the code of a process, or die from the signal that it died from."""
    sys.stdout.flush()
    if code < 0 and sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # some signals have no handlers
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    # Exit without cleanup: some generators crash in their exit handlers.
    os._exit(code)


_SUPERVISE = f"""
from {__name__} import exit_like, supervise
exit_like(supervise(int(sys.argv[1]), sys.argv[2]))
"""
