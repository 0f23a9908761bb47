"""Trees of boxes, and processing of points in chunks on one or several threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed

import numba
import numpy as np

from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.trees import LEAF
from adaptsize.typing import FloatArray, ProgressCallback

# Points per chunk, some milliseconds; Ctrl-C takes effect between chunks.
_CHUNK = 512 * BLOCK


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
