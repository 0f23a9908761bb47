"""Points along a Morton curve, and their processing in chunks on one or several threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache

import numba
import numpy as np
import numpy.typing as npt

from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.trees import BITS, DIGIT, LEAF, sort_along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Points per chunk, some milliseconds; Ctrl-C takes effect between chunks.
_CHUNK = 512 * BLOCK


def along_curve(points: FloatArray) -> IntArray:
    """Return the numbers of points in the order of a Morton curve, int32[n].

    The time is 30 ns per point.  Points keep their order if the range of their coordinates, or
    its inverse, overflows.
    """
    n, dim = points.shape
    if n == 0:
        return np.empty(0, np.int32)
    lower = [float(points[:, d].min()) for d in range(dim)]
    width = max(float(points[:, d].max()) - lower[d] for d in range(dim))
    scale = (2.0**BITS - 1.0) / width if width > 0.0 else 0.0
    keys, order = np.empty((2, n), np.int64), np.empty((2, n), np.int32)
    counts = np.empty(2**DIGIT, np.int64)
    given = read_only(np.ascontiguousarray(points))
    sort_along_curve(given, (0,) * dim, np.array(lower), scale, _spread(dim), keys, order, counts)
    found: IntArray = order[0].copy()
    return found


@cache
def _spread(dim: int) -> npt.NDArray[np.int64]:
    """Return the numbers below 2^DIGIT with dim - 1 zeros after each of their bits."""
    bits = np.arange(DIGIT)
    ones = (np.arange(2**DIGIT)[:, None] >> bits) & 1
    spread: npt.NDArray[np.int64] = np.sum(ones << (bits * dim), axis=1)
    return spread


def boxes_over(lower: FloatArray, upper: FloatArray, value: FloatArray) -> FloatArray:
    """Return the boxes of a tree over sorted items (see trees.py)."""
    m, dim = lower.shape
    n_leaves = 1
    while n_leaves * LEAF < m:
        n_leaves *= 2
    boxes = np.empty((2 * n_leaves, 2 * dim + 1))
    boxes[0] = 0.0
    boxes[0, -1] = np.inf
    for column in range(2 * dim + 1):
        items = [*lower.T, *upper.T, value][column]
        is_upper = dim <= column < 2 * dim
        merge = np.maximum if is_upper else np.minimum
        level = np.full(n_leaves * LEAF, -np.inf if is_upper else np.inf)
        level[:m] = items
        while len(level) > 1:
            level = merge(level[::2], level[1::2])
            if len(level) <= n_leaves:
                boxes[len(level) : 2 * len(level), column] = level
    return boxes


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
