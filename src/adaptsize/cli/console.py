"""What a command prints: results on standard output, messages on standard error.

Steps are a bar on a terminal, and lines elsewhere.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsize._messages import Message, message_of
from adaptsize._progress import Stage, TimeLeft, reporting, silent
from adaptsize.cli import tuning
from adaptsize.errors import OptionError
from adaptsize.typing import ProgressCallback

if TYPE_CHECKING:
    from adaptsize.cli.provenance import TypedCommand


class Console:
    """The output of one command.

    Parameters
    ----------
    only : Path, optional
        The file that the command writes, and no other, whatever its options are.

    Attributes
    ----------
    as_json : bool
        Whether the results are one JSON object instead of text.
    quiet, verbose : bool
        Whether only errors are printed; whether also what mesh generators print.
    warnings : list of str
        The warnings so far, each once.
    times : list of tuple
        Names, which may be stages, and seconds of the steps so far.
    typed : str
        The command as it was typed.
    request : TypedCommand or None
        The command in the form that is stored with what it writes.
    """

    def __init__(self, only: Path | None = None) -> None:
        self.only = only
        self._flags: Mapping[str, str] = {}
        self.as_json = self.quiet = self.verbose = False
        self.warnings: list[str] = []
        self._command = self.typed = ""
        self.request: TypedCommand | None = None
        self._result: dict[str, Any] = {}
        self._written: list[dict[str, Any]] = []
        self.times: list[tuple[str, float]] = []
        self._began = time.monotonic()

    def configure(self, command: str, flags: Mapping[str, str], general: Mapping[str, Any]) -> None:
        """Set what is printed, and what is typed for the options that messages name."""
        self._command, self._flags = command, flags
        self.as_json, self.quiet = bool(general["json"]), bool(general["quiet"])
        self.verbose = bool(general["verbose"])
        if self.quiet and self.verbose:
            raise OptionError(Message("{quiet} and {verbose} exclude each other"))

    def print(self, text: object) -> None:
        """Print a result."""
        if not (self.quiet or self.as_json):
            print(text)

    def record(self, **result: Any) -> None:
        """Add keys to the JSON object."""
        self._result.update(result)

    def wrote(self, **what: Any) -> None:
        """Add a file to the list of written files in the JSON object.

        A file of another command, which makes it again in a folder of its own, has a name only.
        """
        name = what["file"] if self.only is None else Path(what["file"]).name
        self._written.append(what | {"file": name})

    def say(self, text: str) -> None:
        """Print a message."""
        if not self.quiet:
            print_message(self._typed(text))

    def warn(self, text: str) -> None:
        """Print a warning, unless the same has been printed before."""
        text = self._typed(text)
        if text not in self.warnings:
            self.warnings.append(text)
            self.say(f"warning: {text}")

    def fail(self, error: BaseException) -> bool:
        """Print an error, also in the JSON object.

        Return whether it is about options of this command.
        """
        text = self._typed(message_of(error)) or type(error).__name__
        print_message(f"error: {text}")
        if self.as_json:
            self._print_object(error=text)
        return isinstance(error, OptionError) and not self._flags.keys().isdisjoint(error.options)

    def _typed(self, text: str) -> str:
        """Return a message in one line, with the names that options have on the command line."""
        text = text.typed(self._flags) if isinstance(text, Message) else text
        return " ".join(text.split())

    @contextlib.contextmanager
    def messages_of_generators(self) -> Iterator[None]:
        """Print the messages of mesh generators, if the output is verbose."""
        if not self.verbose:
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

    @contextlib.contextmanager
    def steps(self, count: int) -> Iterator[Steps]:
        """Yield the ``count`` steps of a command: a bar on a terminal, lines elsewhere."""
        on_terminal = sys.stderr.isatty()
        with contextlib.ExitStack() as stack:
            bar = stack.enter_context(reporting(on_terminal and not self.quiet))
            steps = Steps(self, count, bar)
            if not (self.quiet or on_terminal):
                timer = threading.Timer(tuning.SECONDS_BEFORE_LINES, steps.talk)
                timer.daemon = True
                stack.callback(timer.cancel)
                timer.start()
            yield steps
        steps.end()

    def finish(self) -> None:
        """Print what each written file holds, or the JSON object."""
        if self.as_json:
            self._print_object(**self._result)
        for held in self._written:
            if held["kind"] != "picture":
                self.print(f"{held['file']}: {_content_of(held)}")

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
            "steps": [{"name": name, "seconds": seconds} for name, seconds in self.times],
            "seconds": self.seconds,
            "units": {
                "length": "unit of the coordinates in the file",
                "angle": "degree",
                "time": "second",
                "share": "1",
            },
        }
        print(json.dumps(plain(whole), indent=2, allow_nan=False))


def _content_of(held: Mapping[str, Any]) -> str:
    """Return in words what a file holds."""
    text = f"{held['n_points']} points"
    if "n_cells" in held:
        text += f", {held['n_cells']} {'boxes' if held['kind'] == 'grid' else held['kind']}"
    if held.get("n_tagged_facets"):
        text += f", {held['n_tagged_facets']} tagged facets"
    for kind in ("fields", "cell_fields"):
        names = held.get(kind)
        if names:
            word = kind.replace("_", " ").removesuffix("" if len(names) > 1 else "s")
            text += f", {word} {', '.join(names)}"
    return text


def print_message(text: str) -> None:
    """Print a message, also in a quiet command."""
    print(f"adaptsize: {text}", file=sys.stderr, flush=True)


def plain(value: Any) -> Any:
    """Return a value of JSON.  Numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if hasattr(value, "tolist"):  # of numpy
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    return str(value)  # paths


class Steps:
    """Steps that follow each other: `begin` ends the one before.

    Parameters
    ----------
    console : Console
        Prints lines, and has the times of the steps.
    count : int
        Expected number of steps.
    bar : callable, optional
        Shows the step and how far it is.
    """

    def __init__(self, console: Console, count: int, bar: ProgressCallback = silent) -> None:
        self._console, self._count, self._bar = console, count, bar
        self._lock = threading.Lock()
        self._talks = False
        self._number = 0
        self._name = ""
        self._start = self._began = self._printed = time.monotonic()
        self._left = TimeLeft(self._began)

    def begin(self, name: str) -> None:
        """Begin a step."""
        self._number += 1
        self._count = max(self._count, self._number)
        self._go_on(name)

    def report(self, text: str, share: float | None) -> None:
        """Show how far a step is.  This is a progress callback for the library."""
        self._bar(f"{self._title()}: {text}" if text else self._title(), share)
        now = time.monotonic()
        left = self._left.update(now, f"{self._title()}: {text}", share)
        if self._talks and now - self._printed >= tuning.INTERVAL:
            passed = now - self._began
            self._printed = now
            self._console.say(f"{self._title()}, {passed:.0f} s so far{', ' if left else ''}{left}")

    def following(self) -> ProgressCallback:
        """Return a progress callback whose stages divide the next step into parts."""
        go_on = self.begin

        def report(text: str, share: float | None) -> None:
            nonlocal go_on
            if isinstance(text, Stage) and text != self._name:
                go_on(text)
                go_on = self._go_on
            self.report("" if isinstance(text, Stage) else text, share)

        return report

    def talk(self) -> None:
        """Print lines from now on, beginning with the present step."""
        with self._lock:
            self._talks = True
            if self._name:
                self._line(self._title())

    def end(self) -> None:
        """End the present step."""
        if self._name:
            seconds = time.monotonic() - self._began
            self._console.times.append((self._name, seconds))
            if self._console.verbose:
                self._console.say(f"{self._name}: {seconds:.2f} s")
        self._name = ""

    def _go_on(self, name: str) -> None:
        """Go on with a part of a step."""
        self.end()
        with self._lock:
            self._name = name
            self._began = time.monotonic()
            self._left = TimeLeft(self._began)
            if self._talks:
                self._line(self._title())
        self._bar(self._title(), None)

    def _line(self, text: str) -> None:
        self._printed = time.monotonic()
        passed = self._printed - self._start
        self._console.say(f"{text} (after {passed:.0f} s)" if passed >= 1.0 else text)

    def _title(self) -> str:
        return f"step {self._number} of {self._count}: {self._name}"
