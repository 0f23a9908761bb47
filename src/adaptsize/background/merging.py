"""Identification of points that coincide, or nearly so."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background.topology import components_of
from adaptsize.typing import FloatArray

# Larger coordinates, in units of the distance, are clipped, as their squares would overflow.
_FARTHEST = 1e150


def place_numbers(points: FloatArray, within: float) -> npt.NDArray[np.intp]:
    """Return for each point the number of its place, starting from 0.

    Two points are in the same place if their distance is at most ``within``, or if a chain of
    such points joins them.  Rounding to a lattice instead would separate neighbours on the two
    sides of a lattice cell boundary.

    Parameters
    ----------
    points : float64[n, dim]
        Finite.
    within : float
        Distance >= 0; with 0, only equal points are in the same place.

    Returns
    -------
    intp[n]

    Examples
    --------
    >>> place_numbers(np.array([[0.0], [0.9], [5.0], [1.8], [3.0]]), 1.0)
    array([0, 0, 1, 0, 2])
    """
    # Merge equal points first: many points at one place would form too many pairs.
    distinct, number = merge_equal_points(points)
    if within > 0.0 and len(distinct) > 1:
        number = _joined(distinct, within)[number]
    return number


def merge_equal_points(points: npt.NDArray[Any]) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the distinct points in order of first appearance, and the number of each.

    Points are merged if all coordinates are equal (0 equals -0), not if they are only close.
    """
    exact = points.astype(np.float64) + 0.0  # -0 becomes 0
    bits = exact.view(np.uint64)
    mixed = np.zeros(len(exact), np.uint64)
    for axis in range(bits.shape[1]):  # sorting one hash is several times faster than rows
        mixed = (mixed ^ bits[:, axis] ^ (bits[:, axis] >> np.uint64(29))) * np.uint64(
            0x9E3779B97F4A7C15
        )
        mixed ^= mixed >> np.uint64(32)
    _, first, number = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(exact[first[number]], exact):  # two points share a hash
        _, first, number = np.unique(exact, axis=0, return_index=True, return_inverse=True)
        number = number.reshape(-1)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return exact[first[order]], rank[number]


def first_at_place(points: FloatArray, within: float) -> npt.NDArray[np.intp]:
    """Return for each point the first point that is in the same place (see `place_numbers`)."""
    number = place_numbers(points, within)
    first = np.unique(number, return_index=True)[1]
    return np.asarray(first[number])


def _joined(points: FloatArray, within: float) -> npt.NDArray[np.intp]:
    """Return the component number of each of a set of distinct points."""
    from scipy.spatial import cKDTree

    with np.errstate(over="ignore"):
        scaled = np.clip(points / within, -_FARTHEST, _FARTHEST)
    pairs = cKDTree(scaled, balanced_tree=False).query_pairs(1.0, output_type="ndarray")
    return components_of(pairs, len(points))
