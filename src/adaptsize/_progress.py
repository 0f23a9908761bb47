"""Progress of long computations, by a callback, on the terminal, or in a notebook."""

import inspect
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from adaptsize._checks import describe
from adaptsize.typing import ProgressCallback

#: The time left is not estimated from a smaller share.
_LEAST_SHARE = 0.05
#: Estimates that are larger by up to this factor do not replace the one that counts down.
_RISE = 1.25


class Stage(str):
    """The text with which a part of the work begins, for a progress callback.

    Other texts say how far a part is.

    Examples
    --------
    >>> stage = Stage("adapting", "Mmg")
    >>> stage
    'adapting with Mmg'
    >>> stage.generator
    'Mmg'
    """

    generator: str
    """The program that does the work, if it is a mesh generator."""

    def __new__(cls, name: str, generator: str = "") -> "Stage":
        stage = super().__new__(cls, f"{name} with {generator}" if generator else name)
        stage.generator = generator
        return stage


@contextmanager
def reporting(progress: ProgressCallback | bool | None) -> Iterator[ProgressCallback]:
    """Yield a callback ``(text, share)``.  ``True`` gives a rich bar on standard error.

    Without a terminal there is none; notebooks show a line, which is empty at the end.  An
    exception in the callback, including KeyboardInterrupt, propagates and stops the work.
    """
    if isinstance(progress, np.bool_):
        progress = bool(progress)
    if progress is None or progress is False:
        yield silent
    elif progress is True:
        with _line_in_notebook() if _is_notebook() else _rich_bar() as callback:
            yield callback
    elif not callable(progress):
        raise ValueError(f"progress must be callable or True or False, got {describe(progress)}")
    else:
        _check_arguments(progress)
        yield progress


def _check_arguments(callback: ProgressCallback) -> None:
    """Refuse a function of other arguments at once, not after minutes of work."""
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):  # some compiled functions have none
        return
    try:
        signature.bind("text", 0.5)
    except TypeError as error:
        raise ValueError(
            f"progress must be callable with a text and a number, got {describe(callback)}: {error}"
        ) from None


class TimeLeft:
    """The time left of a step in words, from the time that its share took.

    Until the share grows, the last estimate counts down: otherwise it would rise as long as a step
    does not report.  A new one that is a little larger is left out for the same reason.

    Parameters
    ----------
    now : float
        Time in seconds at which the step begins.

    Examples
    --------
    >>> left = TimeLeft(0.0)
    >>> [left.update(now, "limiting", 0.01 * now) for now in (0.0, 25.0, 26.0, 50.0)]
    ['', 'about 75 s left', 'about 74 s left', 'about 50 s left']
    """

    def __init__(self, now: float) -> None:
        self._text, self._share = "", 0.0
        self._began = self._end = self._last = now

    def update(self, now: float, text: str, share: float | None) -> str:
        """Return the time left at a time in seconds; empty if it is not known."""
        if text != self._text or (share is not None and share < self._share):
            self._text, self._began, self._end, self._share = text, self._last, now, 0.0
        self._last = now
        if share is None or not _LEAST_SHARE <= share < 1.0:
            return ""
        if share > self._share:
            left, before = (now - self._began) * (1.0 - share) / share, self._end - now
            if not before < left <= _RISE * before:
                self._end = now + left
            self._share = share
        return f"about {self._end - now:.0f} s left" if self._end > now else ""


def silent(text: str, share: float | None) -> None:
    """Report nothing."""


def _is_notebook() -> bool:
    from rich.console import Console

    return Console(stderr=True).is_jupyter


@contextmanager
def _line_in_notebook() -> Iterator[ProgressCallback]:
    """Yield a callback that writes a line below the cell.

    Each new text is shown, and the share of the same text at most ten times a second.  In the end
    the line is empty: a notebook can only remove all that is below a cell.
    """
    from IPython.display import display

    line = display({"text/plain": ""}, raw=True, display_id=True)
    shown, last, left = "", -np.inf, TimeLeft(time.monotonic())

    def report(text: str, share: float | None) -> None:
        nonlocal shown, last
        now = time.monotonic()
        words = [text, "" if share is None else f"{share:.0%}", left.update(now, text, share)]
        if text != shown or now - last > 0.1:
            shown, last = text, now
            line.update({"text/plain": "  ".join(filter(None, words))}, raw=True)

    try:
        yield report
    finally:
        line.update({"text/plain": ""}, raw=True)


@contextmanager
def _rich_bar() -> Iterator[ProgressCallback]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}", markup=False),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        shown, left = "", TimeLeft(time.monotonic())
        task = bar.add_task(shown, total=None, left="", visible=False)

        def report(text: str, share: float | None) -> None:
            nonlocal shown, task
            if text != shown:
                bar.remove_task(task)
                task = bar.add_task(text, total=None, left="")
                shown = text
            now = left.update(time.monotonic(), text, share)
            if share is not None:
                bar.update(task, total=1.0, completed=share, left=now)

        yield report
