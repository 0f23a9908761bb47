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
                return self._wait(child, folder / "log.txt", text)
            finally:  # on an interrupt too, and for what the child may have started
                _kill_group(child)

    def _wait(self, child: subprocess.Popen[bytes], log: Path, text: str) -> int:
        while True:
            self.report(text, None)
            try:
                return child.wait(_POLL_SECONDS)
            except subprocess.TimeoutExpired:
                pass
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


def _kill_group(child: subprocess.Popen[bytes]) -> None:
    """Kill the child and, where the system has process groups, all that it started."""
    if child.poll() is not None:
        return
    if sys.platform != "win32":
        # The group may be gone by now (macOS says EPERM of a zombie).
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)  # hung generators ignore everything else
    child.kill()
    child.wait()


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
