"""Children that run cases one after another, so that a crash or hang costs one child only."""

import contextlib
import json
import os
import queue
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .cases import LIMITS, USUAL_LIMITS, class_of

_ROOT = Path(__file__).parents[2]

#: Cases after which a child is replaced, so that a leak of memory does not add up.
_MOST_CASES = 400


class _Child:
    """One child process, in a session of its own."""

    def __init__(self) -> None:
        self.log = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `end`
        paths = os.pathsep.join([str(_ROOT), str(_ROOT / "tests"), *filter(None, sys.path)])
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONFAULTHANDLER": "1"},
            start_new_session=True,
        )
        self.n_cases = 0
        self.is_usable = True

    def run(self, number: int) -> dict[str, Any]:
        """Run a case and return its outcome, also if the child crashes or hangs."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.n_cases += 1
        began, processor_began = time.monotonic(), self._processor_time()
        # A child that is gone answers with the end of its output.
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(b"%d\n" % number)
            self.process.stdin.flush()
        processor, wall = LIMITS.get(class_of(number), USUAL_LIMITS)
        answer, what = b"", ""
        while not what and not answer.endswith(b"\n"):
            if select.select([self.process.stdout], [], [], 1.0)[0]:
                part = os.read(self.process.stdout.fileno(), 1 << 16)
                answer += part
                if not part:
                    code = self.process.wait()
                    died = signal.Signals(-code).name if code < 0 else f"exit code {code}"
                    what = f"the interpreter died: {died}"
            elif self._processor_time() - processor_began > processor:
                what = f"no end after {processor:g} s of processor time"
            elif time.monotonic() - began > wall:
                what = f"no end after {wall:g} s"
        seconds = round(time.monotonic() - began, 3)
        if not what:
            self.is_usable = self.n_cases < _MOST_CASES
            return {**json.loads(answer), "seconds": seconds}
        self.is_usable = False
        self.log.seek(max(0, self.log.seek(0, os.SEEK_END) - 2500))
        where = self.log.read().decode("utf-8", "replace")
        about = {"seed": number, "class": class_of(number), "status": "failed"}
        return {**about, "what": what, "where": where, "seconds": seconds}

    def end(self) -> None:
        """End the child and all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.log):
            with contextlib.suppress(OSError):
                stream.close()

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
    waiting, lock = iter(numbers), threading.Lock()
    found: queue.SimpleQueue = queue.SimpleQueue()
    children: set[_Child] = set()
    is_over = threading.Event()

    def serve() -> None:
        child = None
        try:
            while not is_over.is_set():
                with lock:
                    number = next(waiting, None)
                if number is None:
                    break
                if child is None:
                    child = _Child()
                    children.add(child)
                found.put(child.run(number))
                if not child.is_usable:
                    children.discard(child)
                    child.end()
                    child = None
        finally:
            found.put(None)

    threads = [threading.Thread(target=serve, daemon=True) for _ in range(jobs)]
    try:
        for thread in threads:
            thread.start()
        for _ in range(jobs):
            yield from iter(found.get, None)
    finally:
        is_over.set()
        for child in list(children):
            child.end()
