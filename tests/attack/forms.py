"""Calls with the same values in other forms: every form must give the same result.

An array of float64 may come as a list, as float32, in Fortran order, with strides, in the byte
order of other machines or read-only, a number as an integer or as a scalar of numpy, and a function
may return any of these.  All values are chosen so that the forms hold them exactly.
"""

import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import adaptsize as ads

from .arguments import fitting, kind_for, owner_of
from .calls import SLOW, bound, check_error, short
from .cases import Failure
from .subjects import Subject, subjects
from .world import make

#: Public names that hold what a result consists of, in classes that are not dataclasses.
_PARTS = (
    "points", "cells", "cell_tags", "tagged_facets", "facet_tags", "names", "levels", "active",
    "origin", "spacing", "shape", "lower", "upper", "root_shape", "values", "background", "g",
    "matrices", "mesh", "global_ids", "owner",
)  # fmt: skip

#: Integers are labels there, which are not interpolated, as documented; and in all images.
_KEEPS_INTEGERS = {
    "transfer_fields", "distributed.transfer_fields", "FieldTransfer.nodal", "FieldTransfer.cells",
    "adapt", "distributed.adapt", "write", "SimplexMesh.to_meshio",
}  # fmt: skip


#: The finite numbers of float32.
_RANGE = (float(np.finfo(np.float32).min), float(np.finfo(np.float32).max))


def run(rng: np.random.Generator, folder: Path) -> str:
    """Call a random subject twice: with float64 arrays, and with one or all arguments converted."""
    known = [subject for subject in subjects() if _has_result(subject.name)]
    subject = known[int(rng.integers(0, len(known)))]
    world = make(kind_for(subject, rng), rng)
    given = {
        name: fitting(name, str(p.annotation), world)
        for name, p in subject.parameters.items()
        if p.default is inspect.Parameter.empty or rng.random() < 0.4
    }
    names = [name for name, value in given.items() if _has_forms(value)]
    if not names:
        return f"no argument with other forms: {subject.name}"
    keeps_integers = subject.name in _KEEPS_INTEGERS or "image" in given
    whole = bool(rng.random() < 0.2) and not keeps_integers
    chosen = names if rng.random() < 0.3 else [str(rng.choice(names))]
    plain = {k: _exact(v, whole) if k in chosen else v for k, v in given.items()}
    other = {k: _converted(v, whole, rng) if k in chosen else v for k, v in plain.items()}
    owner = owner_of(subject, world) if subject.owner else None
    expected = _outcome(subject, owner, plain)
    found = _outcome(subject, owner, other)
    shown = ", ".join(f"{k}={type(v).__name__} {short(v)}" for k, v in other.items())
    what = f"{subject.name}({shown}) on {world.kind}"
    difference = _difference(expected, found, "the result")
    if difference and not _difference(expected, _outcome(subject, owner, plain), ""):
        cause = found if isinstance(found, Exception) else expected
        raise Failure(f"{difference}: {what}") from (
            cause if isinstance(cause, Exception) else None
        )
    kind = type(expected).__name__
    return f"{kind if isinstance(expected, Exception) else 'ok'}: {what}"


def _has_result(name: str) -> bool:
    """Return whether results can be compared; sources and images keep what they are given."""
    return name not in SLOW and not name.endswith(("Source", "Image"))


def _outcome(subject: Subject, owner: Any, given: dict[str, Any]) -> Any:
    """Return the result or the error of a call."""
    arguments, options = bound(subject, given)
    if owner is not None:
        arguments.insert(0, owner)
    try:
        result = subject.call(*arguments, **options)
        return list(result) if inspect.isgenerator(result) else result
    except Exception as error:
        check_error(error)
        return error


# --- values ---------------------------------------------------------------------------------------


def _has_forms(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_has_forms, value))
    if isinstance(value, dict):
        return any(map(_has_forms, value.values()))
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fiub" and value.size > 0  # an empty list has no second axis
    if isinstance(value, ads.SimplexMesh | ads.SizeFunction) or _is_source(value):
        return True
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
        return _pick(_ARRAYS[value.dtype.kind], rng, whole)(value)
    if isinstance(value, bool):
        return np.bool_(value)
    if isinstance(value, int):
        kinds = [np.int16, np.uint16, np.int64]
        kinds = [kind for kind in kinds if np.iinfo(kind).min <= value <= np.iinfo(kind).max]
        return _pick([*kinds, np.array, float], rng, False)(value)
    if isinstance(value, float):
        is_small = value.is_integer() and abs(value) < 2.0**31
        return _pick(_NUMBERS, rng, is_small)(value)
    if inspect.isfunction(value):
        change = _pick(_ARRAYS["f"], rng, whole)
        return lambda *a: change(value(*a))
    changed = _mapped(value, lambda item: _converted(item, whole, rng))
    if isinstance(changed, list | tuple) and rng.random() < 0.5:
        return list(changed)
    return changed


def _mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return the value, made again from changed parts."""
    if isinstance(value, list | tuple):
        return type(value)([change(item) for item in value])
    if isinstance(value, dict):
        return {key: change(item) for key, item in value.items()}
    if isinstance(value, ads.SimplexMesh):
        return ads.SimplexMesh(
            change(value.points), change(value.cells), cell_tags=change(value.cell_tags)
        )
    if isinstance(value, ads.SizeFunction):
        return ads.SizeFunction(value.background, change(value.values))
    if _is_source(value):
        names = [field.name for field in dataclasses.fields(value)]
        return type(value)(**{name: change(getattr(value, name)) for name in names})
    return value


def _is_source(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and type(value).__name__.endswith("Source")


def _strided(array: np.ndarray) -> np.ndarray:
    return np.repeat(array, 2, axis=0)[::2] if array.ndim else array


def _reversed(array: np.ndarray) -> np.ndarray:
    return array[::-1].copy()[::-1] if array.ndim else array


def _read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


_LAYOUTS: list[Callable[[np.ndarray], Any]] = [
    np.ndarray.tolist, np.asfortranarray, _strided, _reversed, _read_only, list,
    lambda a: a.astype(a.dtype.newbyteorder()),
]  # fmt: skip
#: Forms for arrays of a kind; those after None are for whole numbers.
_ARRAYS: dict[str, list[Callable[[Any], Any] | None]] = {
    "f": [*_LAYOUTS, lambda a: a.astype(np.float32), lambda a: a.astype(np.longdouble), None,
          lambda a: a.astype(int), lambda a: a.astype(np.int32), lambda a: a.astype(int).tolist(),
          lambda a: a.astype(np.int16)],
    "i": [*_LAYOUTS, lambda a: a.astype(np.int32), lambda a: a.astype(np.int64)],
    "u": [*_LAYOUTS],
    "b": [*_LAYOUTS],
}  # fmt: skip
_NUMBERS = [np.float32, np.float64, np.longdouble, np.array, None, int, np.int64, np.int32]


def _pick(forms: list[Any], rng: np.random.Generator, whole: bool) -> Callable[[Any], Any]:
    """Return one of the forms, of those after None only if ``whole``."""
    end = forms.index(None) if None in forms else len(forms)
    allowed = forms[end + 1 :] if whole and end < len(forms) else forms[:end]
    chosen: Callable[[Any], Any] = allowed[int(rng.integers(0, len(allowed)))]
    return chosen


# --- results --------------------------------------------------------------------------------------


def _difference(one: Any, other: Any, where: str, depth: int = 0) -> str:
    """Return where two results differ, in words, or nothing."""
    if isinstance(one, Exception) or isinstance(other, Exception):
        if type(one) is type(other):
            return ""
        return f"{type(one).__name__} becomes {type(other).__name__} {str(other)[:100]!r}"
    if type(one) is not type(other) and depth > 0 and _is_plain(one) and _is_plain(other):
        # A class that holds what it was given: the values count.
        return _difference_of_arrays(np.asarray(one, float), np.asarray(other, float), where)
    if type(one) is not type(other):
        return f"{where} is a {type(other).__name__} instead of a {type(one).__name__}"
    if isinstance(one, np.ndarray | bool | int | float | str | np.generic):
        return _difference_of_arrays(np.asarray(one), np.asarray(other), where)
    pairs = zip(_parts(one), _parts(other), strict=False) if depth < 6 else ()
    for (name, mine), (_, yours) in pairs:
        found = _difference(mine, yours, f"{where}{name}", depth + 1)
        if found:
            return found
    if isinstance(one, list | tuple | dict) and len(one) != len(other):
        return f"{where} has {len(other)} items instead of {len(one)}"
    return ""


def _is_plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return isinstance(value, np.ndarray | np.generic | bool | int | float)


def _parts(value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, list | tuple):
        return [(f"[{k}]", item) for k, item in enumerate(value)]
    if isinstance(value, dict):
        return [(f"[{key!r}]", item) for key, item in value.items()]
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value)]
    elif type(value).__module__.startswith("adaptsize"):
        fields = [name for name in _PARTS if hasattr(value, name)]
    else:
        return []
    return [(f".{name}", getattr(value, name)) for name in fields if hasattr(value, name)]


def _difference_of_arrays(one: np.ndarray, other: np.ndarray, where: str) -> str:
    if (one.dtype, one.shape) != (other.dtype, other.shape):
        return f"{where} is {other.dtype}{list(other.shape)}, not {one.dtype}{list(one.shape)}"
    if one.dtype.hasobject or np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"):
        return ""
    if one.dtype.kind != "f":
        return f"{where} has {int((one != other).sum())} other entries of {one.size}"
    with np.errstate(all="ignore"):
        worst = np.nanmax(np.abs(one - other) / np.maximum(np.abs(one), 1e-300))
    return f"{where} differs by {worst:.2g} of its value"
