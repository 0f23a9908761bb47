"""Execution of mesh generators in child processes.

Generators have been observed to crash the interpreter, hang, ignore SIGTERM, replace
the handler of SIGINT, print, and write files into the working directory.  Therefore each
call gets a new process in its own session and temporary directory, under a supervisor
(`adaptsize._supervisor`).  The supervisor ends it with all that it has started, and removes the
directory, when the time limit is reached or the caller is interrupted, ends or is killed.
"""

import contextlib
import logging
import math
import os
import pickle
import re
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy.typing as npt

from adaptsize import _cores
from adaptsize._children import ends_within, how_it_ended, isolated, pipe_of, start, supervised
from adaptsize._progress import Stage
from adaptsize._supervisor import job_line
from adaptsize.errors import BackendError, BackendTimeoutError
from adaptsize.remeshing.protocol import Arrays, Program

#: Exit without cleanup: some generators crash in their exit handlers.
_WORK = "from adaptsize.remeshing._worker import main; os._exit(main())"
#: The messages of the generators; they are silent unless its level is DEBUG.
_LOGGER = logging.getLogger("adaptsize.remeshing")
#: Codes that colour the text of a terminal.
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True)
class IsolatedRunner:
    """Runs functions of arrays in child processes until a common deadline.

    Attributes
    ----------
    backend : str
        Name for messages.
    timeout : float or None
        Seconds for all calls together, for messages: the share of an attempt.
    deadline : float or None
        The same limit as a value of ``time.monotonic``.
    report : callable
        Called repeatedly with a text and None while the child works.  An exception
        in it stops the child.
    seconds : float
        Limit of processor time of each child, where the system has one.
    elapsed : float
        Limit of elapsed time of each child on a machine of its own.  It stops those that wait for
        something, or for which the system has no limit of processor time.
    crowding : callable
        Returns how many processes compete for a core, at least 1: the factor of ``elapsed``.
    """

    backend: str
    timeout: float | None
    deadline: float | None
    report: Callable[[str, float | None], Any]
    seconds: float = math.inf
    elapsed: float = math.inf
    crowding: Callable[[], float] = _cores.crowding

    def __call__(
        self, job: Program | str, text: Stage, arrays: Arrays, options: Mapping[str, Any]
    ) -> dict[str, npt.NDArray[Any]]:
        """Run a program, or a function ``module:name`` of (arrays, options); return its arrays.

        The option ``verbose`` is added: whether what the child prints will be logged.

        Raises
        ------
        BackendError
            If the child fails, with its last lines.
        BackendTimeoutError
            If it was stopped at the deadline, or at a limit of its own.
        """
        options = {**options, "verbose": _LOGGER.isEnabledFor(logging.DEBUG)}
        program = _function(job) if isinstance(job, str) else job
        # On Windows, a killed child may keep its files open a little longer.
        with tempfile.TemporaryDirectory(
            prefix="adaptsize-", ignore_cleanup_errors=True
        ) as directory:
            folder = Path(directory)
            write = partial(program.write, folder, arrays, options)
            code = self._run_child(folder, text, write)
            result = folder / program.result
            if code != 0 or not result.exists():
                self._fail(folder, code)
            _log_messages(self.backend, folder / "log.txt")
            return program.read(result, options)

    def _run_child(self, folder: Path, text: Stage, write: Callable[[], list[str]]) -> int:
        with open(folder / "log.txt", "wb") as log:
            child = start(supervised(folder), folder, stdout=log, stderr=subprocess.STDOUT)
            pipe = pipe_of(child.stdin)
            try:
                line = job_line(write(), self.seconds)
                with contextlib.suppress(BrokenPipeError):  # killed: its exit code says so
                    pipe.write(line)
                    pipe.flush()
                self._wait(child, folder / "log.txt", text)
            finally:  # also on an interrupt
                code = _end(child)
            return code

    def _wait(self, child: subprocess.Popen[bytes], log: Path, text: Stage) -> None:
        began = time.monotonic()
        while True:
            self.report(text, None)
            if ends_within(child, 0.1):
                return
            now = time.monotonic()
            if self.deadline is not None and now > self.deadline:
                raise BackendTimeoutError(
                    f"{self.backend} was stopped after the time limit of {self.timeout:.3g} s"
                )
            if now - began > self.elapsed * self.crowding():
                raise BackendTimeoutError(
                    f"{self.backend} was stopped after {now - began:.3g} s; it usually needs less "
                    f"than {self.seconds:.3g} s of processor time"
                )
            if log.stat().st_size > 50_000_000:
                raise BackendError(f"{self.backend} was stopped: it printed too much")

    def _fail(self, folder: Path, code: int) -> NoReturn:
        error, ended = folder / "error.txt", how_it_ended(code)
        if error.exists():  # a Python exception
            reason = error.read_text(encoding="utf-8")
        elif ended == "SIGKILL":
            reason = "it was killed from outside (SIGKILL), perhaps because memory ran out"
        elif ended == "SIGXCPU":
            reason = (
                "it was stopped at its limit of processor time (SIGXCPU), as may happen where "
                "the sizes are far too large for the tolerance"
            )
        elif ended.startswith("SIG"):
            reason = f"crashed ({ended})"
        else:
            reason = f"ended with {ended} and no result"
        with open(folder / "log.txt", "rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - 4000))
            tail = _COLOUR.sub("", log.read().decode("utf-8", "replace"))
        lines = [line.strip() for line in tail.splitlines() if line.strip()][-8:]
        said = f"; its last lines: {' | '.join(lines)}" if lines else ""
        kind = BackendTimeoutError if ended == "SIGXCPU" else BackendError
        raise kind(f"{self.backend} failed: {reason}{said}")


def _function(name: str) -> Program:
    """Return the program that calls ``module:name`` with (arrays, options)."""

    def write(folder: Path, arrays: Arrays, options: Mapping[str, Any]) -> list[str]:
        (folder / "job").write_bytes(pickle.dumps((name, dict(arrays), dict(options))))
        return isolated(_WORK)

    def read(result: Path, _options: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
        arrays: dict[str, npt.NDArray[Any]] = pickle.loads(result.read_bytes())
        return arrays

    return Program(write, "result", read)


def _log_messages(backend: str, log: Path) -> None:
    """Log what a generator has printed, if that is wanted."""
    if _LOGGER.isEnabledFor(logging.DEBUG):
        for line in log.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.strip():
                _LOGGER.debug("%s: %s", backend, line.strip())


def _end(child: subprocess.Popen[bytes]) -> int:
    """Make the supervisor end the job and itself, and return its exit code."""
    with contextlib.suppress(BrokenPipeError):
        pipe_of(child.stdin).close()
    try:
        # The supervisor has this long to end a job.
        return child.wait(10.0)
    except subprocess.TimeoutExpired:
        child.kill()
        return child.wait()
