"""Ranks as processes, by mpi4py."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize.distributed.communicator import Communicator, Operation, Traffic, as_words

T = TypeVar("T")

# Largest number of rows that MPI counts, in messages and their offsets.
_LARGEST = 2**31 - 1


class MpiCommunicator(Communicator):
    """The ranks of a communicator of mpi4py.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
        Not duplicated: no other thread may use it at the same time.
    """

    def __init__(self, comm: Any) -> None:
        self._comm = comm
        self.rank, self.size = self._comm.Get_rank(), self._comm.Get_size()
        self.traffic = Traffic()

    @property
    def mpi(self) -> Any:
        """The communicator of mpi4py."""
        return self._comm

    def allgather(self, value: T) -> list[T]:
        """Return the values of all ranks, in order of rank."""
        data = as_words(value)
        self._count(data.nbytes)
        counts = np.empty(self.size, np.int64)
        self._comm.Allgather(np.array([len(data)], np.int64), counts)
        self._refuse_large(int(counts.sum()))
        every = np.empty(counts.sum(), np.uint64)
        ends = np.cumsum(counts)
        self._comm.Allgatherv(data, [every, counts, ends - counts, _type_of(data.dtype)])
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
        self._comm.Allreduce(np.ascontiguousarray(given), result, merge)
        return result if isinstance(value, np.ndarray) else result.item()

    def alltoallv(self, arrays: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
        """Send one array to each rank, and return the arrays received."""
        self.traffic.exchanges += 1
        self.traffic.bytes_sent += sum(a.nbytes for q, a in enumerate(arrays) if q != self.rank)
        send = np.concatenate(list(arrays))
        row_shape = send.shape[1:]
        n_send = np.array([len(a) for a in arrays], np.int64)
        n_receive = np.empty(self.size, np.int64)
        self._comm.Alltoall(n_send, n_receive)
        self._refuse_large(max(int(n_send.sum()), int(n_receive.sum())))
        receive = np.empty((int(n_receive.sum()), *row_shape), send.dtype)
        # A row is one item, so that messages of more than 2 GB can be counted.
        row = _type_of(send.dtype).Create_contiguous(int(np.prod(row_shape, dtype=np.int64)))
        row.Commit()
        try:
            self._comm.Alltoallv(
                [send, n_send, np.cumsum(n_send) - n_send, row],
                [receive, n_receive, np.cumsum(n_receive) - n_receive, row],
            )
        finally:
            row.Free()
        return np.split(receive, np.cumsum(n_receive)[:-1])

    def bcast(self, value: T, root: int = 0) -> T:
        """Return the value of one rank on all ranks."""
        self._count(0)
        found: T = self._comm.bcast(value, root)
        return found

    def barrier(self) -> None:
        """Wait for all ranks."""
        self._comm.Barrier()

    def _count(self, n_bytes: int) -> None:
        self.traffic.reductions += 1
        self.traffic.bytes_gathered += n_bytes

    def _refuse_large(self, n_rows: int) -> None:
        """Raise an OverflowError on all ranks if a message on any rank is too long for MPI."""
        from mpi4py import MPI

        if self._comm.allreduce(n_rows, MPI.MAX) > _LARGEST:
            raise OverflowError(
                f"a rank sends or receives more than {_LARGEST} rows at once: use more ranks"
            )


def _type_of(dtype: np.dtype[Any]) -> Any:
    """Return the type of MPI for a type of numpy."""
    from mpi4py.util import dtlib

    return dtlib.from_numpy_dtype(dtype)
