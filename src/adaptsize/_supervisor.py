"""The supervisor of a job in a child process: a program of its own.

It ends everything that the job has started when the job ends, or when the caller ends or closes the
pipe to this process.  The caller cannot do that itself when it is killed.

    python -I -S -c "from _supervisor import main; main()" CALLER FOLDER

CALLER is the number of the process to be watched, and FOLDER is removed if it ends first.  The
command and its limit of processor time come through the pipe, see `job_line`.

The program runs for every mesh, so it imports next to nothing: it starts in a third of the time
that it takes with the modules `signal`, `subprocess` and `threading`.
"""

from __future__ import annotations

import os
import sys
import time
from _thread import LockType, allocate_lock, start_new_thread

TYPE_CHECKING = False
if TYPE_CHECKING:  # `typing` takes longer than the rest
    from typing import Any

#: Number of <sys/prctl.h>: orphans of descendants become children of this process.
_SET_CHILD_SUBREAPER = 36
#: Number of SIGKILL.  Hung generators ignore others.
_KILL = 9
#: Processes that the system cannot end within this time are left to it.
_PATIENCE = 5.0
#: A process that a signal has ended has this code and the number of the signal, as in a shell.
SIGNALLED = 128


def job_line(command: list[str], seconds: float) -> bytes:
    """Return what a supervisor reads: a command, and its limit of processor time."""
    body = b"\0".join(os.fsencode(word) for word in (repr(seconds), *command))
    return b"%d\n" % len(body) + body


def _read_job() -> tuple[list[str], float] | None:
    """Return the command and its limit, or None if the caller has ended."""
    line = sys.stdin.buffer.readline()
    body = sys.stdin.buffer.read(int(line)) if line.endswith(b"\n") else b""
    if not line or len(body) < int(line):
        return None
    seconds, *command = (os.fsdecode(word) for word in body.split(b"\0"))
    return command, float(seconds)


def supervise(caller: int, folder: str) -> None:
    """Run a job in a folder, and exit like it."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    found = _read_job()
    if found is None:
        _remove(folder)
        os._exit(1)
    job = _started(*found)
    ending = allocate_lock()  # whoever gets it first ends the job, and this process
    start_new_thread(_end_with, (caller, job, folder, ending))
    code = job.wait()
    ending.acquire()
    _kill_all(job)
    os._exit(code if code >= 0 else SIGNALLED - code)


class _Job:
    """A process, with the methods of `subprocess.Popen` that are needed here."""

    def __init__(self, number: int) -> None:
        self.number = number

    def wait(self) -> int:
        """Return the exit code, or that of the signal times -1."""
        try:
            return os.waitstatus_to_exitcode(os.waitpid(self.number, 0)[1])
        except ChildProcessError:  # the other thread has ended it, and will end this process
            return 1

    def kill(self) -> None:
        """Kill the process and its session."""
        for kill in (os.kill, os.killpg):
            try:  # noqa: SIM105 - importing contextlib takes as long as the rest
                kill(self.number, _KILL)
            except (ProcessLookupError, PermissionError):
                pass


def _started(command: list[str], seconds: float) -> Any:
    """Start the job, in a session of its own and without input."""
    if sys.platform == "win32":
        import subprocess

        return subprocess.Popen(command, stdin=subprocess.DEVNULL)
    number = os.fork()
    if not number:
        try:
            _become(command, seconds)
        except OSError as error:
            os.write(2, f"{command[0]}: {error.strerror}\n".encode())
        finally:
            os._exit(SIGNALLED - 1)
    return _Job(number)


def _become(command: list[str], seconds: float) -> None:
    """Replace this process by the job."""
    import resource
    from _signal import SIG_DFL, SIGPIPE, SIGXFSZ, signal  # type: ignore[import-not-found]

    os.setsid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number in (SIGPIPE, SIGXFSZ):  # Python ignores them, and so would the job
        signal(number, SIG_DFL)
    for kind, value in ((resource.RLIMIT_CORE, 0.0), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        least = min(value, float("inf") if hard == resource.RLIM_INFINITY else float(hard))
        if least < float("inf"):
            resource.setrlimit(kind, (int(least) + (least % 1.0 > 0.0), hard))
    os.execvp(command[0], command)


def _end_with(caller: int, job: Any, folder: str, ending: LockType) -> None:
    """Wait until the caller has ended or closed the pipe, and end everything."""
    if sys.platform == "win32":
        sys.stdin.buffer.read()
    else:  # another child of the caller may keep the pipe open
        import select

        while os.getppid() == caller and not select.select([0], [], [], 0.5)[0]:
            pass
    ending.acquire()
    _kill_all(job)
    _remove(folder)
    os._exit(1)


def _remove(folder: str) -> None:
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def _kill_all(job: Any) -> None:
    """Kill the job and all processes that it started."""
    until = time.monotonic() + _PATIENCE
    children = f"/proc/self/task/{os.getpid()}/children"
    if not os.path.exists(children):
        job.kill()
        return
    # On Linux, orphans become children of this process.  When it has none left, all have ended.
    while time.monotonic() < until:
        with open(children, encoding="ascii") as file:
            numbers = file.read().split()
        for number in numbers:
            try:  # noqa: SIM105
                os.kill(int(number), _KILL)
            except (ProcessLookupError, PermissionError):
                pass
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(0.005)


def main() -> None:
    """Supervise the job of a caller, see above."""
    supervise(int(sys.argv[1]), sys.argv[2])
