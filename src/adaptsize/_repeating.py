"""Calls of a record, made again: nothing runs but recorded functions with stored values."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from adaptsize._calls import (
    CLASSES,
    IGNORED,
    fault_of_steps,
    is_array,
    is_part,
    member,
    unknowns_of,
)


class UnknownError(ValueError):
    """A call cannot be repeated from its record."""


def repeated(steps: Sequence[Mapping[str, Any]], paths: Mapping[str, str]) -> Any:
    """Call the functions of some steps again, and return what the last one returns.

    Nothing but functions whose calls are recorded is called, with nothing but stored values,
    sources and results of steps before.

    Parameters
    ----------
    steps : sequence of mappings
        As `as_steps` returns them.  They may come from anywhere.
    paths : mapping of str to str
        Where the files are now.  No others are read.

    Raises
    ------
    UnknownError
        If an argument was not stored, or a step is none of this package.
    """
    fault = fault_of_steps(steps) or "; ".join(unknowns_of(steps))
    if fault:
        raise UnknownError(fault)
    if any(step["function"] == "write" for step in steps[:-1]):
        raise UnknownError("only the last step may write a file")
    decode = Decoder(paths)
    for number, step in enumerate(steps):
        name = step["function"]
        function, _, reads = _function_of(name)
        try:
            arguments = {key: decode(one) for key, one in step["arguments"].items()}
            ignored = arguments.keys() & set(IGNORED)
            if ignored:
                raise UnknownError(f"{min(ignored)} is no stored argument")
            _check_file(step["arguments"].get(reads), paths)
            decode.made.append((name, function(**arguments)))
        except UnknownError:
            raise
        except (TypeError, AttributeError, LookupError, OverflowError, ValueError) as error:
            raise UnknownError(f"call {number} ({name}) cannot be repeated: {error}") from error
    return decode.made[-1][1]


def _check_file(file: Any, paths: Mapping[str, str]) -> None:
    """Refuse to read a file that is none of the inputs."""
    if isinstance(file, str) and file not in paths:
        raise UnknownError(f"{file} is none of the inputs")


class Decoder:
    """Values from what is stored of them."""

    def __init__(self, paths: Mapping[str, str]) -> None:
        self._paths = paths
        self.made: list[tuple[str, Any]] = []
        """Names of the functions called so far, and what they returned."""

    def __call__(self, stored: Any) -> Any:
        """Return a value, or raise `UnknownError`."""
        if isinstance(stored, list):
            return [self(one) for one in stored]
        if not isinstance(stored, dict):
            return self._paths.get(stored, stored) if isinstance(stored, str) else stored
        match stored:
            case {"call": int(number), "part": list(part)}:
                return self._result(number, part)
            case {"float": str(text)}:
                return float(text)
            case {"array": list(values), "dtype": str(dtype), "shape": list(shape)}:
                if np.dtype(dtype).kind not in "biuf":
                    raise UnknownError(f"{dtype} is no type of numbers")
                return np.array(self(values), dtype).reshape(shape)
            case {"mapping": list(pairs)}:
                return {self(key): self(one) for key, one in pairs}
            case {"class": str(name), "fields": dict(held)}:
                return _class_of(name)(**{key: self(one) for key, one in held.items()})
        raise UnknownError(f"{stored!r:.80} is no stored value")

    def _result(self, number: int, part: list[Any]) -> Any:
        """Return the result of a call before, or one of the parts of it that are recorded."""
        if not 0 <= number < len(self.made):
            raise UnknownError(f"call {number} is none of those before")
        name, value = self.made[number]
        _, parts, _ = _function_of(name)
        if not is_part(part, parts):
            raise UnknownError(f"{part!r:.80} is no recorded part of what {name} returned")
        for word in part:
            value = member(value, word)
        if not (is_array(value) or type(value).__module__.partition(".")[0] == "adaptsize"):
            raise UnknownError(f"{name} returned no mesh, sizes or image")
        return value


def _function_of(name: str) -> tuple[Callable[..., Any], tuple[str, ...], str]:
    """Return a function by its public name, if its calls are recorded.

    Also which parts of its results are recorded, and which argument is a file that it reads.
    """
    found: Callable[..., Any] = _public(name)
    if name == "write":
        return found, (), ""
    recorded_name, parts, reads = getattr(found, "__recorded__", (None, (), ""))
    if recorded_name != name:
        raise UnknownError(f"{name} is no function whose calls are recorded")
    return found, parts, reads


def _class_of(name: str) -> Callable[..., Any]:
    if name not in CLASSES:
        raise UnknownError(f"{name} is no class whose objects are stored")
    found: Callable[..., Any] = getattr(importlib.import_module(CLASSES[name]), name)
    return found


def _public(name: str) -> Any:
    """Return a public object of the package by its name; None if there is none."""
    import adaptsize

    found: Any = adaptsize
    for word in name.split("."):
        found = None if word.startswith("_") else getattr(found, word, None)
    return found
