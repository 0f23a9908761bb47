"""Checks of arguments.

Every failure is a ValueError that names the argument, what is wanted, what was
given and, in an array, the first bad index.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.typing import FloatArray, IntArray


def as_float_array(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None
) -> FloatArray:
    """Return ``value`` as a C-contiguous float64 array, of ``shape`` if that is given.

    The result may share memory with ``value``; callers do not write into it.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind in "SU":
            raise TypeError("text, which numpy would take for numbers")
        array = np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {describe(value)}") from error
    if given.ndim == 0:
        array = array.reshape(())
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array


def as_points(name: str, value: npt.ArrayLike, dim: int | None = None) -> FloatArray:
    """Return finite coordinates as float64[n, dim]; any n, also 0."""
    points = as_float_array(name, value)
    wanted = "(n, dim) with dim 1, 2 or 3" if dim is None else f"(n, {dim})"
    good = points.ndim == 2 and (
        points.shape[1] in (1, 2, 3) if dim is None else points.shape[1] == dim
    )
    if not good:
        raise ValueError(f"{name} must have shape {wanted}, got {points.shape}")
    refuse_where(name, ~np.isfinite(points), points, "must be finite")
    return points


def as_index_array(
    name: str, value: npt.ArrayLike, n: int, *, width: int | None = None
) -> IntArray:
    """Return indices into n points as int32[m, width]; refuses fractions and bad indices."""
    raw = np.asarray(value)
    if raw.size == 0:
        raw = raw.astype(np.int32)
    whole = raw.dtype.kind in "iu" or (raw.dtype.kind == "f" and bool((raw == np.floor(raw)).all()))
    if not whole:
        raise ValueError(f"{name} must be integers, got {describe(value)}")
    if raw.ndim != 2 or (width is not None and raw.shape[1] != width):
        wanted = "(m, k)" if width is None else f"(m, {width})"
        raise ValueError(f"{name} must have shape {wanted}, got {raw.shape}")
    if raw.size and (raw.min() < 0 or raw.max() >= n):
        refuse_where(name, (raw < 0) | (raw >= n), raw, f"must be indices from 0 to {n - 1}")
    return np.ascontiguousarray(raw, dtype=np.int32)


def as_sizes(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return nodal sizes: positive, inf allowed, NaN refused."""
    sizes = as_float_array(name, value, shape)
    refuse_where(name, ~(sizes > 0.0), sizes, "must be positive (inf where nothing is asked)")
    return sizes


def as_number(
    name: str, value: Any, *, lower: float, strict: bool = False, allow_inf: bool = False
) -> float:
    """Return a float with ``value >= lower``, or ``> lower`` if ``strict``."""
    try:
        if isinstance(value, str | bytes):
            raise TypeError("text, which float() would take for a number")
        number = float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be a number, got {describe(value)}") from error
    bad = np.isnan(number) or (np.isinf(number) and not allow_inf)
    if bad or number < lower or (strict and number == lower):
        sign = ">" if strict else ">="
        finite = "" if allow_inf else "finite and "
        raise ValueError(f"{name} must be {finite}{sign} {lower:g}, got {number:g}")
    return number


def one_of(name: str, value: str, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``."""
    if value not in choices:
        listed = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"{name} must be one of {listed}, got {value!r}")
    return value


def refuse_where(
    name: str, bad: npt.NDArray[np.bool_], values: npt.NDArray[Any], wanted: str
) -> None:
    """Raise a ValueError that names the first entry where ``bad`` holds; do nothing if none."""
    if not bad.any():
        return
    first = np.unravel_index(int(np.argmax(bad)), bad.shape)
    where = ", ".join(str(int(i)) for i in first)
    given = f"{name}[{where}] = {values[first]}" if bad.ndim else f"{values[()]}"
    count = int(np.count_nonzero(bad))
    more = f" (and {count - 1} more)" if count > 1 else ""
    raise ValueError(f"{name} {wanted}, got {given}{more}")


def describe(value: object) -> str:
    """Return a short text for an error message: the value, or its type if it is long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{type(value).__name__} {text[:50]}..."
