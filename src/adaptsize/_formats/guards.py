"""Guards around files and other packages.

Files are written completely or not at all; devices and pipes are written into, never read.

Output of other packages is suppressed in the calling thread only: meshio prints, also through rich
consoles; trimesh and the readers of images log and warn.  Redirecting ``sys.stdout`` would also
redirect the output of all other threads.
"""

from __future__ import annotations

import builtins
import contextlib
import io
import logging
import os
import re
import secrets
import shutil
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from adaptsize.errors import MeshFileError

#: Longest text of an error after the path.  Names of fields come from files and may be long.
_LONGEST = 600


def check_readable(path: Path) -> None:
    """Refuse what is not a file with content.  A pipe would block, and a device never end."""
    try:
        if path.is_dir():
            raise MeshFileError("is a directory")
        if is_special(path):
            raise MeshFileError("is a device or a pipe, where a file is required")
        with path.open("rb") as opened:
            empty = not opened.read(1)
    except OSError as error:
        raise MeshFileError(f"{error.strerror or error}") from error
    if empty:
        raise MeshFileError("is empty")


def about_file(path: str | os.PathLike[str], error: BaseException) -> MeshFileError:
    """Return an error of one line with the path and the problem."""
    if isinstance(error, MemoryError):
        text = "needs more memory than there is"
    elif isinstance(error, OSError):
        text = error.strerror or str(error)
    else:
        text = " ".join(str(error).split()) or type(error).__name__
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST - 3]}..."
    return MeshFileError(f"{path}: {text}")


def write_whole(target: Path, write_to: Callable[[Path], None]) -> None:
    """Write under a temporary name in the same directory and rename.  Raises OSError."""
    if target.is_dir():
        raise MeshFileError("is a directory")
    if is_special(target):
        _write_into(target, write_to)
        return
    if not target.parent.is_dir():
        raise MeshFileError(f"there is no directory {target.parent}")
    # Not tempfile: its files are private to the user, and the suffix must be kept.
    temporary = target.with_name(f".adaptsize-{secrets.token_hex(8)}{target.suffix}")
    try:
        write_to(temporary)
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def is_special(path: Path) -> bool:
    """Whether a path exists and is neither a file nor a directory: a device, pipe or socket."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _write_into(special: Path, write_to: Callable[[Path], None]) -> None:
    """Write to a temporary file and copy its content, because a device must not be replaced."""
    with tempfile.TemporaryDirectory(prefix="adaptsize-") as folder:
        whole = Path(folder, special.name)
        write_to(whole)
        with whole.open("rb") as content, special.open("wb", buffering=0) as device:
            shutil.copyfileobj(content, device)


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


#: Whatever a reader of another package may raise.  meshio calls sys.exit, and some errors of
#: these packages are derived from Exception only.  Ctrl-C is not among them.
FOREIGN_FAILURES: tuple[type[BaseException], ...] = (Exception, SystemExit)


def reason(error: BaseException, printed: str = "") -> str:
    """Return one short line with the error of another package."""
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"needs the package {error.name} (pip install {error.name})"
    lines = printed if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
    text = "; ".join(line.strip().rstrip(".") for line in lines.splitlines() if line.strip())
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= 160 else line[:157] + "..."
