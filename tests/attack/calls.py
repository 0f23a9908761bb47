"""Calls of every public function with arguments that do not fit.

A call may return, or raise an error that adaptsize raises itself, with one clear message.
Anything else is a failure: an error from the inside of numpy or another package, a warning about
a division by zero, NaN in a result that was not in an argument, a changed argument.
"""

import dataclasses
import hashlib
import inspect
import linecache
import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from .arguments import fitting, kind_for, owner_of
from .cases import Failure
from .nonsense import OfTheCaller, nonsense, spoiled
from .subjects import Subject, subjects
from .world import make

#: Those that make meshes in child processes are called less often.
SLOW = {"remesh", "adapt", "mesh_image", "mesh_from_distance", "plot_size", "plot_mesh"}

_LONGEST = 1000

#: Results that may hold NaN, and why.
_MAY_BE_NAN = {
    "level_set_curvature": "where the curvature is not known, as documented",
    "interpolate": "points outside with outside='nan', as documented",
    "CartesianGrid.sample": "what the function of the caller returns",
}


def run(rng: np.random.Generator, folder: Path) -> str:
    """Call a random subject with one or two arguments spoiled."""
    known = subjects()
    weights = np.array([0.15 if s.name in SLOW else 1.0 for s in known])
    subject = known[int(rng.choice(len(known), p=weights / weights.sum()))]
    world = make(kind_for(subject, rng), rng)
    given = {
        name: fitting(name, str(p.annotation), world)
        for name, p in subject.parameters.items()
        if p.default is inspect.Parameter.empty or rng.random() < 0.25
    }
    names = list(subject.parameters)
    for _ in range(int(rng.integers(0, 3))):
        if not names:
            break
        name = str(rng.choice(names))
        fits = given.get(name, subject.parameters[name].default)
        is_near = name in given and rng.random() < 0.5
        given[name] = spoiled(fits, rng) if is_near else nonsense(rng)
    what = f"{subject.name}({', '.join(f'{k}={short(v)}' for k, v in given.items())})"
    what += f" on {world.kind}"
    try:
        outcome = _call(subject, given, world)
    except Failure as failure:
        raise Failure(f"{failure}: {what}") from failure.__cause__
    return f"{outcome}: {what}"


def _call(subject: Subject, given: dict[str, Any], world: Any) -> str:
    before = _digest(given)
    has_nan = any(_has_nan(value) for value in given.values())
    arguments, options = bound(subject, given)
    if subject.owner:
        arguments.insert(0, owner_of(subject, world))
    try:
        result = subject.call(*arguments, **options)
        if inspect.isgenerator(result):
            result = list(result)
    except OfTheCaller:
        return "raised by an argument"
    except Exception as error:
        check_error(error)
        return f"{type(error).__name__}"
    if _digest(given) != before:
        raise Failure("an argument was changed")
    if not has_nan and subject.name not in _MAY_BE_NAN and _has_nan(result):
        raise Failure(f"NaN in the result {short(result)}")
    for name, parameter in subject.parameters.items():
        if name in given and _is_wrong(str(parameter.annotation), given[name]):
            raise Failure(f"{name}={short(given[name])} was accepted")
    return "ok"


def bound(subject: Subject, given: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
    """Return positional and keyword arguments as the signature wants them."""
    arguments: list[Any] = []
    options = dict(given)
    for name, parameter in subject.parameters.items():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            arguments.append(options.pop(name, 1.0))
        elif parameter.kind is inspect.Parameter.POSITIONAL_ONLY and name in options:
            arguments.append(options.pop(name))
    return arguments, options


def _is_wrong(annotation: str, value: Any) -> bool:
    """Return whether a parameter wants one number, or True or False, and did not get it."""
    kinds = {part.strip() for part in annotation.strip("'\"").split("|")}
    if kinds == {"bool"}:
        return not isinstance(value, bool | np.bool_)
    if not kinds & {"float", "int"} or kinds - {"float", "int", "None"}:
        return False
    if value is None and "None" in kinds:
        return False
    try:
        return isinstance(value, str | bytes) or bool(np.isnan(float(value)))
    except (TypeError, ValueError, OverflowError, OfTheCaller):
        return True


def check_error(error: Exception) -> None:
    """Raise a `Failure` unless adaptsize raises this error itself, with a clear message."""
    text = str(error)
    if isinstance(error, MemoryError) and text:
        return  # numpy names the size
    if len(text) > _LONGEST:
        raise Failure(f"a message of {len(text)} characters, {text[:100]!r}") from error
    if not text.strip():
        raise Failure(f"{type(error).__name__} without a message") from error
    if not _is_raised_by_us(error):
        raise Failure(f"{type(error).__name__} from the inside, {text[:150]!r}") from error


def _is_raised_by_us(error: Exception) -> bool:
    frames = list(_frames(error.__traceback__))
    ours = [f for f in frames if "/adaptsize/" in f[0]]
    if not ours:  # a wrong number or name of arguments
        return isinstance(error, TypeError)
    file, line = frames[-1]
    if "/adaptsize/" not in file:
        return False
    return linecache.getline(file, line).strip().startswith("raise")


def _frames(traceback: TracebackType | None) -> Iterator[tuple[str, int]]:
    while traceback is not None:
        yield traceback.tb_frame.f_code.co_filename, traceback.tb_lineno
        traceback = traceback.tb_next


def _digest(value: Any) -> str:
    """Return a number that changes if an array anywhere in the value does."""
    total = hashlib.sha1()
    for array in _arrays(value, 0):
        total.update(repr((array.shape, str(array.dtype))).encode())
        total.update(repr(array.tolist()).encode() if array.dtype.hasobject else array.tobytes())
    return total.hexdigest()


def _has_nan(value: Any) -> bool:
    if isinstance(value, float):
        return bool(np.isnan(value))
    # From 3 on: deeper down are tables that fill up their rows with NaN.
    return any(map(_holds_nan, _arrays(value, 3)))


def _holds_nan(array: np.ndarray) -> bool:
    if array.dtype.hasobject:
        return any(isinstance(item, float) and np.isnan(item) for item in array.flat)
    return array.dtype.kind in "fc" and bool(np.isnan(array).any())


def _arrays(value: Any, depth: int) -> Iterator[np.ndarray]:
    """Return the arrays in a value, its items and its attributes."""
    if depth > 4 or (callable(value) and not hasattr(value, "background")):
        return
    if isinstance(value, np.ndarray):
        yield np.ma.getdata(value)
    elif isinstance(value, float | np.floating):
        yield np.asarray(value)
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            yield from _arrays(item, depth + 1)
    elif isinstance(value, dict):
        for item in value.values():
            yield from _arrays(item, depth + 1)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from _arrays(getattr(value, field.name, None), depth + 1)
    elif type(value).__module__.startswith("adaptsize"):
        for name in ("points", "cells", "levels", "active", "values"):
            yield from _arrays(getattr(value, name, None), depth + 1)


def short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        head = " ".join(str(v) for v in value.ravel()[:4])
        return f"{value.dtype}{list(value.shape)} {head}"[:70]
    try:
        text = re.sub(r" at 0x[0-9a-f]+", "", repr(value))
    except Exception as error:
        return f"<{type(value).__name__}, whose repr raises {type(error).__name__}>"
    return text if len(text) <= 70 else text[:67] + "..."
