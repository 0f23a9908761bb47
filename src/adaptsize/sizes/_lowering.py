"""Sizes at the nodes of cells that points and curves touch, on grids and meshes alike.

`adaptsize.sizes._on_grid` and `adaptsize.sizes._touched` find these nodes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

_Integers = IntArray | npt.NDArray[np.int64]


class Nearby(NamedTuple):
    """Pairs of a point, or a piece of a curve, and a node of a cell that it touches."""

    which: npt.NDArray[np.int64]
    """int64[k]: the point or the piece."""
    nodes: _Integers
    """int[k]: flat index of the node."""
    coordinates: FloatArray
    """float64[k, dim]: those of the node."""


class Pieces(NamedTuple):
    """Pieces of a curve that lie in a cell each, or outside; samples have the length 0."""

    segments: _Integers
    """int[n]"""
    first: FloatArray
    """float64[n]: start of the piece, 0 at the first node of the segment to 1 at the second."""
    last: FloatArray
    """float64[n]: its end."""
    nearby: Nearby


def lower_at_points(
    points: FloatArray, size: FloatArray, nearby: Nearby, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to ``size + g |x - points|``."""
    distance = np.linalg.norm(nearby.coordinates - points[nearby.which], axis=1)
    _lower(h0, nearby.nodes, size[nearby.which] + g * distance)


def lower_along(
    curve: SimplexMesh, size: FloatArray, pieces: Pieces, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to the least of ``size + g |x - y|`` over y on pieces of a curve."""
    a, b = curve.cells[pieces.segments].T
    shares = (pieces.first, pieces.last)
    start, stop = (
        (1.0 - t)[:, None] * curve.points[a] + t[:, None] * curve.points[b] for t in shares
    )
    at_start, at_stop = (_size_between(t, size[a], size[b]) for t in shares)
    k, nodes, x = pieces.nearby
    requested = _least_from_segment(x, start[k], stop[k], at_start[k], at_stop[k], g)
    _lower(h0, nodes, requested)
    # The closest point of the curve may lie in a cell that is not at the node.
    unique, place = np.unique(nodes, return_index=True)
    at_nearest, distances = curve.locator.interpolate(size, x[place])
    _lower(h0, unique, at_nearest + g * distances)


def _lower(h0: FloatArray, nodes: npt.NDArray[Any], requested: FloatArray) -> None:
    np.minimum.at(h0, np.unravel_index(nodes, h0.shape), requested)


def _size_between(t: FloatArray, at_a: FloatArray, at_b: FloatArray) -> FloatArray:
    """Return sizes between two ends.  An end of share 0 is ignored, because inf would give nan."""
    size: FloatArray = np.where(t < 1.0, at_a, 0.0) * (1.0 - t) + np.where(t > 0.0, at_b, 0.0) * t
    return size


def _least_from_segment(
    x: FloatArray, a: FloatArray, b: FloatArray, at_a: FloatArray, at_b: FloatArray, g: float
) -> FloatArray:
    """Return the minimum of ``s(y) + g |x - y|`` over y on segments with sizes linear along them.

    With the slope m of the size along the segment, the foot of x at t and its height H, the
    minimum is at ``t - m H / sqrt(g^2 - m^2)``, clipped to the segment, or at an end if
    ``|m| >= g``.
    """
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / np.where(length > 0.0, length, 1.0)[:, None]
    foot = ((x - a) * along).sum(axis=1)
    height = np.linalg.norm(x - a - foot[:, None] * along, axis=1)
    ends = np.minimum(
        at_a + g * np.linalg.norm(x - a, axis=1), at_b + g * np.linalg.norm(x - b, axis=1)
    )
    # Where a size is inf at one end it is inf up to the other: only the ends count.
    linear = np.isfinite(at_a) & np.isfinite(at_b) & (length > 0.0)
    rise = np.where(linear, at_b, 0.0) - np.where(linear, at_a, 0.0)
    slope = rise / np.where(length > 0.0, length, 1.0)
    linear &= np.abs(slope) < g
    root = np.sqrt(np.where(linear, g**2 - slope**2, 1.0))
    t = np.clip(foot - slope * height / root, 0.0, length)
    between = at_a + slope * t + g * np.hypot(height, t - foot)
    return np.asarray(np.where(linear, np.minimum(between, ends), ends))
