"""What a command prints: results on standard output, messages on standard error."""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsize.cli.steps import Steps

if TYPE_CHECKING:
    from adaptsize.cli.parallel import World

QUIET, NORMAL, VERBOSE = 0, 1, 2

#: Units of the numbers in the JSON object.
_UNITS = {
    "length": "unit of the coordinates in the file",
    "angle": "degree",
    "time": "second",
    "share": "1",
}

#: Commands that run on several ranks of MPI.
_IN_PARTS = ("limit", "remesh")

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and no other results.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
Verbose = Annotated[
    bool,
    typer.Option(
        "-v",
        "--verbose",
        help="Also print the time of each step and the messages of the mesh generators.",
    ),
]


class Console:
    """The output of one command.

    Attributes
    ----------
    as_json : bool
        Whether the results are one JSON object instead of text.
    level : int
        ``QUIET``, ``NORMAL`` or ``VERBOSE``.
    warnings : list of str
        The warnings so far, each once.
    world : World or None
        The ranks of MPI; None in a single process.  Only the first prints.
    """

    def __init__(self, world: World | None = None) -> None:
        self.world = world
        self._is_silent = world is not None and not world.is_first
        self._failure = ""
        self.as_json = False
        self.level = NORMAL
        self.warnings: list[str] = []
        self._command = ""
        self._result: dict[str, Any] = {}
        self._written: list[dict[str, Any]] = []
        self._times: list[tuple[str, float]] = []
        self._began = time.monotonic()

    def configure(self, command: str, *, as_json: bool, quiet: bool, verbose: bool) -> None:
        """Set what is printed.

        Raises
        ------
        ValueError
            If the output is to be quiet and verbose.
        """
        if quiet and verbose:
            raise ValueError("--quiet and --verbose exclude each other")
        self.as_json = as_json and not self._is_silent
        self.level = QUIET if quiet or self._is_silent else VERBOSE if verbose else NORMAL
        self._command = command

    def print(self, text: object) -> None:
        """Print a result."""
        if self.level > QUIET and not self.as_json:
            print(text)

    def record(self, **result: Any) -> None:
        """Add keys to the JSON object."""
        self._result.update(result)

    def wrote(self, **what: Any) -> None:
        """Add a file to the list of written files in the JSON object."""
        self._written.append(what)

    def say(self, text: str) -> None:
        """Print a message."""
        if self.level > QUIET:
            _print_message(text)

    def warn(self, text: str) -> None:
        """Print a warning, unless the same has been printed before."""
        if text not in self.warnings:
            self.warnings.append(text)
            self.say(f"warning: {text}")

    def stopped(self, text: str) -> None:
        """Print that the command was stopped."""
        if not self._is_silent:
            _print_message(text)

    def fail(self, text: str) -> None:
        """Print an error, also in the JSON object; on several ranks, only keep it."""
        self._failure = text
        if self.world is None:
            self.print_failure()

    def print_failure(self, where: str = "") -> None:
        """Print the error that ended the command, if there is any."""
        if not self._failure:
            return
        text = self._failure if self._failure.startswith("rank ") else where + self._failure
        _print_message(f"error: {text}")
        if self.as_json:
            self._print_object(error=text)

    @contextlib.contextmanager
    def messages_of_generators(self) -> Iterator[None]:
        """Print the messages of mesh generators, if the output is verbose."""
        if self.level < VERBOSE:
            yield
            return
        handler = logging.Handler()
        handler.emit = lambda record: self.say(record.getMessage())  # type: ignore[method-assign]
        logger = logging.getLogger("adaptsize.remeshing")
        level = logger.level
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
        try:
            yield
        finally:
            logger.setLevel(level)
            logger.removeHandler(handler)

    def steps(self, count: int) -> Steps:
        """Return the context in which a command runs in ``count`` steps."""
        shown, verbose = self.level > QUIET, self.level == VERBOSE
        return Steps(count, self.say, self._times, shown=shown, verbose=verbose)

    def finish(self) -> None:
        """Print the JSON object, if it is requested."""
        if self.as_json:
            self._print_object(**self._result)

    @property
    def times(self) -> list[tuple[str, float]]:
        """Names and seconds of the steps so far."""
        return self._times

    @property
    def seconds(self) -> float:
        """Seconds since the command began."""
        return time.monotonic() - self._began

    def _print_object(self, **result: Any) -> None:
        from adaptsize import __version__

        whole = {
            "command": self._command,
            "version": __version__,
            **result,
            "output": self._written,
            "warnings": self.warnings,
            "steps": [{"name": name, "seconds": seconds} for name, seconds in self._times],
            "seconds": self.seconds,
            "units": _UNITS,
        }
        print(json.dumps(_plain(whole), indent=2, allow_nan=False))


def with_console(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options ``--json``, ``--quiet`` and ``--verbose``.

    The command takes a `Console` as its first argument.  The others are its arguments and options,
    or there is one other, ``options``, a dataclass that has these as fields.
    """
    own = inspect.signature(function, eval_str=True)
    record = own.parameters["options"].annotation if "options" in own.parameters else None
    listed = own if record is None else inspect.signature(record, eval_str=True)
    keyword = inspect.Parameter.KEYWORD_ONLY
    context = inspect.Parameter("context", keyword, annotation=typer.Context)
    shared = [
        inspect.Parameter(name, keyword, default=False, annotation=annotation)
        for name, annotation in (("as_json", AsJson), ("quiet", Quiet), ("verbose", Verbose))
    ]
    options = [p.replace(kind=keyword) for p in listed.parameters.values() if p.name != "console"]

    @functools.wraps(function)
    def command(
        *, context: typer.Context, as_json: bool, quiet: bool, verbose: bool, **given: Any
    ) -> None:
        console: Console = context.obj
        name = str(context.info_name)
        if console.world is not None and name not in _IN_PARTS:
            raise ValueError(f"{name} runs in one process; on several ranks run limit and remesh")
        console.configure(name, as_json=as_json, quiet=quiet, verbose=verbose)
        with console.messages_of_generators():
            if record is None:
                function(console, **given)
            else:
                function(console, record(**given))
        console.finish()

    parameters = [context, *options, *shared]
    command.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command


def _print_message(text: str) -> None:
    print(f"adaptsize: {text}", file=sys.stderr, flush=True)


def _plain(value: Any) -> Any:
    """Return a value of JSON.  Numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if hasattr(value, "tolist"):  # of numpy
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    return str(value)  # paths
