"""Threads that process points in chunks.

They are started once in a process, which takes longer than many a query.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed, wait
from functools import lru_cache
from typing import NamedTuple

import numba

from adaptsize._cores import cores
from adaptsize._progress import silent
from adaptsize.typing import ProgressCallback

# Points per chunk, some milliseconds; Ctrl-C takes effect between chunks.  Kernels process blocks
# of 32.
_CHUNK = 512 * 32

_of_thread = threading.local()


def _mark_worker() -> None:
    _of_thread.is_worker = True


@lru_cache(maxsize=1)  # the threads of a pool end when nothing refers to it any more
def _pool_of(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "adaptsize", _mark_worker)


if hasattr(os, "register_at_fork"):  # a new process has none of the threads
    os.register_at_fork(after_in_child=_pool_of.cache_clear)


def _default_threads() -> int:
    """Return the number of threads that the user gave numba, otherwise one per core."""
    threads, most = int(numba.get_num_threads()), vars(numba.config)["NUMBA_NUM_THREADS"]
    if threads != most or "NUMBA_NUM_THREADS" in os.environ:
        return threads
    return min(threads, cores())


class Workers(NamedTuple):
    """Threads that process points in chunks, and the report of their progress."""

    threads: int
    report: ProgressCallback = silent

    @classmethod
    def of(cls, threads: int | None, report: ProgressCallback = silent) -> Workers:
        """Return a number of threads, by default that of numba, at most one per core."""
        return cls(_default_threads() if threads is None else threads, report)

    def part(self, first: float, last: float) -> Workers:
        """Return workers for a part of the work, between two fractions of the whole."""

        def report_part(text: str, share: float | None) -> None:
            self.report(text, None if share is None else first + (last - first) * share)

        return Workers(self.threads, report_part)

    def in_chunks(
        self,
        task: Callable[[int, int], object],
        n: int,
        step: int = _CHUNK,
        text: str = "limiting the gradient",
    ) -> None:
        """Run ``task(first, last)`` on chunks of 0..n - 1, of ``step`` items.

        Tasks release the interpreter lock and write to disjoint memory.  An exception, also one in
        the report, stops the work after the chunks that have begun.  Tasks that come here
        themselves do all in their own thread: others may all wait for such tasks.
        """
        chunks = [(first, min(first + step, n)) for first in range(0, n, step)]
        if self.threads == 1 or len(chunks) < 2 or getattr(_of_thread, "is_worker", False):
            for first, last in chunks:
                task(first, last)
                self.report(text, last / n)
            return
        pool = _pool_of(self.threads)
        begun: list[Future[object]] = []
        try:
            try:
                for chunk in chunks:
                    begun.append(pool.submit(task, *chunk))
                for count, done in enumerate(as_completed(begun), 1):
                    done.result()
                    self.report(text, count / len(chunks))
            finally:
                _end(begun)
        finally:  # a second signal may come as soon as the first is handled, before `_end` begins
            _end(begun)


def _end(begun: Sequence[Future[object]]) -> None:
    """Cancel chunks, and wait for those that run, some milliseconds.

    A further signal takes effect after them: at the end of the interpreter no kernel may run.
    """
    interrupted = None
    while True:
        try:
            for one in begun:
                one.cancel()
            wait(begun)
            break
        except BaseException as error:
            interrupted = error
    if interrupted is not None:
        raise interrupted


def in_all_threads(
    task: Callable[[int, int], object],
    n: int,
    step: int,
    text: str = "",
    report: ProgressCallback = silent,
) -> None:
    """Run ``task(first, last)`` on chunks of 0..n - 1 by all threads that numba may use.

    See `Workers.in_chunks`.  Chunks are the same for any number of threads.
    """
    workers = Workers.of(None if n > step else 1, report)
    workers.in_chunks(task, n, step, text)
