"""Children that run cases one after another, so that a crash or hang costs one child only."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from itertools import islice
from pathlib import Path
from typing import Any

from .cases import class_of, limits_of

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
        """Run a case and return its outcome, also if the child crashes or ends itself."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.n_cases += 1
        # A child that is gone answers with the end of its output.
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(b"%d\n" % number)
            self.process.stdin.flush()
        answer = self.process.stdout.readline()
        self.is_usable = answer.endswith(b"\n") and self.n_cases < _MOST_CASES
        if answer.endswith(b"\n"):
            return dict(json.loads(answer))
        code = self.process.wait()
        died = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        processor, wall = limits_of(number)
        what = {
            "SIGPROF": f"no end after {processor:g} s of processor time",
            "SIGALRM": f"no end after {wall:g} s",
        }.get(died, f"the interpreter died: {died}")
        self.log.seek(max(0, self.log.seek(0, os.SEEK_END) - 2500))
        where = self.log.read().decode("utf-8", "replace")
        about = {"seed": number, "class": class_of(number), "status": "failed"}
        return {**about, "what": what, "where": where}

    def end(self) -> None:
        """End the child and all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.log):
            with contextlib.suppress(OSError):
                stream.close()


def outcomes(numbers: Iterable[int], jobs: int) -> Iterator[dict[str, Any]]:
    """Run the cases in ``jobs`` children and return the outcome of each as it comes."""
    waiting = iter(numbers)
    idle: list[_Child] = []
    children: set[_Child] = set()

    def run(number: int) -> dict[str, Any]:
        child = idle.pop() if idle else _Child()
        children.add(child)
        outcome = child.run(number)
        if child.is_usable:
            idle.append(child)
        else:
            children.discard(child)
            child.end()
        return outcome

    with ThreadPoolExecutor(jobs) as threads:
        try:
            running = {threads.submit(run, number) for number in islice(waiting, jobs)}
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                running |= {threads.submit(run, n) for n in islice(waiting, len(done))}
                yield from (future.result() for future in done)
        finally:
            for child in list(children):
                child.end()
