"""Checks of arguments.

Every failure is a ValueError that names the argument, the requirement, the given
value and, for an array, the first bad index.
"""

import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._messages import Message
from adaptsize.errors import InputWarning, OptionError
from adaptsize.typing import FloatArray, IntArray

T = TypeVar("T")

#: Squares of gradients times four lengths must stay in the range of float64.  The squares of
#: flatter ones would underflow; their effect on sizes is below rounding.
STEEPEST, FLATTEST = 1e30, 1e-30
#: Products of four lengths and two such gradients must stay in the range of float64.
FARTHEST = 1e60
NEAREST = 1e-60
#: Whether values come from options that were checked before, so that no warning is repeated.
_WAS_CHECKED: ContextVar[bool] = ContextVar("_WAS_CHECKED", default=False)


def as_plain_array(name: str, value: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return ``value`` as an array of any type.  Refuse masked entries: numpy would unmask them.

    The result may share memory with ``value``; callers do not write into it.
    """
    rows = value if isinstance(value, list | tuple) else ()
    for number, part in enumerate((value, *rows), start=-1):
        if isinstance(part, np.ma.MaskedArray):
            where = name if number < 0 else f"{name}[{number}]"
            masked = np.ma.getmaskarray(part)
            refuse_where(where, masked, part, "must not have masked entries (see numpy.ma.filled)")
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {describe(value)}") from error


def as_float_array(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None
) -> FloatArray:
    """Return ``value`` as a C-contiguous float64 array, of ``shape`` if that is given.

    The result may share memory with ``value``; callers do not write into it.
    """
    raw = as_plain_array(name, value)
    if raw.dtype.kind == "c":
        raise ValueError(f"{name} must be real, got {raw.dtype} of shape {raw.shape}")
    try:
        if np.asarray(raw).dtype.kind in "SU":
            raise TypeError("text, which numpy would take for numbers")
        if raw.dtype.hasobject and any(item is None for item in raw.flat):
            raise TypeError("None, which numpy would take for NaN")
        array = np.ascontiguousarray(raw, dtype=np.float64).reshape(raw.shape)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {describe(value)}") from error
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array


def as_points(name: str, value: npt.ArrayLike, dim: int | None = None) -> FloatArray:
    """Return finite coordinates as float64[n, dim], for any n including 0."""
    points = as_float_array(name, value)
    known = (1, 2, 3) if dim is None else (dim,)
    if points.ndim != 2 or points.shape[1] not in known:
        wanted = "(n, dim) with dim 1, 2 or 3" if dim is None else f"(n, {dim})"
        is_transposed = points.ndim == 2 and len(points) in known
        hint = f"; {name} is transposed" if is_transposed else ""
        raise ValueError(f"{name} must have shape {wanted}, got {points.shape}{hint}")
    _refuse_infinite(name, points)
    return points


def as_nodes(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return coordinates as `as_points` does, if products of lengths are in range."""
    points = as_points(name, value)
    check_range(name, points)
    return points


def as_near_points(name: str, value: npt.ArrayLike, dim: int) -> FloatArray:
    """Return coordinates as `as_points` does, if they are as near as those of meshes."""
    points = as_points(name, value, dim)
    _refuse_far(name, points)
    return points


def as_values(name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Return finite numbers as `as_float_array` does, if their squares are in range."""
    values = as_float_array(name, value, shape)
    _refuse_infinite(name, values)
    _refuse_far(name, values)
    return values


def _refuse_infinite(name: str, values: FloatArray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()
    if not np.isfinite(total):  # one pass without an array; the sum of finite ones may overflow
        refuse_where(name, ~np.isfinite(values), values, "must be finite")


def _refuse_far(name: str, values: FloatArray) -> None:
    refuse_where(name, np.abs(values) > FARTHEST, values, f"must be at most {FARTHEST:g} in size")


def holds_whole_numbers(array: npt.NDArray[Any]) -> bool:
    """Return whether an array has integers or floats without a fraction only."""
    if array.dtype.kind == "f":
        return bool((np.isfinite(array) & (array == np.floor(array))).all())
    return array.dtype.kind in "iu"


def as_index_array(
    name: str, value: npt.ArrayLike, n: int, *, width: int | None = None
) -> IntArray:
    """Return indices into n points as int32[m, width].  Refuse fractions and bad indices."""
    raw = as_plain_array(name, value)
    if raw.size == 0:
        raw = raw.astype(np.int32)
    if not holds_whole_numbers(raw):
        raise ValueError(f"{name} must be integers, got {describe(value)}")
    if raw.ndim != 2 or (width is not None and raw.shape[1] != width):
        wanted = "(m, k)" if width is None else f"(m, {width})"
        raise ValueError(f"{name} must have shape {wanted}, got {raw.shape}")
    # Negative integers are large unsigned ones, which saves a pass.
    unsigned = raw.view(raw.dtype.str.replace("i", "u")) if raw.dtype.kind == "i" else raw
    if raw.size and not (unsigned.max() < n and (raw.dtype.kind != "f" or raw.min() >= 0)):
        refuse_where(name, (raw < 0) | (raw >= n), raw, f"must be indices from 0 to {n - 1}")
    return np.ascontiguousarray(raw, dtype=np.int32)


def as_sizes(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return nodal sizes: positive, inf allowed, NaN refused."""
    sizes = as_float_array(name, value)
    if sizes.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {sizes.shape}; one per node")
    if not sizes.min(initial=np.inf) > 0.0:  # also if any is NaN
        refuse_where(name, ~(sizes > 0.0), sizes, "must be positive (inf where there is no bound)")
    return sizes


def as_sizes_at(name: str, size: Any, points: FloatArray) -> FloatArray:
    """Return sizes at points: those of a function, one per point, or one number for all."""
    shape = (len(points),)
    if callable(size):
        return as_sizes(f"{name}(points)", size(points) if len(points) else np.empty(0), shape)
    given = as_float_array(name, size)
    if given.ndim == 0:
        given = np.full(shape, as_sizes(name, given, ()))
    return as_sizes(name, given, shape)


def as_number(
    name: str,
    value: Any,
    *,
    lower: float,
    strict: bool = False,
    allow_inf: bool = False,
    within: tuple[float, float] = (NEAREST, FARTHEST),
    upper: float | None = None,
    unit: str = "",
) -> float:
    """Return a float with ``value >= lower``, or ``> lower`` if ``strict``, and ``<= upper``.

    Positive numbers but inf are ``within`` a range, so that they can be squared and divided by.
    An angle in ``unit`` degrees that looks like one in radians causes a warning.
    """
    try:
        if isinstance(value, str | bytes) or np.iscomplexobj(value) or value is np.ma.masked:
            raise TypeError("text, which float() would take for a number, or a complex number")
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise refusal(name, f"must be a number, got {describe(value)}") from error
    bad = np.isnan(number) or (np.isinf(number) and not allow_inf)
    if bad or number < lower or (strict and number == lower):
        sign = ">" if strict else ">="
        finite = "" if allow_inf else "finite and "
        raise refusal(name, f"must be {finite}{sign} {lower:g}, got {number:g}")
    if upper is not None and number > upper:
        raise refusal(name, f"must be at most {upper:g}{unit and ' '}{unit}, got {number:g}")
    # Angles of edges are hardly smaller than 3 degrees: this looks like radians.
    if unit == "degrees" and 0.0 < number <= 3.2 and not were_checked():
        text = f"is in degrees, got {number:g}; if this is in radians, pass "
        warn_caller(Message.about(name, f"{text}{np.degrees(number):.4g}"), InputWarning)
    least, most = within
    if 0.0 < number < least:
        raise refusal(name, f"must be at least {least:g}, got {number:g}")
    if most < number < np.inf:
        raise refusal(name, f"must be at most {most:g}, got {number:g}")
    return number


def as_limits(
    hmin: float | None, hmax: float | None, *, allow_inf: bool = False
) -> tuple[float, float]:
    """Return the smallest and the largest size, 0 and inf where they are not given."""
    lower = 0.0 if hmin is None else as_number("hmin", hmin, lower=0.0, strict=True)
    upper = np.inf
    if hmax is not None:
        upper = as_number("hmax", hmax, lower=0.0, strict=True, allow_inf=allow_inf)
    if lower > upper:
        raise OptionError(Message("{hmin} must be at most {hmax} = {:g}, got {:g}", upper, lower))
    return lower, upper


def as_slope(name: str, value: Any) -> float:
    """Return a gradient limit: 0 to 1e30; one below 1e-30 is 0."""
    slope = as_number(name, value, lower=0.0, within=(0.0, STEEPEST))
    return slope if slope >= FLATTEST else 0.0


def as_slopes(name: str, values: FloatArray) -> FloatArray:
    """Return one gradient limit or several, each in the range of `as_slope`."""
    if values.ndim == 0:
        return np.asarray(as_slope(name, values))
    refuse_where(name, ~(values >= 0.0) | np.isinf(values), values, "must be finite and >= 0")
    refuse_where(name, values > STEEPEST, values, f"must be at most {STEEPEST:g}")
    return np.where(values < FLATTEST, 0.0, values)


def as_aspect(name: str, value: Any) -> float:
    """Return a ratio of sizes in different directions, which float64 resolves."""
    return as_number(name, value, lower=1.0, upper=1e15)


def as_tolerance(name: str, value: Any) -> float:
    """Return a tolerance of the boundary: > 0 and at most 1, relative to the diagonal."""
    return as_number(name, value, lower=0.0, strict=True, upper=1.0)


def as_angle(name: str, value: Any) -> float:
    """Return an angle of 0 to 180 degrees."""
    return as_number(name, value, lower=0.0, upper=180.0, unit="degrees")


def as_whole_number(name: str, value: Any, *, lower: int, upper: int) -> int:
    """Return an integer from ``lower`` to ``upper``.  Floats without a fraction are accepted."""
    number = as_number(name, value, lower=lower)
    if number != int(number):
        raise refusal(name, f"must be a whole number, got {describe(value)}")
    if number > upper:
        raise refusal(name, f"must be at most {upper}, got {number:g}")
    return int(number)


def as_threads(value: Any) -> int | None:
    """Return a number of threads; None stands for the default."""
    return None if value is None else as_whole_number("threads", value, lower=1, upper=10_000)


def check_range(name: str, points: FloatArray) -> None:
    """Raise a ValueError unless products of four lengths stay in the range of float64."""
    farthest = max(float(points.max(initial=0.0)), -float(points.min(initial=0.0)))
    if farthest != 0.0 and not NEAREST <= farthest <= FARTHEST:
        raise ValueError(
            f"{name} must have coordinates of {NEAREST:g} to {FARTHEST:g} in size, "
            f"got {farthest:g} as the largest: choose another unit of length"
        )


def check_type(name: str, value: object, *kinds: type) -> None:
    """Raise a ValueError if ``value`` is not an instance of one of these classes."""
    if not isinstance(value, kinds):
        raise _refusal_of_type(name, value, kinds)


def of_type(name: str, value: object, kind: type[T]) -> T:
    """Return ``value`` if it is an instance of a class, else raise a ValueError."""
    if not isinstance(value, kind):
        raise _refusal_of_type(name, value, (kind,))
    return value


def _refusal_of_type(name: str, value: object, kinds: tuple[type, ...]) -> ValueError:
    """Return the error for a value of another class."""
    named = [f"{'an' if kind.__name__[0] in 'AEIO' else 'a'} {kind.__name__}" for kind in kinds]
    wanted = " or ".join([", ".join(named[:-1]), named[-1]] if named[:-1] else named)
    takes_mesh = any(kind.__name__ == "SimplexMesh" for kind in kinds)
    is_path = isinstance(value, str | os.PathLike)
    hint = "; read(path) gives one" if takes_mesh and is_path else ""
    if takes_mesh and type(value).__name__ == "Image":
        hint = "; mesh_image(image) gives one"
    return ValueError(f"{name} must be {wanted}, got {describe(value)}{hint}")


def check_function(name: str, value: object, of: str) -> None:
    """Raise a ValueError if ``value`` cannot be called; ``of`` says with what it is called."""
    if not callable(value):
        raise ValueError(f"{name} must be a function of {of}, got {describe(value)}")


def one_of(name: str, value: str, choices: tuple[str, ...], *, or_none: bool = False) -> str:
    """Return ``value`` if it is one of ``choices``; None has been accepted before, if it may be."""
    if not isinstance(value, str) or value not in choices:
        listed = ", ".join(repr(choice) for choice in choices) + (" or None" if or_none else "")
        raise refusal(name, f"must be one of {listed}, got {describe(value)}")
    return value


def as_flag(name: str, value: Any) -> bool:
    """Return True or False.  Refuse everything else, such as an array or text."""
    if not isinstance(value, bool | np.bool_):
        raise refusal(name, f"must be True or False, got {describe(value)}")
    return bool(value)


def as_path(name: str, value: Any) -> Path:
    """Return the path of a file."""
    is_good = isinstance(value, str | os.PathLike)
    if is_good:
        try:
            text = os.fsencode(value)
        except UnicodeEncodeError:
            is_good = False
        else:  # no system has longer paths, and its own message would repeat all of it
            is_good = len(text) <= 4096 and b"\0" not in text
    if not is_good:
        raise refusal(name, f"must be the path of a file, got {describe(value)}")
    return Path(value)


def refuse_where(
    name: str,
    bad: npt.NDArray[np.bool_],
    values: npt.NDArray[Any],
    wanted: str,
    kind: type[ValueError] = ValueError,
) -> None:
    """Raise an error that names the first entry where ``bad`` holds, if there is one."""
    if not bad.any():
        return
    first = np.unravel_index(int(np.argmax(bad)), bad.shape)
    where = ", ".join(str(int(i)) for i in first)
    entry = " ".join(str(values[first]).split())  # a matrix in one line
    given = f"{name}[{where}] = {entry}" if bad.ndim else f"{values[()]}"
    count = int(np.count_nonzero(bad))
    more = f" (and {count - 1} more)" if count > 1 else ""
    raise kind(Message.about(name, Message("{}, got {}{}", wanted, given, more)))


def refusal(name: str, text: str) -> OptionError:
    """Return the error for an option, or another argument, whose value is refused."""
    return OptionError(Message.about(name, text))


def describe(value: object) -> str:
    """Return a short text for an error message: the value, or its type if it is long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{type(value).__name__} {text[:50]}..."


#: Modules through which functions of this package call each other: properties, contexts, threads.
_BETWEEN = ("contextlib", "functools", "concurrent", "threading")


@contextmanager
def checked_before() -> Iterator[None]:
    """Pass on options that were checked: what is unusual in them was warned of, or is derived."""
    token = _WAS_CHECKED.set(True)
    try:
        yield
    finally:
        _WAS_CHECKED.reset(token)


def were_checked() -> bool:
    """Return whether options come from a function that has checked them."""
    return _WAS_CHECKED.get()


def warn_caller(text: str, category: type[Warning]) -> None:
    """Issue a warning for the line outside of this package from which it was called.

    Modules are compared, not files: the ``__init__`` of a dataclass is in no file.
    """
    inside = (__name__.partition(".")[0], *_BETWEEN)
    frame = sys._getframe(1)
    while _top_module(frame) in inside and frame.f_back is not None:
        frame = frame.f_back
    warnings.warn_explicit(
        category(text),
        category,
        frame.f_code.co_filename,
        frame.f_lineno,
        module=frame.f_globals.get("__name__"),
        registry=frame.f_globals.setdefault("__warningregistry__", {}),
    )


def warn_again(held: Iterable[warnings.WarningMessage]) -> None:
    """Issue warnings that were held back, where they were issued first."""
    for one in held:
        warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def _top_module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0]


def count_text(number: float) -> str:
    """Return about how many there are, for a message: two digits, without an exponent.

    Examples
    --------
    >>> count_text(11484.8)
    '11000'
    """
    return f"{float(f'{number:.2g}'):.0f}"


def length_text(length: float, whole: float, name: str = "diagonal") -> str:
    """Return a length in the unit of the coordinates, and its share of another, for a message.

    Examples
    --------
    >>> length_text(0.5, 1000.0)
    '0.5 (0.0005 of the diagonal)'
    """
    return f"{length:.3g} ({length / whole:.3g} of the {name})"


def place_text(point: Iterable[float], digits: int = 6) -> str:
    """Return coordinates for a message, without exponents and without what is only rounding.

    Examples
    --------
    >>> place_text([1e6, 0.5, 1e-13])
    '(1000000, 0.5, 0)'
    """
    values = [float(x) for x in point]
    largest = max(map(abs, values), default=0.0)

    def text(x: float) -> str:
        x = 0.0 if abs(x) < 1e-12 * largest else x
        short = f"{x:.{digits}g}"
        return f"{x:.1f}".removesuffix(".0") if "e+" in short and abs(x) < 1e15 else short

    return f"({', '.join(map(text, values))})"
