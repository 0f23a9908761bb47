"""What a command prints: results on standard output, messages on standard error."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import re
import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any

from adaptsize.cli.steps import NORMAL, QUIET, VERBOSE, Steps


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
    times : list of tuple
        Names and seconds of the steps so far.
    typed : str
        The command as it was typed.
    """

    def __init__(self) -> None:
        self._flags: Mapping[str, str] = {}
        self.as_json = False
        self.level = NORMAL
        self.warnings: list[str] = []
        self._command = self.typed = ""
        self._result: dict[str, Any] = {}
        self._written: list[dict[str, Any]] = []
        self.times: list[tuple[str, float]] = []
        self._began = time.monotonic()

    def configure(self, command: str, flags: Mapping[str, str], general: Mapping[str, Any]) -> None:
        """Set what is printed, and how the options that messages name are typed."""
        self._command, self._flags = command, flags
        quiet, verbose = general["quiet"], general["verbose"]
        if quiet and verbose:
            raise ValueError("--quiet and --verbose exclude each other")
        self.as_json = bool(general["json"])
        self.level = QUIET if quiet else VERBOSE if verbose else NORMAL

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
        text = as_typed(text, self._flags)
        if text not in self.warnings:
            self.warnings.append(text)
            self.say(f"warning: {text}")

    def stopped(self, text: str) -> None:
        """Print that the command was stopped."""
        _print_message(text)

    def fail(self, text: str) -> bool:
        """Print an error, also in the JSON object.

        Return whether it begins with the name of an option, which has a bad value then.
        """
        text = as_typed(text, self._flags)
        _print_message(f"error: {text}")
        if self.as_json:
            self._print_object(error=text)
        return text.startswith("--")

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
        return Steps(count, self.say, self.times, self.level)

    def finish(self) -> None:
        """Print the JSON object, if it is requested."""
        if self.as_json:
            self._print_object(**self._result)

    def exit_unless(self, is_met: bool) -> None:
        """End with exit code 1 if a mesh does not meet all demands."""
        import typer

        if not is_met:
            self.finish()
            raise typer.Exit(1)

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
        print(json.dumps(_plain(whole), indent=2, allow_nan=False))


def as_typed(text: str, flags: Mapping[str, str]) -> str:
    """Return a message in which options have the names that they have on the command line.

    Names that are also words count only before "must", "=" and the like.
    """
    # As in Python: strict=True, target='triangles'.
    for name, flag in flags.items():
        text = re.sub(rf"(?<![\w.-]){name}=True\b", flag, text)
        text = re.sub(rf"(?<![\w.-]){name}=(['\"])(\w+)\1", rf"{flag} \2", text)
    names = [f"{name}(?= must | = | is in )" if "_" not in name else name for name in flags]
    pattern = rf"(?<![\w.'\"-])(?:{'|'.join(names)})(?!\w|\.\w)"
    return re.sub(pattern, lambda match: flags[match[0]], text) if flags else text


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
