"""Calls with the same values in other forms: every form must give the same result.

An array of float64 may come as a list, as float32, in Fortran order, with strides, in the byte
order of other machines or read-only, a number as an integer or as a scalar of numpy, and a function
may return any of these.  All values are chosen so that the forms hold them exactly.
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .calls import SLOW, arguments_for, call, described, leaves
from .cases import Failure, told_with
from .subjects import subjects
from .values import OfTheCaller, pick
from .world import kind_for, make, owner_of

#: Integers are labels there, which are not interpolated, as documented; and in all images.
_KEEPS_INTEGERS = {
    "transfer_fields", "FieldTransfer.nodal", "FieldTransfer.cells",
    "adapt", "write", "SimplexMesh.to_meshio",
}  # fmt: skip

#: The finite numbers of float32.
_RANGE = (float(np.finfo(np.float32).min), float(np.finfo(np.float32).max))


def run(rng: np.random.Generator, folder: Path) -> str:
    """Call a random subject twice: with float64 arrays, and with one or all arguments converted."""
    known = [subject for subject in subjects() if _has_result(subject.name)]
    subject = known[int(rng.integers(0, len(known)))]
    world = make(kind_for(subject, rng), rng)
    given = arguments_for(subject, world, 0.4)
    names = [name for name, value in given.items() if _has_forms(value)]
    if not names:
        return f"no argument with other forms: {subject.name}"
    keeps_integers = subject.name in _KEEPS_INTEGERS or "image" in given
    whole = bool(rng.random() < 0.2) and not keeps_integers
    chosen = names if rng.random() < 0.3 else [str(rng.choice(names))]
    plain = {k: _exact(v, whole) if k in chosen else v for k, v in given.items()}
    other = {k: _converted(v, whole, rng) if k in chosen else v for k, v in plain.items()}
    owner = owner_of(subject, world)
    what = described(subject, other, world)
    try:
        with told_with(what):
            expected, found = call(subject, owner, plain), call(subject, owner, other)
            difference = _difference(expected, found)
            if difference and not _difference(expected, call(subject, owner, plain)):
                raise Failure(difference)
    except OfTheCaller:
        return f"raised by an argument: {what}"
    return f"{type(expected).__name__ if isinstance(expected, Exception) else 'ok'}: {what}"


def _has_result(name: str) -> bool:
    """Return whether results can be compared; sources and images keep what they are given."""
    return name not in SLOW and not name.endswith(("Source", "Image"))


def _has_forms(value: Any) -> bool:
    if isinstance(value, list | tuple | dict):
        return any(map(_has_forms, value.values() if isinstance(value, dict) else value))
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fiub" and value.size > 0  # an empty list has no second axis
    return isinstance(value, bool | int | float) or inspect.isfunction(value)


def _exact(value: Any, whole: bool) -> Any:
    """Return a value like the given one that float32, or an integer if ``whole``, holds exactly."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.ceil(8.0 * value) if whole else value.astype(np.float32).astype(np.float64)
    if isinstance(value, float):
        if np.isfinite(value):
            value = float(np.clip(value, *_RANGE))
        return float(np.ceil(value)) if whole else float(np.float32(value))
    if inspect.isfunction(value):
        return lambda *a: _exact(np.asarray(value(*a), float), whole)
    return _mapped(value, lambda item: _exact(item, whole))


def _converted(value: Any, whole: bool, rng: np.random.Generator) -> Any:
    """Return the value in another form."""
    if isinstance(value, np.ndarray):
        return _form_of_array(value.dtype.kind, whole, rng)(value)
    if isinstance(value, bool):
        return np.bool_(value)
    if isinstance(value, int):
        ranges = map(np.iinfo, (np.int16, np.uint16, np.int64))
        kinds = [kind.dtype.type for kind in ranges if kind.min <= value <= kind.max]
        return pick(rng, [*kinds, np.array, float])(value)
    if isinstance(value, float):
        if whole and value.is_integer() and abs(value) < 2.0**31:
            return pick(rng, [int, np.int64, np.int32])(value)
        return pick(rng, [np.float32, np.float64, np.longdouble, np.array])(value)
    if inspect.isfunction(value):
        change = _form_of_array("f", whole, rng)
        return lambda *a: change(value(*a))
    changed = _mapped(value, lambda item: _converted(item, whole, rng))
    return list(changed) if isinstance(changed, tuple) and rng.random() < 0.5 else changed


def _mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return the value, made again from changed parts."""
    if isinstance(value, list | tuple):
        return type(value)([change(item) for item in value])
    if isinstance(value, dict):
        return {key: change(item) for key, item in value.items()}
    return value


_LAYOUTS: list[Callable[[np.ndarray], Any]] = [
    np.ndarray.tolist, list, np.asfortranarray,
    lambda a: np.broadcast_to(a, a.shape),  # read-only
    lambda a: np.repeat(a, 2, axis=0)[::2] if a.ndim else a,
    lambda a: a[::-1].copy()[::-1] if a.ndim else a,
    lambda a: a.astype(a.dtype.newbyteorder()),
]  # fmt: skip


def _form_of_array(kind: str, whole: bool, rng: np.random.Generator) -> Callable[[Any], Any]:
    """Return a conversion of arrays of a kind of numbers."""
    types = {"f": [np.float32, np.longdouble], "i": [np.int32, np.int64]}.get(kind, [])
    if kind == "f" and whole:
        integers = [lambda a, t=t: a.astype(t) for t in (int, np.int32, np.int16)]
        return pick(rng, [*integers, lambda a: a.astype(int).tolist()])
    return pick(rng, [*_LAYOUTS, *(lambda a, t=t: a.astype(t) for t in types)])


def _difference(one: Any, other: Any) -> str:
    """Return where two results differ, in words, or nothing."""
    if type(one) is not type(other):
        return f"{type(one).__name__} becomes {type(other).__name__} {str(other)[:100]!r}"
    if isinstance(one, Exception):
        return ""
    mine, yours = dict(leaves(one, 6)), dict(leaves(other, 6))
    if mine.keys() != yours.keys():
        return f"other parts, {sorted(mine.keys() ^ yours.keys())[:5]}"
    for place, a in mine.items():
        b, where = yours[place], f"the result{place}"
        if (a.dtype, a.shape) != (b.dtype, b.shape):
            return f"{where} is {b.dtype}{list(b.shape)}, not {a.dtype}{list(a.shape)}"
        if not (a.dtype.hasobject or np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")):
            return f"{where} has {int((a != b).sum())} other entries of {a.size}"
    return ""
