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
    range(0), slice(1), Ellipsis, NotImplemented, object(), np, ValueError("x"), _NoArray(),
    _NoNumber(), Path("nowhere"), Path(), np.datetime64("2026-01-01"), np.ma.masked,
    memoryview(b"ab"), [1, [2, 3]], "héé\ud800", [np.nan], [np.inf, -np.inf], [0.0], [1e300],
    [-1], [10**30], (0.1, 0.2), (0.1, 0.2, 0.3), [0.1] * 4, {"a": {"b": 1}}, frozenset({1}),
    [True, False],
)  # fmt: skip

_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    _raises,
    *(lambda *a, value=value, **k: value
      for value in (None, np.nan, np.inf, -1.0, 0.0, "abc", np.empty(0), np.full(3, 0.2))),
    *(lambda x, *a, value=value, **k: np.full(len(x), value)
      for value in (np.nan, np.inf, -1.0, 1e300, 0.2j)),
    lambda x, *a, **k: np.full(len(x) + 1, 0.2),
    lambda x, *a, **k: np.full((len(x), 1), 0.2),
    lambda x, *a, **k: np.where(np.arange(len(x)) == 1, np.nan, 0.2),
    lambda x, *a, **k: len(x),
)  # fmt: skip

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


BAD = (*_NUMBERS, *_OBJECTS, *_ARRAYS, *_FUNCTIONS)
"""The table of awkward arguments, for every parameter of every function."""


def nonsense(rng: np.random.Generator) -> Any:
    """Return a value of any type."""
    kinds = ((0.35, _NUMBERS), (0.25, _OBJECTS), (0.15, _ARRAYS), (0.1, _FUNCTIONS))
    at = rng.random()
    for share, values in kinds:
        if at < share:
            return pick(rng, values)
        at -= share
    return (value for value in (0.1, 0.2)) if at < 0.05 else any_background(rng)


def spoiled(value: Any, rng: np.random.Generator) -> Any:
    """Return a value like the given one, but wrong in one respect or in an unusual form."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim > 0:
        with np.errstate(all="ignore"):
            return pick(rng, _SPOILED_ARRAYS)(value, rng)
    if isinstance(value, int | float) and not isinstance(value, bool):
        factor = pick(rng, (-1.0, 0.0, 1e-12, 1e-3, 1e3, 1e12, np.nan, np.inf))
        return type(value)(value * factor) if np.isfinite(value * factor) else value * factor
    if isinstance(value, ads.SimplexMesh):
        try:
            return ads.SimplexMesh(*pick(rng, _HARD_MESHES)(value.points, value.cells, rng))
        except ValueError:  # refused when it is made
            return value
    return nonsense(rng)


_STRANGE = (
    np.nan, np.inf, -np.inf, -1.0, 0.0, -1e30, 1e30, 1e77, 1e155, 1e300, 5e-324, 1e-300, 1e-77,
)  # fmt: skip


def _strange_at(array: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Return the array with one strange value in an entry, or in a share of them."""
    changed = array.astype(float)
    count = max(min(1, array.size), int(share * array.size))
    changed.flat[rng.permutation(array.size)[:count]] = pick(rng, _STRANGE)
    return changed


_SPOILED_ARRAYS: tuple[Callable[[np.ndarray, np.random.Generator], Any], ...] = (
    *(lambda a, rng, share=share: _strange_at(a, share, rng) for share in (0.0, 0.5, 1.0)),
    *(lambda a, rng, factor=factor: a * factor
      for factor in (-1.0, 0.0, 1e150, 1e77, 1e30, 1e-30, 1e-77, 1e-150)),
    *(lambda a, rng, kind=kind: a.astype(kind)
      for kind in (np.float32, ">f8", int, np.uint8, bool, object, complex, str)),
    lambda a, rng: a[:-1],
    lambda a, rng: np.concatenate([a, a[:1]]),
    lambda a, rng: a[None],
    lambda a, rng: a.T,
    lambda a, rng: a.reshape(-1),
    lambda a, rng: np.ma.array(a, mask=rng.random(a.shape) < 0.2),
    lambda a, rng: a + 1e9,
    lambda a, rng: a[:, :1] if a.ndim > 1 else a[:1],
    lambda a, rng: np.zeros_like(a) + a.flat[0] if a.size else a,
)  # fmt: skip

_HARD_MESHES: tuple[Callable[[np.ndarray, np.ndarray, np.random.Generator], Any], ...] = (
    *(lambda p, c, rng, factor=factor: (p * factor, c) for factor in (0.0, 1e-59, 1e59, 1e-9)),
    *(lambda p, c, rng, offset=offset: (p + offset, c) for offset in (1e6, 1e15)),
    lambda p, c, rng: (p, c[:0]),
    lambda p, c, rng: (p[:0], c[:0]),
    lambda p, c, rng: (p, c[:1]),
    lambda p, c, rng: (p, np.concatenate([c, c])),
    lambda p, c, rng: (p, np.concatenate([c, c[:, ::-1]])),
    lambda p, c, rng: (p, c[:, ::-1]),
    lambda p, c, rng: (rng.permutation(p), c),
    lambda p, c, rng: (p * np.eye(p.shape[1])[0], c),
    lambda p, c, rng: (np.concatenate([p, p]), np.concatenate([c, c + len(p)])),
    lambda p, c, rng: (np.repeat(p[:1], len(p), axis=0), c),
    lambda p, c, rng: (np.where(rng.random(len(p))[:, None] < 0.2, p[:1], p), c),
    lambda p, c, rng: (p, c[:, :2]),
    lambda p, c, rng: (p, c[rng.random(len(c)) < 0.5]),
    lambda p, c, rng: (p * np.array([1.0, 1e-6, 1e-3])[: p.shape[1]], c),
    lambda p, c, rng: (np.concatenate([p, p + 1.0]), c),
)  # fmt: skip
"""Meshes that are allowed, but hard: flat, doubled, huge, far away, tangled."""


def pick(rng: np.random.Generator, values: Any) -> Any:
    """Return one of the values."""
    return values[int(rng.integers(0, len(values)))]
