"""Children that run cases one after another, so that a crash or hang costs one child only."""

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .cases import LIMITS, class_of

_ROOT = Path(__file__).parents[2]

#: Cases after which a child is replaced, so that a leak of memory does not add up.
_MOST_CASES = 400


class Child:
    """One child process, in a session of its own."""

    def __init__(self) -> None:
        self.log = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `end`
        package = __package__ or "tests.attack"
        paths = [str(_ROOT), str(_ROOT / "tests"), *filter(None, sys.path)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"{package}.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONFAULTHANDLER": "1"},
            start_new_session=True,
        )
        self.n_cases = 0
        self.case = -1
        self.since = 0.0
        self.cpu_since = 0.0
        self.answer = b""

    def give(self, number: int) -> None:
        """Start a case."""
        assert self.process.stdin is not None
        self.case, self.n_cases = number, self.n_cases + 1
        self.since, self.cpu_since = time.monotonic(), self._processor_time()
        # A child that is gone answers with the end of its output.
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(b"%d\n" % number)
            self.process.stdin.flush()

    def take(self) -> dict[str, Any] | None:
        """Return the outcome of the case if the child has answered or died."""
        assert self.process.stdout is not None
        part = os.read(self.process.stdout.fileno(), 1 << 16)
        self.answer += part
        if part and not self.answer.endswith(b"\n"):
            return None
        answer, self.answer = self.answer, b""
        if part:
            return {**json.loads(answer), "seconds": round(time.monotonic() - self.since, 3)}
        code = self.process.wait()
        died = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return self._outcome(f"the interpreter died: {died}")

    def overdue(self) -> dict[str, Any] | None:
        """Return the outcome of a case that exceeds its time."""
        processor, wall = LIMITS[class_of(self.case)]
        if self._processor_time() - self.cpu_since > processor:
            return self._outcome(f"no end after {processor:g} s of processor time")
        if time.monotonic() - self.since > wall:
            return self._outcome(f"no end after {wall:g} s")
        return None

    def end(self) -> None:
        """End the child and all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.log):
            with contextlib.suppress(OSError):
                stream.close()

    def _outcome(self, what: str) -> dict[str, Any]:
        self.log.seek(max(0, self.log.seek(0, os.SEEK_END) - 2500))
        return {
            "seed": self.case,
            "class": class_of(self.case),
            "status": "failed",
            "what": what,
            "where": self.log.read().decode("utf-8", "replace"),
            "seconds": round(time.monotonic() - self.since, 3),
        }

    def _processor_time(self) -> float:
        """Return the seconds that the child itself has computed."""
        try:
            stat = Path(f"/proc/{self.process.pid}/stat").read_text()
        except OSError:
            return 0.0
        words = stat.rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def outcomes(numbers: Iterable[int], jobs: int) -> Iterator[dict[str, Any]]:
    """Run the cases in ``jobs`` children and return the outcome of each as it comes."""
    waiting = iter(numbers)
    selector = selectors.DefaultSelector()
    busy: set[Child] = set()

    def start(child: Child | None = None) -> None:
        """Give the next case to a child, or to a new one; end the child if there is none."""
        number = next(waiting, None)
        if child is not None and (number is None or child.n_cases >= _MOST_CASES):
            stop(child)
            child = None
        if number is None:
            return
        if child is None:
            child = Child()
            busy.add(child)
            selector.register(child.process.stdout, selectors.EVENT_READ, child)
        child.give(number)

    def stop(child: Child) -> None:
        selector.unregister(child.process.stdout)
        busy.discard(child)
        child.end()

    try:
        for _ in range(jobs):
            start()
        while busy:
            ready = {key.data for key, _ in selector.select(1.0)}
            for child in list(busy):
                found = child.take() if child in ready else child.overdue()
                if found is None:
                    continue
                is_gone = child not in ready or child.process.poll() is not None
                if is_gone:
                    stop(child)
                start(None if is_gone else child)
                yield found
    finally:
        for child in list(busy):
            stop(child)
