"""Calls of every public function with arguments that do not fit.

A call may return, or raise an error that adaptsize raises itself, with one clear message.
Anything else is a failure: an error from the inside of numpy or another package, a warning about
a division by zero, NaN in a result that was not in an argument, a changed argument.
"""

import dataclasses
import inspect
import linecache
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numba
import numpy as np

from .cases import LONGEST, Failure, told_with
from .subjects import Subject, subjects
from .values import BAD, OfTheCaller, nonsense, spoiled
from .world import World, fitting, kind_for, make, owner_of

#: Those that make meshes are called less often, and not where kernels are plain Python.
SLOW = {
    "remesh", "remesh_to_elements", "adapt", "mesh_family", "mesh_image", "mesh_from_distance",
    "plot_size", "plot_mesh", "report",
}  # fmt: skip

#: Results that may hold NaN, and why.
_MAY_BE_NAN = {
    "level_set_curvature": "where the curvature is not known, as documented",
    "interpolate": "points outside with outside='nan', as documented",
    "CartesianGrid.sample": "what the function of the caller returns",
}


def run(rng: np.random.Generator, folder: Path) -> str:
    """Call a random subject with one or two arguments spoiled."""
    known = subjects()
    rare = 0.0 if numba.config.DISABLE_JIT else 0.15
    weights = np.array([rare if s.name in SLOW else 1.0 for s in known])
    subject = known[int(rng.choice(len(known), p=weights / weights.sum()))]
    world = make(kind_for(subject, rng), rng)
    given = arguments_for(subject, world, 0.25)
    names = list(subject.parameters)
    for _ in range(int(rng.integers(0, 3)) if names else 0):
        name = str(rng.choice(names))
        fits = given.get(name, subject.parameters[name].default)
        is_near = name in given and rng.random() < 0.5
        given[name] = spoiled(fits, rng) if is_near else nonsense(rng)
    return _checked_call(subject, given, world)


@cache
def _swept() -> list[tuple[Subject, str]]:
    return [(subject, name) for subject in subjects() for name in subject.parameters]


def n_sweep() -> int:
    """Return the number of cases of the sweep: every bad value for every parameter."""
    return len(_swept()) * len(BAD)


def sweep(number: int, rng: np.random.Generator) -> str:
    """Call a subject with one bad value, and with fitting values where they are required."""
    subject, name = _swept()[number // len(BAD) % len(_swept())]
    world = make(kind_for(subject, rng), rng)
    given = arguments_for(subject, world, 0.0) | {name: BAD[number % len(BAD)]}
    return _checked_call(subject, given, world)


def arguments_for(subject: Subject, world: World, share: float) -> dict[str, Any]:
    """Return what is required, and a share of what is not."""
    chosen = [
        name
        for name, parameter in subject.parameters.items()
        if parameter.default is inspect.Parameter.empty or world.rng.random() < share
    ]
    given = {name: fitting(name, subject.annotations[name], world) for name in chosen}
    return {k: nonsense(world.rng) if v is NotImplemented else v for k, v in given.items()}


def described(subject: Subject, given: dict[str, Any], world: World) -> str:
    """Return the call in words."""
    shown = ", ".join(f"{name}={_short(value)}" for name, value in given.items())
    return f"{subject.name}({shown}) on {world.kind}"


def _checked_call(subject: Subject, given: dict[str, Any], world: World) -> str:
    what = described(subject, given, world)
    with told_with(what):
        return f"{_outcome(subject, given, world)}: {what}"


def _outcome(subject: Subject, given: dict[str, Any], world: World) -> str:
    before = _bytes_of(given)
    has_nan = any(map(_has_nan, given.values()))
    try:
        result = call(subject, owner_of(subject, world), given)
    except OfTheCaller:
        return "raised by an argument"
    if isinstance(result, Exception):
        return type(result).__name__
    if _bytes_of(given) != before:
        raise Failure("an argument was changed")
    if not has_nan and subject.name not in _MAY_BE_NAN and _has_nan(result):
        raise Failure(f"NaN in the result {_short(result)}")
    for name, value in given.items():
        if _is_wrong(subject.annotations[name], value):
            raise Failure(f"{name}={_short(value)} was accepted")
    return "ok"


def call(subject: Subject, owner: Any, given: dict[str, Any]) -> Any:
    """Return the result, or the error if it is one that adaptsize may raise."""
    arguments: list[Any] = [owner] if subject.owner else []
    options = dict(given)
    for name, parameter in subject.parameters.items():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            arguments.append(options.pop(name, 1.0))
        elif parameter.kind is inspect.Parameter.POSITIONAL_ONLY and name in options:
            arguments.append(options.pop(name))
    try:
        result = subject.call(*arguments, **options)
        return list(result) if inspect.isgenerator(result) else result
    except OfTheCaller:
        raise
    except Exception as error:
        check_error(error)
        return error


def _is_wrong(annotation: str, value: Any) -> bool:
    """Return whether a parameter wants one number, or True or False, and did not get it."""
    kinds = {part.strip() for part in annotation.split("|")}
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
    if len(text) > LONGEST:
        raise Failure(f"a message of {len(text)} characters, {text[:100]!r}") from error
    if not text.strip():
        raise Failure(f"{type(error).__name__} without a message") from error
    if not _is_raised_by_us(error):
        raise Failure(f"{type(error).__name__} from the inside, {text[:150]!r}") from error


def _is_raised_by_us(error: Exception) -> bool:
    frames = list(_frames(error.__traceback__))
    if not any("/adaptsize/" in file for file, _ in frames):
        return isinstance(error, TypeError)  # a wrong number or name of arguments
    file, line = frames[-1]
    return "/adaptsize/" in file and linecache.getline(file, line).strip().startswith("raise")


def _frames(traceback: TracebackType | None) -> Iterator[tuple[str, int]]:
    while traceback is not None:
        yield traceback.tb_frame.f_code.co_filename, traceback.tb_lineno
        traceback = traceback.tb_next


#: Public names that hold what a result consists of, in classes that are not dataclasses.
_PARTS = (
    "points", "cells", "cell_tags", "tagged_facets", "facet_tags", "names", "levels", "active",
    "origin", "spacing", "shape", "lower", "upper", "root_shape", "values", "background", "g",
    "matrices", "mesh", "global_ids", "owner",
)  # fmt: skip


def leaves(value: Any, depth: int = 5, where: str = "") -> Iterator[tuple[str, Any]]:
    """Return the arrays, numbers and texts in a value, its items and attributes, with their place.

    Integers and floats in a container are the same.
    """
    if isinstance(value, np.ndarray):
        yield where, np.ma.getdata(value)
    elif isinstance(value, bool | int | float | np.generic) and where:
        yield where, np.asarray(value, float if np.asarray(value).dtype.kind in "fiub" else None)
    elif isinstance(value, bool | int | float | str | np.generic):
        yield where, np.asarray(value)
    elif depth == 0 or (callable(value) and not hasattr(value, "background")):
        return
    elif isinstance(value, list | tuple | set | frozenset | dict):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in items:
            yield from leaves(item, depth - 1, f"{where}[{key!r}]")
    else:
        names: Any = ()
        if dataclasses.is_dataclass(value):
            names = [field.name for field in dataclasses.fields(value)]
        elif type(value).__module__.startswith("adaptsize"):
            names = _PARTS
        for name in names:
            yield from leaves(getattr(value, name, None), depth - 1, f"{where}.{name}")


def _bytes_of(value: Any) -> list[tuple[str, str, Any]]:
    """Return what changes if an array anywhere in the value does."""
    arrays = [(place, leaf) for place, leaf in leaves(value) if isinstance(leaf, np.ndarray)]
    return [
        (place, f"{a.dtype}{a.shape}", repr(a.tolist()) if a.dtype.hasobject else a.tobytes())
        for place, a in arrays
    ]


_DOCUMENTED = (".bends", ".report.n_nodes")


def _has_nan(value: Any) -> bool:
    # To a small depth: deeper down are tables that fill up their rows with NaN.  Bends that are not
    # there and the number of nodes of domains without a mesh are NaN, as documented.
    for place, leaf in leaves(value, 2):
        is_mixed = leaf.dtype.hasobject
        a = np.array([v for v in leaf.flat if isinstance(v, float)]) if is_mixed else leaf
        if a.dtype.kind in "fc" and np.isnan(a).any() and not place.endswith(_DOCUMENTED):
            return True
    return False


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        head = " ".join(str(v) for v in value.ravel()[:4])
        return f"{value.dtype}{list(value.shape)} {head}"[:70]
    try:
        text = re.sub(r" at 0x[0-9a-f]+", "", repr(value))
    except Exception as error:
        return f"<{type(value).__name__}, whose repr raises {type(error).__name__}>"
    return text if len(text) <= 70 else text[:67] + "..."
