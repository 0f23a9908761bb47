"""Identification of points that nearly coincide."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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
    order = np.lexsort(points.T)
    is_new = (np.diff(points[order], axis=0) != 0.0).any(axis=1)
    number = np.empty(len(points), np.intp)
    number[order] = np.cumsum(np.concatenate([[False], is_new])[: len(points)])
    if within > 0.0 and len(points) > 1:
        distinct = points[order[np.concatenate([[True], is_new])]]
        number = _joined(distinct, within)[number]
    _, first, number = np.unique(number, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[number.reshape(-1)]


def first_at_place(points: FloatArray, within: float) -> npt.NDArray[np.intp]:
    """Return for each point the first point that is in the same place (see `place_numbers`)."""
    number = place_numbers(points, within)
    first = np.unique(number, return_index=True)[1]
    return np.asarray(first[number])


def _joined(points: FloatArray, within: float) -> npt.NDArray[np.intp]:
    """Return the component number of each of a set of distinct points."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    with np.errstate(over="ignore"):
        scaled = np.clip(points / within, -_FARTHEST, _FARTHEST)
    pairs = cKDTree(scaled, balanced_tree=False).query_pairs(1.0, output_type="ndarray")
    n = len(points)
    links = coo_matrix((np.ones(len(pairs), np.bool_), pairs.T), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)
