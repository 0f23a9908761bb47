"""Which calls made a mesh or sizes: what a record of a Python script is written from.

Functions with the decorator `recorded` remember for each result the call that made it, with plain
arguments: numbers, texts, copies of short arrays, sources, and results of other calls by these.
What a function of the package calls itself is not remembered, and meshes and sizes are not kept
alive.  A result keeps at most `LONGEST` numbers of each call that led to it, and at most
`MOST_CALLS` of these in a row.  Nothing is written unless it is requested by
``write(..., record=True)``.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import math
import numbers
import os
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from decimal import Decimal
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt

F = TypeVar("F", bound=Callable[..., Any])

#: Numbers and texts that are stored of one call.
LONGEST = 1000
#: Calls in a row, each with the result of the one before, that are stored.
MOST_CALLS = 500
#: Lists in lists that are stored.
_DEEPEST = 10
#: Bytes of an array whose checksum is found at once.
_BYTES = 1 << 18
#: Calls at each end of a long list that a page or a message shows.
_SHOWN = 6
#: Arguments on which no result depends.
IGNORED = ("progress", "wants_info")
#: Attributes of a mesh with fields by their names.
FIELDS = ("point_data", "cell_data")
#: Classes whose objects are stored by their fields, and the modules that have them.
CLASSES: Mapping[str, str] = {
    **dict.fromkeys(
        (
            "BallSource", "BoundarySource", "BoxSource", "CurveSource", "PointSource",
            "RegionSource", "CartesianGrid", "SizeFunction",
        ),
        "adaptsize",
    ),
    **dict.fromkeys(
        ("EdgeBased", "Exact", "FastMarching", "HamiltonJacobi", "PositiveCoefficient"),
        "adaptsize.limiting",
    ),
}  # fmt: skip

#: The absolute path, the size and the time of change of a file.
State: TypeAlias = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class Call:
    """One call of a function of the package."""

    function: str
    """Its public name, such as ``remesh`` or ``SimplexMesh.tag_faces``."""
    arguments: Mapping[str, Any]
    """Those given: plain values, `Numbers`, `Result` and `Unknown`."""
    files: Mapping[str, State] = field(default_factory=dict)
    """State of each file that it read, by its path as given."""
    length: int = 1
    """Calls in the longest row that ends with this one."""


@dataclass(frozen=True)
class Result:
    """What a call returned, or a part of that: attributes, places in tuples, names of fields."""

    call: Call
    part: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unknown:
    """An argument that cannot be stored."""

    text: str


@dataclass(frozen=True, eq=False)
class Numbers:
    """A read-only copy of an array."""

    values: npt.NDArray[Any]

    @classmethod
    def of(cls, array: npt.NDArray[Any]) -> Numbers:
        """Return the copy of an array; long doubles become doubles, which JSON holds."""
        dtype = np.dtype(float) if array.dtype.itemsize > 8 else array.dtype.newbyteorder("=")
        values = np.array(array, dtype, subok=False)
        values.flags.writeable = False
        return cls(values)

    def as_json(self) -> dict[str, Any]:
        """Return the numbers in a row, their type and the shape, as values of JSON."""
        flat = self.values.ravel().tolist()
        plain = [_of_float(one) if isinstance(one, float) else one for one in flat]
        shape = list(self.values.shape)
        return {"array": plain, "dtype": self.values.dtype.name, "shape": shape}


class _Known(NamedTuple):
    """An object that a call returned."""

    object: weakref.ref[Any]
    result: Result
    checksum: int | None
    """Of an array that can be written to."""


_KNOWN: dict[int, _Known] = {}
_IS_INSIDE: ContextVar[bool] = ContextVar("_IS_INSIDE", default=False)


def origin_of(value: Any) -> Result | None:
    """Return the call that returned an object, or None if not known, or if it has changed."""
    found = _KNOWN.get(id(value))
    if found is None or found.object() is not value or found.checksum != _checksum(value):
        return None
    return found.result


def inherit_origin(copy: Any, value: Any) -> None:
    """Remember for a copy which call returned the original."""
    origin = origin_of(value)
    if origin is not None:
        _remember(copy, origin)


def _checksum(value: Any) -> int | None:
    """Return a checksum of an array that users may modify; None for anything else."""
    if not (is_array(value) and value.flags.writeable):
        return None
    from adaptsize._workers import in_all_threads  # loads numba, as what made the array did

    data = np.ascontiguousarray(value).reshape(-1).view(np.uint8)
    sums = np.zeros(-(-data.size // _BYTES), np.uint32)

    def add(first: int, last: int) -> None:
        sums[first // _BYTES] = zlib.crc32(data[first:last].data)

    in_all_threads(add, data.size, _BYTES)
    return zlib.crc32(sums.data)


def recorded(name: str, *parts: str, reads: bool = False) -> Callable[[F], F]:
    """Return a decorator of a function whose calls are remembered with their results.

    That of `with_info` is remembered, too, if the function has it.

    Parameters
    ----------
    name : str
        The public name.
    *parts : str
        What else in the result is a result, as paths with dots: names of attributes, numbers in
        tuples; ``*`` is all of a tuple or a mapping.
    reads : bool
        Whether the first argument is a file.
    """

    def decorate(function: F) -> F:
        signature = inspect.signature(function)
        first = next(iter(signature.parameters))

        @functools.wraps(function)
        def remembering(*args: Any, **kwargs: Any) -> Any:
            if _IS_INSIDE.get():
                return function(*args, **kwargs)
            files: dict[str, State] = {}
            if reads:
                with contextlib.suppress(Exception):
                    files = state_of(args[0] if args else kwargs.get(first))
            token = _IS_INSIDE.set(True)
            try:
                result = function(*args, **kwargs)
            finally:
                _IS_INSIDE.reset(token)
            with contextlib.suppress(Exception):  # no result is lost for want of its record
                given = signature.bind(*args, **kwargs)
                call = call_of(name, dict(_described(given.arguments, signature)), files)
                for path, one in _parts_of(result, parts):
                    _remember(one, Result(call, path))
            return result

        changed: Any = remembering
        changed.__recorded__ = name, parts, first if reads else ""
        pair = getattr(function, "with_info", None)
        if pair is not None:
            of_pair = ["0", *(f"0.{part}" for part in parts), "1.sources"]
            changed.with_info = recorded(f"{name}.with_info", *of_pair)(pair)
        return cast("F", changed)

    return decorate


def _parts_of(result: Any, paths: Sequence[str]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield a result and the parts on some paths, with their fields, each with its place."""
    for words in ([], *(path.split(".") for path in paths)):
        for place, value in _along(words, result, ()):
            yield place, value
            for kind in FIELDS:
                held = getattr(value, kind, None)
                if isinstance(held, Mapping):
                    yield from _along([kind, "*"], value, place)


def _along(
    words: Sequence[str], value: Any, place: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not words:
        yield place, value
        return
    keys: Sequence[str] = [words[0]]
    if keys == ["*"]:
        keys = [*value] if isinstance(value, Mapping) else [*map(str, range(len(value)))]
    for key in keys:
        yield from _along(words[1:], member(value, key), (*place, key))


def member(value: Any, key: str) -> Any:
    """Return what a mapping has by a name, a tuple at a place, or an attribute.

    Examples
    --------
    >>> member({"a": (1, 2)}, "a"), member((1, 2), "1"), member(1.5, "real")
    ((1, 2), 2, 1.5)
    """
    if isinstance(value, Mapping):
        return value[key]
    if isinstance(value, tuple) and key.isascii() and key.isdecimal():
        return value[int(key)]
    return getattr(value, key)


def is_part(part: Sequence[Any], paths: Sequence[str]) -> bool:
    """Return whether a place in a result is a recorded part, or a field of one.

    Examples
    --------
    >>> paths = ["meshes.*"]
    >>> [is_part(p, paths) for p in ([], ["meshes", "0"], ["meshes", "0", "point_data", "h"])]
    [True, True, True]
    >>> [is_part(p, paths) for p in (["meshes"], ["sizes", "0"], ["meshes", "0", "points"])]
    [False, False, False]
    """
    if not all(isinstance(word, str) for word in part):
        return False
    for words in ([], *(path.split(".") for path in paths)):
        begin, rest = part[: len(words)], part[len(words) :]
        fits = len(begin) == len(words) and all(
            wanted in ("*", word) for wanted, word in zip(words, begin, strict=True)
        )
        if fits and (not rest or (len(rest) == 2 and rest[0] in FIELDS)):
            return True
    return False


def call_of(
    function: str, arguments: Mapping[str, Any], files: Mapping[str, State] | None = None
) -> Call:
    """Return a call with described arguments; results of too many calls become unknown."""
    before = [one.call.length for value in arguments.values() for one in _results_in(value)]
    length = 1 + max(before, default=0)
    if length > MOST_CALLS:
        arguments = {name: _without_results(value) for name, value in arguments.items()}
        length = 1
    return Call(function, arguments, files or {}, length)


def _without_results(value: Any) -> Any:
    """Return a described value with unknown ones instead of results."""
    if isinstance(value, Result):
        return Unknown(f"the result of a loop of more than {MOST_CALLS} calls")
    if isinstance(value, dict):
        return {key: _without_results(one) for key, one in value.items()}
    return [_without_results(one) for one in value] if isinstance(value, list) else value


def _remember(value: Any, result: Result) -> None:
    if origin_of(value) is not None:  # given, and returned as it was
        return
    key = id(value)
    try:
        known = weakref.ref(value, lambda _: _KNOWN.pop(key, None))
    except TypeError:  # no weak references to it
        return
    _KNOWN[key] = _Known(known, result, _checksum(value))


def state_of(path: Any) -> dict[str, State]:
    """Return the state of a file, by its path as given; nothing if there is no such file."""
    if not isinstance(path, str | os.PathLike):  # polygons may be arrays
        return {}
    try:
        found = os.stat(path)
    except (OSError, ValueError):  # the function refuses it
        return {}
    return {str(os.fspath(path)): (os.path.abspath(path), found.st_size, found.st_mtime_ns)}


def _described(given: Mapping[str, Any], signature: inspect.Signature) -> Iterator[tuple[str, Any]]:
    """Yield names and plain values of arguments; those of ``**options`` by their own names."""
    describe = Describer()
    for name, value in given.items():
        parameter = signature.parameters[name]
        several = value if parameter.kind is parameter.VAR_KEYWORD else {name: value}
        for key, one in several.items():
            if key not in IGNORED:
                yield key, describe(one)


class _TooMuchError(ValueError):
    """An argument is too long to be stored, or too deep."""


class Describer:
    """Plain values of the arguments of one call, at most `LONGEST` in all.

    Examples
    --------
    >>> describe = Describer()
    >>> describe([1, "a", 0.5])
    [1, 'a', 0.5]
    >>> describe(len)
    Unknown(text='a function')
    >>> describe(np.zeros(2000))
    Unknown(text='an array of shape (2000,) that no recorded call returned')
    """

    def __init__(self) -> None:
        self._left = LONGEST

    def __call__(self, value: Any) -> Any:
        """Return a plain value, `Numbers`, a `Result`, or `Unknown`."""
        left = self._left
        try:
            return self._plain(value, 0)
        except _TooMuchError:
            text = f"a {type(value).__name__} with too much in it (a record has {LONGEST} numbers)"
        except Exception:  # of a class from elsewhere
            text = _kind_of(value)
        self._left = left
        return Unknown(text)

    def _take(self, count: int, depth: int = 0) -> None:
        self._left -= count
        if self._left < 0 or depth > _DEEPEST:
            raise _TooMuchError

    def _plain(self, value: Any, depth: int) -> Any:
        origin = origin_of(value)
        if origin is not None:
            return origin
        if is_array(value) and value.size > self._left:
            return Unknown(f"an array of shape {value.shape} that no recorded call returned")
        self._take(value.size if is_array(value) else 1, depth)
        if is_array(value):
            return Numbers.of(value) if value.dtype.kind in "biuf" else Unknown(_kind_of(value))
        if value is None or isinstance(value, bool | np.bool_):
            return None if value is None else bool(value)
        if isinstance(value, str | os.PathLike):
            return self._text(os.fspath(value))
        if isinstance(value, numbers.Integral):
            return int(value) if abs(int(value)) < 2**63 else Unknown("a very large number")
        if isinstance(value, numbers.Real | Decimal):  # fractions, too
            return _of_float(float(value))
        if isinstance(value, list | tuple):
            return [self._plain(one, depth + 1) for one in value]
        if isinstance(value, Mapping):
            pairs = [[key, one] for key, one in value.items()]
            return {"mapping": [self._plain(pair, depth + 1) for pair in pairs]}
        if type(value).__name__ in CLASSES and type(value).__module__.startswith("adaptsize."):
            names = [one.name for one in fields(value)]
            held = {name: self._plain(getattr(value, name), depth + 1) for name in names}
            return {"class": type(value).__name__, "fields": held}
        return Unknown(_kind_of(value))

    def _text(self, value: Any) -> Any:
        if not isinstance(value, str):
            return Unknown(_kind_of(value))
        self._take(len(value) // 100)
        return str(value)


def _of_float(value: float) -> Any:
    return float(value) if math.isfinite(value) else {"float": str(float(value))}


def is_array(value: Any) -> bool:
    """Return whether a value is an array without a mask."""
    return isinstance(value, np.ndarray) and not isinstance(value, np.ma.MaskedArray)


def _kind_of(value: Any) -> str:
    if is_array(value):
        return f"an array of {value.dtype}"
    if isinstance(value, list | tuple | Mapping | np.ma.MaskedArray):
        return f"a {type(value).__name__}"
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
    places = {call: number for number, call in enumerate(in_order(last))}

    def encoded(value: Any) -> Any:
        if isinstance(value, Result):
            return {"call": places[value.call], "part": list(value.part)}
        if isinstance(value, Numbers):
            return value.as_json()
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
        for call in places
    ]


def files_of(last: Call) -> dict[str, State | None]:
    """Return the states of the files that led to a call, by their paths as given.

    They are None for a path by which several states were read.
    """
    found: dict[str, State | None] = {}
    for call in in_order(last):
        for name, state in call.files.items():
            found[name] = state if found.get(name, state) == state else None
    return found


def unknowns_of(steps: Sequence[Mapping[str, Any]]) -> list[str]:
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


def fault_of_steps(steps: Any) -> str:
    """Return in words why values of JSON are no steps; empty if they are."""
    if not isinstance(steps, list) or not steps:
        return f"calls must be a list of at least one call, got {steps!r:.80}"
    for number, step in enumerate(steps):
        if not (
            isinstance(step, Mapping)
            and isinstance(step.get("function"), str)
            and isinstance(step.get("arguments"), Mapping)
        ):
            return f"call {number} must have a function and arguments, got {step!r:.80}"
    return ""
