"""Groups of processes (ranks) that work on one mesh: a single process, or those of mpi4py."""

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from time import perf_counter, sleep
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize._messages import Message, message_of
from adaptsize.typing import IntArray

__all__ = ["Communicator", "Traffic", "as_communicator"]

T = TypeVar("T")

#: Global numbers.
Ids: TypeAlias = npt.NDArray[np.int64]
Operation: TypeAlias = Literal["sum", "min", "max"]

# Largest number of rows that MPI counts, in messages and their offsets.
_LARGEST_COUNT = 2**31 - 1

#: Seconds for which a rank waits busily for others, and its pauses after that.
_BUSY, _SHORTEST_PAUSE, _LONGEST_PAUSE = 1e-3, 1e-4, 5e-3


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

    def ask(
        self,
        rows: npt.NDArray[Any],
        ranks: npt.NDArray[Any],
        answer: Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[Any]],
    ) -> npt.NDArray[Any]:
        """Send each row to a rank, and return what is answered to each; two exchanges.

        ``answer(rows, by)`` takes the rows that this rank is sent and the ranks that sent them.
        """
        asked = self.alltoallv(split_rows(rows, ranks, self.size))
        lengths = [len(part) for part in asked]
        replies = answer(np.concatenate(asked), np.repeat(np.arange(self.size), lengths))
        answers = np.concatenate(self.alltoallv(np.split(replies, np.cumsum(lengths)[:-1])))
        found = np.empty_like(answers)
        found[np.argsort(ranks, kind="stable")] = answers
        return found

    def bcast(self, value: T, root: int = 0) -> T:
        """Return the value of one rank on all ranks."""
        return self.allgather(value if self.rank == root else None)[root]  # type: ignore[return-value]

    def agree(self, task: Callable[[], T]) -> T:
        """Run a task without communication; if it fails on any rank, raise on all ranks.

        The exception is that of the first rank on which the task failed.  It names the rank if
        there are several.
        """
        if self.size == 1:
            return task()
        result, error = None, None
        try:
            result = task()
        except Exception as failure:
            error = failure
        errors = self.allgather(None if error is None else (type(error), message_of(error)))
        for rank, failed in enumerate(errors):
            if failed is None:
                continue
            kind, text = failed
            try:
                raised = kind(Message("rank {}: {}", rank, text))
            except TypeError:  # the exception takes other arguments
                raised = RuntimeError(f"rank {rank}: {kind.__name__}: {text}")
            raise raised from (error if rank == self.rank else None)
        return result  # type: ignore[return-value]

    def require_equal(self, **arguments: Any) -> None:
        """Raise a ValueError on all ranks if an argument is not the same on all of them.

        Numbers are compared by value, other objects by their representations.  Of functions and
        arrays, which may differ between ranks, only the kind is compared.
        """
        own = {name: _comparable(value) for name, value in arguments.items()}
        every = self.allgather(own)
        for name in own:
            differs = [other[name] != every[0][name] for other in every]
            if any(differs):
                rank = differs.index(True)
                raise ValueError(
                    f"{name} must be the same on all ranks, got {every[0][name]} on rank 0 and "
                    f"{every[rank][name]} on rank {rank}"
                )


def _comparable(value: object) -> float | str:
    """Return what is compared of an argument."""
    if isinstance(value, Real):
        return float(value)
    if callable(value):
        return "a function"
    return "an array" if isinstance(value, np.ndarray) else repr(value)


def as_communicator(comm: object) -> Communicator:
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


class MpiCommunicator(Communicator):
    """The ranks of a communicator of mpi4py.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
        Not duplicated: no other thread may use it at the same time.
    """

    def __init__(self, comm: Any) -> None:
        self.mpi = comm
        self.rank, self.size = self.mpi.Get_rank(), self.mpi.Get_size()
        self.traffic = Traffic()

    def allgather(self, value: T) -> list[T]:
        """Return the values of all ranks, in order of rank."""
        data = as_words(value)
        self._count(data.nbytes)
        counts = np.empty(self.size, np.int64)
        self._wait()
        self.mpi.Allgather(np.array([len(data)], np.int64), counts)
        self._refuse_large(int(counts.sum()))
        every = np.empty(counts.sum(), np.uint64)
        ends = np.cumsum(counts)
        self.mpi.Allgatherv(data, [every, counts, ends - counts, _type_of(data.dtype)])
        return [pickle.loads(words.tobytes()) for words in np.split(every, ends[:-1])]

    def allreduce(self, value: Any, op: Operation) -> Any:
        """Return the sum, minimum or maximum over the ranks."""
        from mpi4py import MPI

        given = np.asarray(value)
        if given.dtype == np.bool_:  # MPI has no minimum of these
            given = given.astype(np.int8)
        self._count(given.nbytes)
        merge = {"sum": MPI.SUM, "min": MPI.MIN, "max": MPI.MAX}[op]
        result = np.empty(given.shape, given.dtype)
        self.mpi.Allreduce(np.ascontiguousarray(given), result, merge)
        return result if isinstance(value, np.ndarray) else result.item()

    def alltoallv(self, arrays: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
        """Send one array to each rank, and return the arrays received."""
        self.traffic.exchanges += 1
        self.traffic.bytes_sent += sum(a.nbytes for q, a in enumerate(arrays) if q != self.rank)
        send = np.concatenate(list(arrays))
        row_shape = send.shape[1:]
        n_send = np.array([len(a) for a in arrays], np.int64)
        n_receive = np.empty(self.size, np.int64)
        self.mpi.Alltoall(n_send, n_receive)
        self._refuse_large(max(int(n_send.sum()), int(n_receive.sum())))
        receive = np.empty((int(n_receive.sum()), *row_shape), send.dtype)
        # A row is one item, so that messages of more than 2 GB can be counted.
        row = _type_of(send.dtype).Create_contiguous(int(np.prod(row_shape, dtype=np.int64)))
        row.Commit()
        try:
            self.mpi.Alltoallv(
                [send, n_send, np.cumsum(n_send) - n_send, row],
                [receive, n_receive, np.cumsum(n_receive) - n_receive, row],
            )
        finally:
            row.Free()
        return np.split(receive, np.cumsum(n_receive)[:-1])

    def _wait(self) -> None:
        """Wait until all ranks are here, and leave the processor to those that are not yet.

        MPI waits busily, which slows down a generator on another rank if there are more ranks than
        cores.  Short waits stay busy: those between small exchanges.
        """
        here, started, pause = self.mpi.Ibarrier(), perf_counter(), _SHORTEST_PAUSE
        while not here.Test():
            if perf_counter() - started > _BUSY:
                sleep(pause)
                pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _count(self, n_bytes: int) -> None:
        self.traffic.reductions += 1
        self.traffic.bytes_gathered += n_bytes

    def _refuse_large(self, n_rows: int) -> None:
        """Raise an OverflowError on all ranks if a message on any rank is too long for MPI."""
        from mpi4py import MPI

        if self.mpi.allreduce(n_rows, MPI.MAX) > _LARGEST_COUNT:
            raise OverflowError(
                f"a rank sends or receives more than {_LARGEST_COUNT} rows at once: use more ranks"
            )


def _type_of(dtype: np.dtype[Any]) -> Any:
    """Return the type of MPI for a type of numpy."""
    from mpi4py.util import dtlib

    return dtlib.from_numpy_dtype(dtype)


def as_words(value: object) -> npt.NDArray[np.uint64]:
    """Return an object as numbers of 8 bytes, of which MPI can count more than of bytes."""
    data = pickle.dumps(value, protocol=5)
    return np.frombuffer(data + bytes(-len(data) % 8), np.uint64)


def split_rows(array: npt.NDArray[Any], rank: npt.NDArray[Any], size: int) -> list[Any]:
    """Return the rows for each rank, in their order, given the rank of each row."""
    order = np.argsort(rank, kind="stable")
    ends = np.cumsum(np.bincount(rank, minlength=size))
    return np.split(array[order], ends[:-1])


def rows_among(numbers: npt.NDArray[Any], ascending: npt.NDArray[Any]) -> IntArray:
    """Return the row of each number in an ascending list, -1 for those that are not in it."""
    if len(ascending) == 0:
        return np.full(numbers.shape, -1, np.int32)
    at = np.minimum(np.searchsorted(ascending, numbers), len(ascending) - 1)
    return np.where(ascending[at] == numbers, at, -1).astype(np.int32)


if TYPE_CHECKING:
    kept = cached_property
else:

    class kept(cached_property):
        """A cached property without the lock of Python 3.10 and 3.11.

        Ranks in other threads would wait for it if the computation is collective.
        """

        def __get__(self, instance, owner=None):
            """Return the value, computed on first use."""
            if instance is None:
                return self
            values = vars(instance)
            if self.attrname not in values:
                values[self.attrname] = self.func(instance)
            return values[self.attrname]


def values_in_order(
    comm: Communicator, values: npt.NDArray[np.float64], places: npt.NDArray[Any]
) -> npt.NDArray[np.float64]:
    """Return those of the numbers >= 0 of all ranks that are at places of their order; collective.

    Such numbers are ordered like their bits, of which each of eight reductions finds eight.
    """
    bits = np.sort(values).view(np.int64)
    found = np.zeros(len(places), np.int64)
    for shift in range(56, -8, -8):
        digits = np.arange(1, 256 if shift < 56 else 128, dtype=np.int64) << shift
        below = comm.allreduce(np.searchsorted(bits, found[:, None] + digits), "sum")
        found += np.count_nonzero(below <= places[:, None], axis=1).astype(np.int64) << shift
    return found.view(np.float64)


class SharedNodes(NamedTuple):
    """Nodes of a mesh that several ranks hold; none on a single rank."""

    ranks: Communicator
    nodes: list[IntArray]
    """For each rank, the local nodes that it holds too, ascending in their global numbers."""
    every: IntArray
    """All local nodes that another rank holds."""

    def merge(self, values: npt.NDArray[Any], merge: np.ufunc) -> npt.NDArray[Any]:
        """Return nodal values, those of shared nodes merged in order of rank; one exchange."""
        if self.ranks.size == 1:
            return values.copy()
        received = self.ranks.alltoallv([values[nodes] for nodes in self.nodes])
        merged = values.copy()
        if merge.identity is not None:
            merged[self.every] = merge.identity
        for rank in range(self.ranks.size):
            nodes, found = self.nodes[rank], received[rank]
            if rank == self.ranks.rank:
                nodes, found = self.every, values[self.every]
            merged[nodes] = merge(merged[nodes], found)
        return merged


def no_shared_nodes() -> SharedNodes:
    """Return the shared nodes of a whole mesh: none, on a single rank."""
    none = np.empty(0, np.int32)
    return SharedNodes(SingleRank(), [none], none)


def find_shared_nodes(
    comm: Communicator, global_ids: npt.NDArray[np.int64], owner: IntArray
) -> SharedNodes:
    """Return the shared nodes; two exchanges.

    Raises
    ------
    ValueError
        On all ranks, if the owner of a node does not hold it.
    """
    order = np.argsort(global_ids, kind="stable")
    ids = global_ids[order]
    away = np.flatnonzero(owner != comm.rank)
    asked = comm.alltoallv(split_rows(global_ids[away], owner[away], comm.size))
    wanted = np.concatenate(asked)
    by = np.repeat(np.arange(comm.size), [len(part) for part in asked])

    def check() -> None:
        known = np.isin(wanted, global_ids[owner == comm.rank])
        if not known.all():
            first = int(np.argmin(known))
            raise ValueError(
                f"owner must be a rank that holds and owns the node, "
                f"but rank {by[first]} names this rank for global node {wanted[first]}"
            )

    comm.agree(check)
    # Pairs of a node and a rank that holds it, including the owner.
    held = np.unique(wanted)
    node = np.concatenate([wanted, held])
    rank = np.concatenate([by, np.full(len(held), comm.rank)])
    sort = np.lexsort((rank, node))
    node, rank = node[sort], rank[sort]
    counts = np.bincount(np.searchsorted(held, node), minlength=len(held))
    # Each holder of a node gets all holders of it.
    start = np.repeat(np.cumsum(counts) - counts, counts**2)
    within = np.arange(len(start)) - np.repeat(np.cumsum(counts**2) - counts**2, counts**2)
    width = np.repeat(counts, counts**2)
    receiver, holder = start + within // width, start + within % width
    pairs = np.column_stack([node[receiver], rank[holder]])
    pairs = pairs[receiver != holder]
    receiver = receiver[receiver != holder]
    received = np.concatenate(comm.alltoallv(split_rows(pairs, rank[receiver], comm.size)))
    local = order[np.searchsorted(ids, received[:, 0])].astype(np.int32)
    sort = np.lexsort((received[:, 0], received[:, 1]))
    nodes = split_rows(local[sort], received[sort, 1], comm.size)
    return SharedNodes(comm, nodes, np.unique(local))
