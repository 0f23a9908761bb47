"""The steps of a command: a bar on a terminal, lines elsewhere, and the time of each."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType

from adaptsize._progress import remaining, reporting
from adaptsize.typing import ProgressCallback

#: How much is printed.
QUIET, NORMAL, VERBOSE = 0, 1, 2
#: Steps are printed as lines only from this many seconds on: quick commands print none.
PATIENCE = 3.0
#: Seconds between lines about the same step.
INTERVAL = 30.0


class Steps:
    """A context in which steps follow each other; `begin` ends the one before.

    Parameters
    ----------
    count : int
        Expected number of steps.
    say : callable
        Prints a line.
    times : list
        Names and seconds of the steps are appended to it.
    level : int
        Unless ``QUIET``, a bar is shown on a terminal, and lines elsewhere.  ``VERBOSE`` also
        prints the time of each step as it ends.
    """

    def __init__(
        self, count: int, say: Callable[[str], None], times: list[tuple[str, float]], level: int
    ) -> None:
        self._count, self._say, self._times = count, say, times
        on_terminal = sys.stderr.isatty()
        self._with_bar = level > QUIET and on_terminal
        self._with_lines = level > QUIET and not on_terminal
        self._verbose = level == VERBOSE
        self._bar: ProgressCallback | None = None
        self._open = ExitStack()
        self._lock = threading.Lock()
        self._talks = False
        self._number = 0
        self._name = ""
        self._start = self._began = self._printed = time.monotonic()

    def __enter__(self) -> Steps:
        if self._with_bar:
            self._bar = self._open.enter_context(reporting(True))
        if self._with_lines:
            timer = threading.Timer(PATIENCE, self._talk)
            timer.daemon = True
            self._open.callback(timer.cancel)
            timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()
        if kind is None:
            self._end()

    def begin(self, name: str) -> None:
        """Begin a step."""
        self._end()
        self._number += 1
        self._count = max(self._count, self._number)
        self._go_on(name)

    def report(self, text: str, share: float | None) -> None:
        """Show how far a step is.  This is a progress callback for the library."""
        if self._bar is not None:
            self._bar(f"{self._title()}: {text}" if text else self._title(), share)
        now = time.monotonic()
        if self._talks and now - self._printed >= INTERVAL:
            passed = now - self._began
            left = remaining(passed, share)
            self._printed = now
            self._say(f"{self._title()}, {passed:.0f} s so far{', ' if left else ''}{left}")

    def following(self, name_of: Callable[[str], str | None]) -> ProgressCallback:
        """Return a progress callback whose texts divide the next step into parts.

        ``name_of`` returns the name of the part for a text, or None if that begins no part.
        """
        first = True

        def report(text: str, share: float | None) -> None:
            nonlocal first
            name = name_of(text)
            if name is not None and name != self._name:
                if first:
                    self.begin(name)
                else:
                    self._end()
                    self._go_on(name)
                first = False
            self.report(text if name is None else "", share)

        return report

    def _go_on(self, name: str) -> None:
        """Go on with a part of a step."""
        with self._lock:
            self._name = name
            self._began = time.monotonic()
            if self._talks:
                self._line(self._title())
        if self._bar is not None:
            self._bar(self._title(), None)

    def _talk(self) -> None:
        """Print lines from now on, beginning with the present step."""
        with self._lock:
            self._talks = True
            if self._name:
                self._line(self._title())

    def _line(self, text: str) -> None:
        self._printed = time.monotonic()
        passed = self._printed - self._start
        self._say(f"{text} (after {passed:.0f} s)" if passed >= 1.0 else text)

    def _title(self) -> str:
        return f"step {self._number} of {self._count}: {self._name}"

    def _end(self) -> None:
        if self._name:
            seconds = time.monotonic() - self._began
            self._times.append((self._name, seconds))
            if self._verbose:
                self._say(f"{self._name}: {seconds:.2f} s")
        self._name = ""
