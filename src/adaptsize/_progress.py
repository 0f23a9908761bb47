"""Progress of long computations, by a callback or as a bar on the terminal."""

import inspect
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from adaptsize._checks import describe
from adaptsize.typing import ProgressCallback

#: The time left is not estimated from a smaller share.
_LEAST_SHARE = 0.05


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

    The bar is not shown when standard error is not a terminal.  An exception in the
    callback, including KeyboardInterrupt, propagates to the caller and stops the work.
    """
    if isinstance(progress, np.bool_):
        progress = bool(progress)
    if progress is None or progress is False:
        yield silent
    elif progress is True:
        with _rich_bar() as callback:
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


def remaining(seconds: float, share: float | None) -> str:
    """Return the time left in words, from the time a share took; empty if it is not known.

    Examples
    --------
    >>> remaining(30.0, 0.25)
    'about 90 s left'
    """
    if share is None or not _LEAST_SHARE <= share < 1.0:
        return ""
    return f"about {seconds * (1.0 - share) / share:.0f} s left"


def silent(text: str, share: float | None) -> None:
    """Report nothing."""


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
        shown = ""
        task = bar.add_task(shown, total=None, left="", visible=False)

        def report(text: str, share: float | None) -> None:
            nonlocal shown, task
            if text != shown:
                bar.remove_task(task)
                task = bar.add_task(text, total=None, left="")
                shown = text
            if share is not None:
                passed = bar.tasks[0].elapsed or 0.0
                bar.update(task, total=1.0, completed=share, left=remaining(passed, share))

        yield report
