"""Values that no argument should have, and spoiled copies of values that fit."""

import decimal
import fractions
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import adaptsize as ads

from .world import any_background


class OfTheCaller(Exception):
    """Raised by a function that is passed as an argument; it must come through."""


class _NoArray:
    def __array__(self, dtype=None, copy=None):
        raise OfTheCaller("no array")


class _NoNumber:
    def __float__(self):
        raise OfTheCaller("no number")


def _raises(*arguments, **options):
    raise OfTheCaller("by the function")


_NUMBERS = (
    np.nan, np.inf, -np.inf, -1.0, 0.0, -0.0, 0.5, 0.999999, -1e30, 1e9, 1e30, 1e60, 1e100, 1e155,
    1e300, 1e308, 1e-12, 1e-30, 1e-60, 1e-100, 1e-155, 1e-300, 5e-324, 180.0, 360.0, 1, 0, -1, 2,
    3, 7, 10**30, 2**31, 2**63, -(2**63), True, False, np.int8(3), np.float32(0.3),
    np.float64(np.nan), np.bool_(True), 1j, complex(0.3, 0.0), decimal.Decimal("0.3"),
    fractions.Fraction(1, 3), decimal.Decimal("nan"),
)  # fmt: skip

_OBJECTS: tuple[Any, ...] = (
    None, "", "abc", "0.1", "nan", "auto", "x" * 5000, "a\nb", "\0", b"abc", b"", (), [], {}, set(),
    [[]], [[1.0], [1.0, 2.0]], [None], ["a"], {"a": 1.0}, {1: 2}, {"h": None}, range(3),
    range(0),
    slice(1), Ellipsis, NotImplemented, object(), np, ValueError("x"), _NoArray(),
    _NoNumber(), Path("nowhere"), Path(), np.datetime64("2026-01-01"), np.ma.masked,
    memoryview(b"ab"),
    [1, [2, 3]], "héé\ud800", [np.nan], [np.inf, -np.inf], [0.0], [1e300], [-1], [10**30],
    (0.1, 0.2), (0.1, 0.2, 0.3), [0.1] * 4, {"a": {"b": 1}}, frozenset({1}), [True, False],
)  # fmt: skip

_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    _raises,
    lambda *a, **k: None,
    lambda *a, **k: np.nan,
    lambda *a, **k: np.inf,
    lambda *a, **k: -1.0,
    lambda *a, **k: 0.0,
    lambda *a, **k: "abc",
    lambda *a, **k: np.empty(0),
    lambda *a, **k: np.full(3, 0.2),
    lambda x, *a, **k: np.full(len(x), np.nan),
    lambda x, *a, **k: np.full(len(x), np.inf),
    lambda x, *a, **k: np.full(len(x), -1.0),
    lambda x, *a, **k: np.full(len(x), 1e300),
    lambda x, *a, **k: np.full(len(x) + 1, 0.2),
    lambda x, *a, **k: np.full((len(x), 1), 0.2),
    lambda x, *a, **k: np.full(len(x), 0.2j),
    lambda x, *a, **k: np.where(np.arange(len(x)) == 1, np.nan, 0.2),
    lambda x, *a, **k: len(x),
)

_ARRAYS = (
    np.empty(0), np.empty((0, 2)), np.empty((0, 3)), np.empty((3, 0)), np.zeros((2, 2, 2, 2)),
    np.array(None), np.array([1, None]), np.array("a"), np.array(["a", "b"]), np.array(0.3),
    np.array([0.3, 1j]), np.array([np.nan, 1.0]), np.ones(3), np.ones((4, 2)), np.ones((4, 3)),
    np.eye(3), np.zeros((3, 3), int), np.array([[0, 1, 2]]), np.array([[0, 0, 0]]),
    np.array([[-1, 0, 1]]), np.array([[0, 1, 10**9]]), np.array([[0.5, 1.0, 2.0]]),
    np.ma.array([1.0, 2.0], mask=[True, False]), np.array([], dtype=object), np.ones(3, bool),
    np.array([1, 2], dtype="datetime64[s]"), np.zeros(3, dtype=[("a", float)]),
    np.array([[1.0]]).view(np.matrix),
)  # fmt: skip


def nonsense(rng: np.random.Generator) -> Any:
    """Return a value of any type."""
    kind = rng.integers(0, 20)
    if kind < 7:
        return _pick(rng, _NUMBERS)
    if kind < 12:
        return _pick(rng, _OBJECTS)
    if kind < 15:
        return _pick(rng, _ARRAYS)
    if kind < 17:
        return _pick(rng, _FUNCTIONS)
    if kind < 18:
        return (value for value in (0.1, 0.2))
    return any_background(rng)


def spoiled(value: Any, rng: np.random.Generator) -> Any:
    """Return a value like the given one, but wrong in one respect or in an unusual form."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim > 0:
        return _spoiled_array(value, rng)
    if isinstance(value, int | float) and not isinstance(value, bool):
        factor = _pick(rng, (-1.0, 0.0, 1e-12, 1e-3, 1e3, 1e12, np.nan, np.inf))
        return type(value)(value * factor) if np.isfinite(value * factor) else value * factor
    if isinstance(value, ads.SimplexMesh):
        return _spoiled_mesh(value, rng)
    return nonsense(rng)


_STRANGE = (
    np.nan, np.inf, -np.inf, -1.0, 0.0, -1e30, 1e30, 1e77, 1e155, 1e300, 5e-324, 1e-300, 1e-77,
)  # fmt: skip


def _spoiled_array(array: np.ndarray, rng: np.random.Generator) -> Any:
    strange = _pick(rng, _STRANGE)

    def at(where: np.ndarray) -> np.ndarray:
        changed = array.astype(float)
        changed.flat[where] = strange
        return changed

    n = array.size
    forms: tuple[Callable[[], Any], ...] = (
        lambda: at(rng.integers(0, max(n, 1), min(1, n))),
        lambda: at(rng.integers(0, max(n, 1), n // 2)),
        lambda: at(np.arange(n)),
        lambda: array[:-1],
        lambda: np.concatenate([array, array[:1]]),
        lambda: array[None],
        lambda: array.T,
        lambda: array.reshape(-1),
        lambda: np.asfortranarray(array),
        lambda: np.repeat(array, 2, axis=0)[::2],
        lambda: array.astype(np.float32),
        lambda: array.astype(">f8"),
        lambda: array.astype(int),
        lambda: array.astype(np.uint8),
        lambda: array.astype(bool),
        lambda: array.astype(object),
        lambda: array.astype(complex),
        lambda: array.astype(str),
        array.tolist,
        lambda: np.ma.array(array, mask=rng.random(array.shape) < 0.2),
        lambda: array * 0.0,
        lambda: array * 1e150,
        lambda: array * 1e77,
        lambda: array * 1e30,
        lambda: array * 1e-30,
        lambda: array * 1e-77,
        lambda: array * 1e-150,
        lambda: array + 1e9,
        lambda: -array,
        lambda: array[:, :1] if array.ndim > 1 else array[:1],
        lambda: np.zeros_like(array) + array.flat[0] if n else array,
    )
    with np.errstate(all="ignore"):
        return _pick(rng, forms)()


def _spoiled_mesh(mesh: Any, rng: np.random.Generator) -> Any:
    """Return a mesh that is allowed, but hard: flat, doubled, huge, far away, tangled, or as is."""
    points, cells = mesh.points, mesh.cells
    forms: tuple[Callable[[], Any], ...] = (
        lambda: (points, cells[:0]),
        lambda: (points[:0], cells[:0]),
        lambda: (points, cells[:1]),
        lambda: (points * 0.0, cells),
        lambda: (points * 1e-59, cells),
        lambda: (points * 1e59, cells),
        lambda: (points * 1e-9, cells),
        lambda: (points + 1e6, cells),
        lambda: (points + 1e15, cells),
        lambda: (points, np.concatenate([cells, cells])),
        lambda: (points, np.concatenate([cells, cells[:, ::-1]])),
        lambda: (points, cells[:, ::-1]),
        lambda: (points[rng.permutation(len(points))], cells),
        lambda: (points * np.eye(points.shape[1])[0], cells),
        lambda: (np.concatenate([points, points]), np.concatenate([cells, cells + len(points)])),
        lambda: (np.repeat(points[:1], len(points), axis=0), cells),
        lambda: (np.where(rng.random(len(points))[:, None] < 0.2, points[:1], points), cells),
        lambda: (points, cells[:, :2]),
        lambda: (points, cells[rng.random(len(cells)) < 0.5]),
        lambda: (points * np.array([1.0, 1e-6, 1e-3])[: points.shape[1]], cells),
        lambda: (np.concatenate([points, points + 1.0]), cells),
    )
    try:
        return ads.SimplexMesh(*_pick(rng, forms)())
    except ValueError:  # refused when it is made
        return mesh


def _pick(rng: np.random.Generator, values: Any) -> Any:
    return values[int(rng.integers(0, len(values)))]
