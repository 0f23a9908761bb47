"""Suppression of the output of other packages, in the calling thread only.

meshio prints, also through rich consoles.  trimesh and the readers of images log and warn.
Redirecting ``sys.stdout`` would also redirect the output of all other threads.
"""

from __future__ import annotations

import builtins
import contextlib
import io
import logging
import re
import threading
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

#: Receives the output while a block of `quiet` runs in this thread.
_HEARD: ContextVar[io.StringIO | None] = ContextVar("adaptsize_heard", default=None)
#: Loggers that write to the terminal by their own handlers.
_LOUD_LOGGERS = ("nibabel.global",)
#: The markup that meshio puts around each message: ``[red][bold]Error:[/bold] text[/red]``.
_MARKUP = re.compile(r"(?:\[\w+\])?\[bold\]\w+:\[/bold\] (.*?)(?:\[/\w+\])?", re.DOTALL)
# Filters of warnings belong to the process: blocks that overlap would leave those of each other.
_FILTERS = threading.RLock()


@contextlib.contextmanager
def quiet() -> Iterator[io.StringIO]:
    """Suppress prints, log records and warnings of other packages.  Yields the text.

    Only meshio's own prints, and log records without a handler of the user, are suppressed.
    """
    _listen_to_meshio()
    _listen_to_logging()
    heard = io.StringIO()
    token = _HEARD.set(heard)
    try:
        with _FILTERS, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield heard
    finally:
        _HEARD.reset(token)


class _Console:
    """Replaces the rich console that meshio creates for each message."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self._made_with = args, options

    def print(self, text: object = "", *args: Any, **options: Any) -> None:
        heard = _HEARD.get()
        if heard is not None:
            marked = _MARKUP.fullmatch(str(text))
            heard.write(f"{marked[1] if marked else text}\n")
            return
        from rich.console import Console

        Console(*self._made_with[0], **self._made_with[1]).print(text, *args, **options)


def _print(*values: object, **options: Any) -> None:
    """Print in place of ``print`` in meshio's function that tries several readers."""
    heard = _HEARD.get()
    if heard is None:
        builtins.print(*values, **options)
    else:
        heard.write(" ".join(map(str, values)) + "\n")


def _listen_to_meshio() -> None:
    """Install filters between meshio and the terminal.  Outside `quiet` they pass everything."""
    try:
        from meshio import _common, _helpers
    except ImportError:
        return
    if getattr(_common, "Console", _Console) is not _Console:
        _common.Console = _Console
    _helpers.print = _print


def _listen_to_logging() -> None:
    for place in (logging.lastResort, *map(logging.getLogger, _LOUD_LOGGERS)):
        if place is not None:
            place.addFilter(_is_heard)  # adding it twice has no effect


def _is_heard(record: logging.LogRecord) -> bool:
    """Whether to show a record: not while `quiet` runs in this thread."""
    heard = _HEARD.get()
    if heard is not None:
        heard.write(f"{record.getMessage()}\n")
    return heard is None
