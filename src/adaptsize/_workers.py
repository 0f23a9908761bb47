"""Threads that process points in chunks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import NamedTuple

import numba

from adaptsize._progress import silent
from adaptsize.typing import ProgressCallback

# Points per chunk, some milliseconds; Ctrl-C takes effect between chunks.  Kernels process blocks
# of 32.
_CHUNK = 512 * 32


class Workers(NamedTuple):
    """Threads that process points in chunks, and the report of their progress."""

    threads: int
    report: ProgressCallback = silent

    @classmethod
    def of(cls, threads: int | None, report: ProgressCallback = silent) -> Workers:
        """Return a number of threads, by default that of numba."""
        return cls(int(numba.get_num_threads()) if threads is None else threads, report)

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
        the report, stops the work after the chunks that have begun.
        """
        chunks = [(first, min(first + step, n)) for first in range(0, n, step)]
        if self.threads == 1 or len(chunks) < 2:
            for first, last in chunks:
                task(first, last)
                self.report(text, last / n)
            return
        with ThreadPoolExecutor(min(self.threads, len(chunks))) as pool:
            try:
                waiting = [pool.submit(task, *chunk) for chunk in chunks]
                for count, done in enumerate(as_completed(waiting), 1):
                    done.result()
                    self.report(text, count / len(chunks))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
