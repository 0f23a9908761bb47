"""What the distributed algorithms need of a group of processes."""

from __future__ import annotations

import math
import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe

T = TypeVar("T")
Operation: TypeAlias = Literal["sum", "min", "max"]


@dataclass
class Traffic:
    """What one rank has sent so far."""

    exchanges: int = 0
    """Number of calls of `Communicator.alltoallv`."""
    reductions: int = 0
    """Number of calls of all other collective operations."""
    bytes_sent: int = 0
    """Bytes sent to other ranks in exchanges."""
    bytes_gathered: int = 0
    """Bytes that this rank contributed to other operations."""


class Communicator(ABC):
    """A group of processes, called ranks, that work on one problem.

    All methods are collective: every rank must call them, in the same order.
    """

    rank: int
    """Number of this rank, from 0."""
    size: int
    """Number of ranks."""
    traffic: Traffic

    @abstractmethod
    def allgather(self, value: T) -> list[T]:
        """Return the values of all ranks, in order of rank.  Values can be any picklable object."""

    @abstractmethod
    def allreduce(self, value: Any, op: Operation) -> Any:
        """Return the sum, minimum or maximum over the ranks of a number, or of each array entry."""

    @abstractmethod
    def alltoallv(self, arrays: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
        """Send one array to each rank, and return the arrays received, in order of rank.

        All arrays, on all ranks, have the same dtype and the same shape except for their lengths.
        """

    def alltoall(self, values: Sequence[T]) -> list[T]:
        """Send one picklable object to each rank, and return the objects received."""
        received = self.alltoallv([as_words(value) for value in values])
        return [pickle.loads(words.tobytes()) for words in received]

    @abstractmethod
    def bcast(self, value: T, root: int = 0) -> T:
        """Return the value of one rank on all ranks."""

    @abstractmethod
    def barrier(self) -> None:
        """Wait for all ranks."""

    def agree(self, task: Callable[[], T]) -> T:
        """Run a task without communication; if it fails on any rank, raise on all ranks alike.

        The exception is that of the first rank on which the task failed.  It names the rank if
        there are several.
        """
        result, error = None, None
        try:
            result = task()
        except Exception as failure:
            error = failure
        errors = self.allgather(None if error is None else (type(error), str(error)))
        self.raise_first(errors, error)
        return result  # type: ignore[return-value]

    def require_equal(self, **arguments: Any) -> None:
        """Raise a ValueError on all ranks if an argument is not the same on all of them.

        Numbers are compared by value, other objects by their representations.
        """
        own = {
            name: float(value) if isinstance(value, Real) else repr(value)
            for name, value in arguments.items()
        }
        every = self.allgather(own)
        for name in own:
            differs = [other[name] != every[0][name] for other in every]
            if any(differs):
                rank = differs.index(True)
                raise ValueError(
                    f"{name} must be the same on all ranks, got {every[0][name]} on rank 0 and "
                    f"{every[rank][name]} on rank {rank}"
                )

    def raise_first(
        self, errors: Sequence[tuple[type[Exception], str] | None], own: Exception | None = None
    ) -> None:
        """Raise the first of the errors of all ranks, if there is any."""
        for rank, error in enumerate(errors):
            if error is None:
                continue
            kind, text = error
            where = f"rank {rank}: " if self.size > 1 else ""
            try:
                failure = kind(where + text)
            except TypeError:  # the exception takes other arguments
                failure = RuntimeError(f"{where}{kind.__name__}: {text}")
            raise failure from (own if rank == self.rank else None)


def as_communicator(comm: Any) -> Communicator:
    """Return a `Communicator` for one of adaptsize or mpi4py, or for None, a single rank.

    Examples
    --------
    >>> as_communicator(None).size
    1
    """
    if isinstance(comm, Communicator):
        return comm
    if comm is None:
        return SingleRank()
    if all(hasattr(comm, name) for name in ("Get_rank", "Get_size", "Alltoallv")):
        from adaptsize.distributed.mpi import MpiCommunicator

        return MpiCommunicator(comm)
    raise ValueError(f"comm must be a communicator of mpi4py or None, got {describe(comm)}")


class SingleRank(Communicator):
    """A group of one process."""

    def __init__(self) -> None:
        self.rank, self.size, self.traffic = 0, 1, Traffic()

    def allgather(self, value: T) -> list[T]:
        """Return the value."""
        return [value]

    def allreduce(self, value: Any, op: Operation) -> Any:
        """Return the value."""
        return value

    def alltoallv(self, arrays: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
        """Return the array."""
        self.traffic.exchanges += 1
        return [arrays[0].copy()]

    def bcast(self, value: T, root: int = 0) -> T:
        """Return the value."""
        return value

    def barrier(self) -> None:
        """Return at once."""


def reduced(values: Sequence[Any], op: Operation) -> Any:
    """Return the sum, minimum or maximum of the values of all ranks; sums are rounded once."""
    if isinstance(values[0], np.ndarray):
        merge = {"sum": np.add, "min": np.minimum, "max": np.maximum}[op]
        return merge.reduce(np.stack(values), axis=0)
    if op == "sum":
        return math.fsum(values) if isinstance(values[0], float) else sum(values)
    return min(values) if op == "min" else max(values)


def as_words(value: object) -> npt.NDArray[np.uint64]:
    """Return an object as numbers of 8 bytes, of which MPI can count more than of bytes."""
    data = pickle.dumps(value, protocol=5)
    return np.frombuffer(data + bytes(-len(data) % 8), np.uint64)


def split_rows(array: npt.NDArray[Any], rank: npt.NDArray[Any], size: int) -> list[Any]:
    """Return the rows for each rank, in their order, given the rank of each row."""
    order = np.argsort(rank, kind="stable")
    ends = np.cumsum(np.bincount(rank, minlength=size))
    return np.split(array[order], ends[:-1])
