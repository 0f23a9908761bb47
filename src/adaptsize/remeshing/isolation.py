"""Mesh generators run in child processes.

A generator may crash the interpreter, hang for ever, ignore SIGTERM, take over
SIGINT, print, and write files into the working directory; all of that has been
seen.  So each call gets a fresh interpreter in a session of its own, in a
temporary directory, and is killed when time is up or the caller is interrupted.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from adaptsize.errors import BackendError, BackendTimeoutError

_WORKER = "adaptsize.remeshing._worker"
_POLL_SECONDS = 0.1
_LAST_LINES = 8
#: A child that prints more than this has run away.
_MAX_LOG_BYTES = 50_000_000


@dataclass(frozen=True)
class IsolatedRunner:
    """Runs functions of arrays in child processes until a common deadline.

    Attributes
    ----------
    backend : str
        Name for messages.
    timeout : float or None
        Seconds for all calls together, for messages.
    deadline : float or None
        The same as a reading of ``time.monotonic``.
    report : callable
        Called with a text and None again and again while the child works; what
        it raises stops the child.
    """

    backend: str
    timeout: float | None
    deadline: float | None
    report: Callable[[str, float | None], Any]

    def __call__(
        self,
        function: str,
        text: str,
        arrays: Mapping[str, npt.NDArray[Any]],
        options: Mapping[str, Any],
    ) -> dict[str, npt.NDArray[Any]]:
        """Call ``module:name`` with (arrays, options) in a child; return the arrays it returns.

        Raises
        ------
        BackendError
            If the child fails, with its last lines.
        BackendTimeoutError
            If it was stopped at the deadline.
        """
        # A child just killed may hold its files a little longer on Windows.
        with tempfile.TemporaryDirectory(
            prefix="adaptsize-", ignore_cleanup_errors=True
        ) as directory:
            folder = Path(directory)
            named: dict[str, Any] = dict(arrays)  # savez has keywords of its own
            np.savez(folder / "job.npz", **named)
            (folder / "job.json").write_text(
                json.dumps({"function": function, "options": dict(options)}), encoding="utf-8"
            )
            code = self._run_child(folder, text)
            result = folder / "result.npz"
            if code != 0 or not result.exists():
                self._fail(folder, code)
            with np.load(result, allow_pickle=False) as loaded:
                return {name: loaded[name] for name in loaded.files}

    def _run_child(self, folder: Path, text: str) -> int:
        with open(folder / "log.txt", "wb") as log:
            child = subprocess.Popen(
                [sys.executable, "-m", _WORKER],
                cwd=folder,
                env=_environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                **_own_group(),
            )
            try:
                self._wait(child, folder / "log.txt", text)
            finally:  # on an interrupt too, and for what the child may have started
                _kill_session(child)
            return child.wait()

    def _wait(self, child: subprocess.Popen[bytes], log: Path, text: str) -> None:
        while True:
            self.report(text, None)
            if _has_ended(child, _POLL_SECONDS):
                return
            if self.deadline is not None and time.monotonic() > self.deadline:
                raise BackendTimeoutError(
                    f"{self.backend} was stopped after the time limit of {self.timeout:g} s"
                )
            if log.stat().st_size > _MAX_LOG_BYTES:
                raise BackendError(f"{self.backend} was stopped: it printed without end")

    def _fail(self, folder: Path, code: int) -> NoReturn:
        error = folder / "error.txt"
        if error.exists():  # an exception of Python's own
            reason = error.read_text(encoding="utf-8")
        elif -code == getattr(signal, "SIGKILL", None):
            reason = "it was killed from outside (SIGKILL), perhaps because memory ran out"
        elif code < 0:
            reason = f"crashed ({_signal_name(-code)})"
        else:
            reason = f"ended with exit code {code} and no result"
        with open(folder / "log.txt", "rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - 4000))
            tail = log.read().decode("utf-8", "replace")
        lines = [line.strip() for line in tail.splitlines() if line.strip()][-_LAST_LINES:]
        said = f"; its last lines: {' | '.join(lines)}" if lines else ""
        raise BackendError(f"{self.backend} failed: {reason}{said}")


def _environment() -> dict[str, str]:
    """Return the environment of a child that is to import what this process can import."""
    paths = [os.path.abspath(path) for path in sys.path]  # "" is the working directory
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONFAULTHANDLER": ""}


def _own_group() -> dict[str, Any]:
    """Keep Ctrl-C of the terminal from the child: its parent gets it and kills the child."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}


def _has_ended(child: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait for the child to end; it is not reaped where the system allows that.

    Until it is reaped, its number is that of its process group and of no other process.
    """
    if not hasattr(os, "waitid"):  # Windows, older macOS
        try:
            child.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True
    until = time.monotonic() + seconds
    pause = 0.001
    while True:
        if child.returncode is not None or os.waitid(
            os.P_PID, child.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG
        ):
            return True
        if time.monotonic() >= until:
            return False
        time.sleep(pause)
        pause = min(2.0 * pause, 0.05)


def _kill_session(child: subprocess.Popen[bytes]) -> None:
    """Kill the child and, where the system tells them, all processes that it started.

    With SIGKILL, as hung generators ignore everything else.  The child may have ended before
    those.
    """
    if sys.platform != "win32":
        others = _started_by(child.pid)
        # The group may be gone by now (macOS says EPERM of a zombie).
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
        for pid in others:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
    if child.poll() is None:
        child.kill()
        child.wait()


def _started_by(pid: int) -> list[int]:
    """Return the processes in the session of a process, and its descendants (Linux only).

    A session holds those that have a process group of their own, too; descendants are those
    that have even left the session, as long as their parents live.
    """
    parent, session = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # gone meanwhile
            # The name of the program, in brackets, may hold anything.
            words = stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            number = int(stat.parent.name)
            parent[number], session[number] = int(words[1]), int(words[3])
    found = {number for number, leader in session.items() if leader == pid} | {pid}
    grown = True
    while grown:
        children = {number for number, above in parent.items() if above in found} - found
        found |= children
        grown = bool(children)
    return sorted(found - {pid})


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
