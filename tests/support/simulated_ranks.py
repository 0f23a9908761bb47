"""Ranks as threads of one process, for tests and experiments without MPI."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Sequence
from threading import Condition, Thread
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_whole_number
from adaptsize.ranks import Communicator, Operation, Traffic

T = TypeVar("T")


class _AbandonedError(RuntimeError):
    """Another rank failed, or returned, while this rank waited for it."""


class _World:
    """The meeting point of the threads."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._changed = Condition()
        self._slots: list[Any] = [None] * size
        self._names = [""] * size
        self._arrived = self._turn = 0
        self._results: list[Any] = []
        self._met: list[str] = []
        self._left: set[int] = set()

    def meet(self, rank: int, name: str, value: Any) -> list[Any]:
        """Wait for all ranks, and return their values."""
        with self._changed:
            turn = self._turn
            self._slots[rank], self._names[rank] = value, name
            self._arrived += 1
            if self._arrived == self.size:
                self._results, self._met = list(self._slots), list(self._names)
                self._arrived = 0
                self._turn += 1
                self._changed.notify_all()
            else:
                self._changed.wait_for(lambda: self._turn != turn or self._left)
                if self._turn == turn:
                    raise _AbandonedError(f"ranks {sorted(self._left)} do not take part in {name}")
            if len(set(self._met)) > 1:
                raise RuntimeError(f"the ranks call different operations: {self._met}")
            return self._results

    def leave(self, rank: int) -> None:
        """Take no further part."""
        with self._changed:
            self._left.add(rank)
            self._changed.notify_all()


class SimulatedCommunicator(Communicator):
    """One of several ranks that are threads of this process."""

    def __init__(self, world: _World, rank: int) -> None:
        self._world = world
        self.rank, self.size, self.traffic = rank, world.size, Traffic()

    @staticmethod
    def run(n_ranks: int, function: Callable[[SimulatedCommunicator], T]) -> list[T]:
        """Run ``function(comm)`` on all ranks, and return the results in order of rank.

        The error raised is that of the first rank that failed: the others stop where they wait for
        it.  It is an error, too, if ranks call different operations, or one returns before others.
        """
        world = _World(as_whole_number("n_ranks", n_ranks, lower=1, upper=10_000))
        results: list[Any] = [None] * n_ranks
        errors: dict[int, BaseException] = {}

        def work(rank: int) -> None:
            try:
                results[rank] = function(SimulatedCommunicator(world, rank))
            except BaseException as error:
                errors[rank] = error
            finally:
                world.leave(rank)

        threads = [Thread(target=work, args=(rank,)) for rank in range(n_ranks)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if errors:
            ranks = sorted(errors, key=lambda r: (isinstance(errors[r], _AbandonedError), r))
            raise errors[ranks[0]]
        return results

    def allgather(self, value: T) -> list[T]:
        data = pickle.dumps(value)
        self._count(len(data))
        return [pickle.loads(item) for item in self._world.meet(self.rank, "allgather", data)]

    def allreduce(self, value: Any, op: Operation) -> Any:
        data = pickle.dumps(value)
        self._count(len(data))
        every = self._world.meet(self.rank, f"allreduce {op}", data)
        return _reduced([pickle.loads(item) for item in every], op)

    def alltoallv(self, arrays: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
        kinds = {(array.dtype.str, array.shape[1:]) for array in arrays}
        assert len(arrays) == self.size
        assert len(kinds) == 1, kinds
        self.traffic.exchanges += 1
        self.traffic.bytes_sent += sum(a.nbytes for q, a in enumerate(arrays) if q != self.rank)
        every = self._world.meet(self.rank, f"alltoallv {kinds}", [np.array(a) for a in arrays])
        return [sent[self.rank] for sent in every]

    def _count(self, n_bytes: int) -> None:
        self.traffic.reductions += 1
        self.traffic.bytes_gathered += n_bytes


def _reduced(values: Sequence[Any], op: Operation) -> Any:
    """Return the sum, minimum or maximum of the values of all ranks; sums are rounded once."""
    if isinstance(values[0], np.ndarray):
        merge = {"sum": np.add, "min": np.minimum, "max": np.maximum}[op]
        return merge.reduce(np.stack(values), axis=0)
    if op == "sum":
        return math.fsum(values) if isinstance(values[0], float) else sum(values)
    return min(values) if op == "min" else max(values)
