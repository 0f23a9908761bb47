"""Points along a Morton curve, and their processing in chunks on one or several threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed

import numba
import numpy as np
import numpy.typing as npt

from adaptsize._kernels.exact import BLOCK, Entries
from adaptsize._kernels.trees import LEAF, fill_boxes, fill_extent, fill_keys, sort_by_keys
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Points per chunk, some milliseconds; Ctrl-C takes effect between chunks.
_CHUNK = 512 * BLOCK

# Bits per axis of a Morton key.
_BITS = 21


def along_curve(points: FloatArray) -> IntArray:
    """Return the numbers of points in the order of a Morton curve, int32[n].

    The time is 30 ns per point.  The order of equal points is arbitrary but deterministic.
    """
    n, dim = points.shape
    axes = (0,) * dim
    extent = np.empty(2 * dim)
    fill_extent(points, axes, extent)
    width = float((extent[dim:] - extent[:dim]).max())
    scale = (2.0**_BITS - 1.0) / width if width > 0.0 else 0.0
    keys, scratch = np.empty((2, n), np.uint64)
    order, other = np.empty((2, n), np.int32)
    fill_keys(points, axes, extent[:dim], scale, keys)
    sort_by_keys(keys, order, scratch, other, _BITS * dim)
    return order


def entries_of(
    places: FloatArray, sizes: FloatArray, counts: npt.NDArray[np.int8] | None = None
) -> tuple[Entries, IntArray]:
    """Return entries sorted along a Morton curve with a tree over them, and the order.

    Parameters
    ----------
    places : float64[m, v, dim]
        Vertices of each entry; v is 1, 2 or 3.
    sizes : float64[m, v]
        Bounds at the vertices, padded with inf.
    counts : int8[m], optional
        Numbers of vertices; v by default.

    Returns
    -------
    entries : Entries
    order : int32[m]
        Entry k was row ``order[k]``.
    """
    m, width, dim = places.shape
    counts = np.full(m, width, np.int8) if counts is None else counts
    order = along_curve(np.ascontiguousarray(places[:, 0])) if m else np.empty(0, np.int32)
    own_places, own_sizes = np.zeros((m, dim, dim)), np.full((m, dim), np.inf)
    own_places[:, :width], own_sizes[:, :width] = places[order], sizes[order]
    return with_tree(own_places, own_sizes, counts[order]), order


def with_tree(places: FloatArray, sizes: FloatArray, counts: npt.NDArray[np.int8]) -> Entries:
    """Return entries that are already sorted, with a tree over them."""
    lower, upper = places[:, 0].copy(), places[:, 0].copy()
    for v in range(1, places.shape[1]):
        used = counts > v
        lower[used] = np.minimum(lower[used], places[used, v])
        upper[used] = np.maximum(upper[used], places[used, v])
    boxes, n_leaves = boxes_over(lower, upper, sizes.min(axis=1, initial=np.inf))
    return Entries(places, sizes, counts, boxes, n_leaves)


def boxes_over(lower: FloatArray, upper: FloatArray, value: FloatArray) -> tuple[FloatArray, int]:
    """Return the boxes of a tree over sorted items, and its number of leaves (see trees.py)."""
    m, dim = lower.shape
    n_leaves = 1
    while n_leaves * LEAF < m:
        n_leaves *= 2
    boxes = np.empty((2 * n_leaves, 2 * dim + 1))
    fill_boxes(lower, upper, value, (0,) * dim, n_leaves, boxes)
    return boxes, n_leaves


def in_chunks(
    task: Callable[[int, int], object], n: int, threads: int, report: ProgressCallback
) -> None:
    """Run ``task(first, last)`` on chunks of 0..n - 1, on several threads if requested.

    Tasks release the interpreter lock and write to disjoint memory.  An exception, also one in
    ``report``, stops the work after the chunks that have begun.
    """
    chunks = [(first, min(first + _CHUNK, n)) for first in range(0, n, _CHUNK)]
    text = "limiting the gradient"
    if threads == 1 or len(chunks) < 2:
        for first, last in chunks:
            task(first, last)
            report(text, last / n)
        return
    with ThreadPoolExecutor(min(threads, len(chunks))) as pool:
        try:
            waiting = [pool.submit(task, *chunk) for chunk in chunks]
            for count, done in enumerate(as_completed(waiting), 1):
                done.result()
                report(text, count / len(chunks))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def number_of_threads(threads: int | None) -> int:
    """Return the given number of threads, or that of numba."""
    return int(numba.get_num_threads()) if threads is None else threads


def part_of(report: ProgressCallback, first: float, last: float) -> ProgressCallback:
    """Return a callback for a part of the work, between two fractions of the whole."""

    def report_part(text: str, share: float | None) -> None:
        report(text, None if share is None else first + (last - first) * share)

    return report_part
