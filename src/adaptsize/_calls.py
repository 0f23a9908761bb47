"""Which calls made a mesh or sizes: what a record of a Python script is written from.

Functions with the decorator `recorded` remember for each result the call that made it, with plain
arguments: numbers, texts, short arrays, sources, and results of other calls by these.  Nothing is
kept alive by that, and nothing is stored unless it is requested by ``write(..., record=True)``.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

#: Longer arrays and lists are not stored.
LONGEST = 1000
#: Calls at each end of a long list that a page or a message shows.
_SHOWN = 6
#: Arguments on which no result depends.
_IGNORED = ("progress", "wants_info")


class UnknownError(ValueError):
    """A call cannot be repeated from its record."""


@dataclass(frozen=True, eq=False)
class Call:
    """One call of a function of the package."""

    function: str
    """Its public name, such as ``remesh`` or ``SimplexMesh.tag_faces``."""
    arguments: Mapping[str, Any]
    """Those given: plain values, `Result` and `Unknown`."""
    files: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Size and time of the change of each file that it read."""


@dataclass(frozen=True)
class Result:
    """What a call returned, or a part of that: an attribute or a field."""

    call: Call
    part: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unknown:
    """An argument that cannot be stored."""

    text: str


_KNOWN: dict[int, tuple[weakref.ref[Any], Result]] = {}


def origin_of(value: Any) -> Result | None:
    """Return the call that returned an object, or None if that is not known."""
    found = _KNOWN.get(id(value))
    return None if found is None or found[0]() is not value else found[1]


def recorded(name: str, *parts: str, reads: bool = False) -> Callable[[F], F]:
    """Return a decorator of a function whose calls are remembered with their results.

    Parameters
    ----------
    name : str
        The public name.
    *parts : str
        Attributes of the result that are results, too.
    reads : bool
        Whether the first argument is a file.
    """

    def decorate(function: F) -> F:
        signature = inspect.signature(function)
        first = next(iter(signature.parameters))

        @functools.wraps(function)
        def remembering(*args: Any, **kwargs: Any) -> Any:
            files = state_of(args[0] if args else kwargs.get(first)) if reads else {}
            result = function(*args, **kwargs)
            given = signature.bind(*args, **kwargs)
            call = Call(name, dict(_described(given.arguments, signature)), files)
            _remember(result, Result(call))
            for part in parts:
                _remember(getattr(result, part), Result(call, (part,)))
            return result

        remembering.__recorded__ = name  # type: ignore[attr-defined]
        return remembering  # type: ignore[return-value]

    return decorate


def _remember(value: Any, result: Result) -> None:
    key = id(value)
    try:
        _KNOWN[key] = weakref.ref(value, lambda _: _KNOWN.pop(key, None)), result
    except TypeError:  # no weak references to it
        return


def state_of(path: Any) -> dict[str, tuple[int, int]]:
    """Return size and time of change of a file, by its path."""
    if not isinstance(path, str | os.PathLike):  # polygons may be arrays
        return {}
    try:
        found = os.stat(path)
    except (OSError, ValueError):  # the function refuses it
        return {}
    return {str(os.fspath(path)): (found.st_size, found.st_mtime_ns)}


def _described(given: Mapping[str, Any], signature: inspect.Signature) -> Iterator[tuple[str, Any]]:
    """Yield names and plain values of arguments; those of ``**options`` by their own names."""
    meshes = [value for value in given.values() if hasattr(value, "point_data")]
    for name, value in given.items():
        parameter = signature.parameters[name]
        several = value if parameter.kind is parameter.VAR_KEYWORD else {name: value}
        for key, one in several.items():
            if key not in _IGNORED:
                yield key, _of_mesh(one, meshes) or describe_value(one)


def _of_mesh(value: Any, meshes: list[Any]) -> Result | None:
    """Return an array that is a field of a mesh among the other arguments."""
    if not isinstance(value, np.ndarray):
        return None
    for mesh in meshes:
        origin = origin_of(mesh)
        for kind in ("point_data", "cell_data"):
            for name, array in getattr(mesh, kind, {}).items():
                if origin is not None and array is value:
                    return Result(origin.call, (*origin.part, kind, name))
    return None


def describe_value(value: Any) -> Any:
    """Return a plain value, a `Result`, or `Unknown`.

    Examples
    --------
    >>> describe_value([1, "a", np.array([1.0, 2.0])])
    [1, 'a', {'array': [1.0, 2.0]}]
    >>> describe_value(len)
    Unknown(text='a function')
    """
    origin = origin_of(value)
    if origin is not None:
        return origin
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else {"float": str(value)}
        case Path():
            return str(value)
        case np.generic():
            return describe_value(value.item())
        case np.ndarray():
            return _of_array(value)
        case list() | tuple() if len(value) <= LONGEST:
            return [describe_value(one) for one in value]
        case Mapping() if len(value) <= LONGEST:
            return {"mapping": [[describe_value(k), describe_value(v)] for k, v in value.items()]}
    if is_dataclass(value) and type(value).__module__.startswith("adaptsize.sizes"):
        held = {one.name: describe_value(getattr(value, one.name)) for one in fields(value)}
        return {"class": type(value).__name__, "fields": held}
    return Unknown(_kind_of(value))


def _of_array(value: np.ndarray[Any, Any]) -> Any:
    if value.size > LONGEST or value.dtype.kind not in "bif":
        return Unknown(f"an array of shape {value.shape}")
    return {"array": describe_value(value.tolist())}


def _kind_of(value: Any) -> str:
    if isinstance(value, list | tuple | Mapping):
        return f"a {type(value).__name__} of {len(value)}"
    if callable(value) and not type(value).__module__.startswith("adaptsize"):
        return "a function"
    return f"a {type(value).__name__} that no recorded call returned"


def _results_in(value: Any) -> Iterator[Result]:
    """Yield the results of other calls in an argument."""
    if isinstance(value, Result):
        yield value
    elif isinstance(value, list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _results_in(one)


def in_order(last: Call) -> list[Call]:
    """Return the calls that led to the last one, each after those whose results it used."""
    order: dict[Call, None] = {}
    waiting = [last]  # not by recursion: loops make long chains
    while waiting:
        call = waiting[-1]
        needed = [one.call for value in call.arguments.values() for one in _results_in(value)]
        missing = [one for one in needed if one not in order]
        if missing:
            waiting += reversed(missing)
        else:
            order[waiting.pop()] = None
    return list(order)


def as_steps(last: Call) -> list[dict[str, Any]]:
    """Return the calls that led to the last one in their order, as values of JSON."""
    numbers = {call: number for number, call in enumerate(in_order(last))}

    def encoded(value: Any) -> Any:
        if isinstance(value, Result):
            return {"call": numbers[value.call], "part": list(value.part)}
        if isinstance(value, Unknown):
            return {"unknown": value.text}
        if isinstance(value, list):
            return [encoded(one) for one in value]
        return {k: encoded(v) for k, v in value.items()} if isinstance(value, dict) else value

    return [
        {
            "function": call.function,
            "arguments": {name: encoded(value) for name, value in call.arguments.items()},
        }
        for call in numbers
    ]


def files_of(last: Call) -> dict[str, tuple[int, int]]:
    """Return size and time of change of the files that led to a call, by their paths."""
    return {name: state for call in in_order(last) for name, state in call.files.items()}


def unknowns_of(steps: list[dict[str, Any]]) -> list[str]:
    """Return a line for each argument of some steps that cannot be stored."""
    lines = []

    def look(value: Any, where: str) -> None:
        if isinstance(value, dict) and "unknown" in value:
            lines.append(f"{where} is {value['unknown']}")
        elif isinstance(value, dict):
            for one in value.values():
                look(one, where)
        elif isinstance(value, list):
            for one in value:
                look(one, where)

    for step in steps:
        for name, value in step["arguments"].items():
            look(value, f"{name} of {step['function']}")
    return lines


def text_of_steps(steps: Sequence[Mapping[str, Any]]) -> str:
    """Return steps as a reader would write them: of long loops the first and the last ones."""
    texts = [text_of(step) for step in steps]
    if len(texts) > 2 * _SHOWN:
        texts[_SHOWN:-_SHOWN] = [f"... ({len(texts) - 2 * _SHOWN} more) ..."]
    return ", ".join(texts)


def text_of(step: Mapping[str, Any]) -> str:
    """Return a step as a reader would write it, without what other steps returned.

    Examples
    --------
    >>> text_of({"function": "remesh", "arguments": {"mesh": {"call": 0}, "hmax": 2.0}})
    'remesh(..., hmax=2.0)'
    """
    parts: list[str] = []
    for name, value in step["arguments"].items():
        if isinstance(value, dict | list):
            parts += [] if parts[-1:] == ["..."] else ["..."]
        else:
            parts.append(f"{name}={value!r}")
    return f"{step['function']}({', '.join(parts)})"


def repeated(steps: list[dict[str, Any]], paths: Mapping[str, str]) -> Any:
    """Call the functions of some steps again, and return what the last one returns.

    Parameters
    ----------
    steps : list of dict
        As `as_steps` returns them.
    paths : mapping of str to str
        Where the files are now.

    Raises
    ------
    UnknownError
        If an argument was not stored, or a step is none of this package.
    """
    missing = unknowns_of(steps)
    if missing:
        raise UnknownError("; ".join(missing))
    made: list[Any] = []

    def value_of(stored: Any) -> Any:
        if isinstance(stored, list):
            return [value_of(one) for one in stored]
        if not isinstance(stored, dict):
            return paths.get(stored, stored) if isinstance(stored, str) else stored
        match stored:
            case {"call": number, "part": part}:
                return functools.reduce(_part_of, part, made[number])
            case {"float": text}:
                return float(text)
            case {"array": values}:
                return np.array(value_of(values))
            case {"mapping": pairs}:
                return {value_of(key): value_of(one) for key, one in pairs}
            case {"class": name, "fields": held}:
                return _class_of(name)(**{key: value_of(one) for key, one in held.items()})
        raise UnknownError(f"{stored} is no stored value")

    for step in steps:
        if step["function"] == "write" and step is not steps[-1]:
            raise UnknownError("only the last step may write a file")
        arguments = {name: value_of(one) for name, one in step["arguments"].items()}
        made.append(_function_of(step["function"])(**arguments))
    return made[-1]


def _part_of(value: Any, name: str) -> Any:
    return value[name] if isinstance(value, Mapping) else getattr(value, name)


def _function_of(name: str) -> Callable[..., Any]:
    """Return a function by its public name, if its calls are recorded."""
    found: Callable[..., Any] = _public(name)
    if name != "write" and getattr(found, "__recorded__", None) != name:
        raise UnknownError(f"{name} is no function whose calls are recorded")
    return found


def _class_of(name: str) -> Callable[..., Any]:
    found = _public(name)
    if not (isinstance(found, type) and name.endswith("Source")):
        raise UnknownError(f"{name} is no source")
    return found


def _public(name: str) -> Any:
    """Return a public object of the package by its name; None if there is none."""
    import adaptsize

    found: Any = adaptsize
    for word in name.split("."):
        found = getattr(found, word, None)
    return found
