"""Orders in which points, or the cells of a tree, are near in memory if they are near in space."""

from functools import cache

import numpy as np

from adaptsize._kernels.ordering import (
    BITS,
    DIGIT,
    Curve,
    deal,
    fill_keys,
    sort_for_tree,
    sort_keys,
)
from adaptsize._kernels.trees import LEAF, Tree, fill_boxes, fill_boxes_of_cells
from adaptsize._workers import Workers
from adaptsize.background._mesh_arrays import bounding_box, centroids, read_only
from adaptsize.typing import FloatArray, IntArray, LongArray

# Points per chunk of a thread, some milliseconds, and per bucket, which fits into the cache.
_CHUNK, _BUCKET = 1 << 17, 1 << 14


def along_curve(points: FloatArray, threads: int = 1) -> IntArray:
    """Return the numbers of points in the order of a Morton curve, int32[n].

    The time is 30 ns per point.  Points keep their order if the range of their coordinates, or
    its inverse, overflows.  The points are put into buckets by the highest bits of their keys, and
    these are sorted one by one.
    """
    n = len(points)
    if n == 0:
        return np.empty(0, np.int32)
    workers, given = Workers(threads), np.ascontiguousarray(points)
    chunks = -(-n // _CHUNK)
    lower, upper = bounding_box(given, threads)
    width = float((upper - lower).max())
    if 0.0 < width < np.inf and (upper == lower).any():  # such axes do not change the order
        given, lower = given[:, upper > lower], lower[upper > lower]
    given, dim = read_only(np.ascontiguousarray(given)), len(lower)
    curve = Curve((0,) * dim, lower, _scale(width), _spread(dim))
    n_bits = max(n // _BUCKET, 1).bit_length() - 1
    lower_bits = BITS * dim - n_bits
    keys, order = np.empty((2, n), np.int64), np.empty((2, n), np.int32)
    counts = np.empty((chunks, 2**n_bits), np.int64)

    def fill(first: int, last: int) -> None:
        own = keys[1, first:last]
        fill_keys(given[first:last], curve, own)
        counts[first // _CHUNK] = np.bincount(own >> lower_bits, minlength=2**n_bits)

    workers.in_chunks(fill, n, _CHUNK)
    ends = np.cumsum(counts.T).reshape(counts.T.shape).T
    places = np.ascontiguousarray(ends - counts)
    buckets = np.append(0, ends[-1])

    def put(first: int, last: int) -> None:
        row = places[first // _CHUNK]
        deal(keys[1], (first, last), lower_bits, row, keys[0], order[0])

    def sort(first: int, last: int) -> None:
        span = int(buckets[first]), int(buckets[last])
        sort_keys(keys, order, span, lower_bits, np.empty(2**DIGIT, np.int64))

    workers.in_chunks(put, n, _CHUNK)
    workers.in_chunks(sort, 2**n_bits, 1)
    found: IntArray = order[0].copy()
    return found


def _scale(width: float) -> float:
    """Return the factor from coordinates to keys."""
    return (2.0**BITS - 1.0) / width if width > 0.0 else 0.0


@cache
def _spread(dim: int) -> LongArray:
    """Return the numbers below 2^DIGIT with dim - 1 zeros after each of their bits."""
    bits = np.arange(DIGIT)
    ones = (np.arange(2**DIGIT)[:, None] >> bits) & 1
    spread: LongArray = np.sum(ones << (bits * dim), axis=1)
    return spread


def tree_over(points: FloatArray, cells: IntArray) -> tuple[Tree, LongArray]:
    """Return a tree over cells, and the cell in each of its rows.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        At least one.
    """
    cells = np.array(cells)  # kernels are compiled once more for read-only ones
    # Axes along which all is in one place do not change the order.
    columns = [x for x in points.T if (x != x[0]).any()] or [points[:, 0]]
    middles = centroids(np.column_stack(columns), cells)
    along = along_curve(middles)
    n_leaves = 1
    while 4 * n_leaves < len(cells):
        n_leaves *= 2
    order = np.arange(len(cells))
    sort_for_tree(middles[along], n_leaves, order)
    order = along[order].astype(np.int64)
    cells, boxes = cells[order], np.empty((2 * n_leaves, 6))
    fill_boxes_of_cells(read_only(points), read_only(cells), boxes)
    return Tree(points, cells, boxes), order


def boxes_over_leaves(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the boxes of a tree from the corners of its leaves, float64[n_leaves, dim]."""
    n, dim = lower.shape
    boxes = np.zeros((2 * n, 2 * dim))
    boxes[n:] = np.hstack([lower, upper])
    while n > 1:
        pairs = boxes[n : 2 * n].reshape(-1, 2, 2, dim)
        n //= 2
        boxes[n : 2 * n, :dim] = np.minimum(pairs[:, 0, 0], pairs[:, 1, 0])
        boxes[n : 2 * n, dim:] = np.maximum(pairs[:, 0, 1], pairs[:, 1, 1])
    return boxes


def boxes_over(lower: FloatArray, upper: FloatArray, value: FloatArray) -> FloatArray:
    """Return the boxes of a tree over items sorted along a curve (see trees.py)."""
    m, dim = lower.shape
    n_leaves = 1
    while n_leaves * LEAF < m:
        n_leaves *= 2
    boxes = np.empty((2 * n_leaves, 2 * dim + 1))
    fill_boxes(*(read_only(np.ascontiguousarray(array)) for array in (lower, upper, value)), boxes)
    return boxes
