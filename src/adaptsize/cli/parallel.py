"""The command line on several ranks of MPI: one output, one error message, one exit code.

Rank 0 prints.  An error that only one rank meets, while others wait for it in the library, would
leave these waiting for ever.  So each rank reports its end through a communicator of its own, and
a failed rank that does not hear from all others soon ends them.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adaptsize.cli.console import Console
    from adaptsize.ranks import Communicator

#: Variables in which launchers of MPI pass the number of ranks: MPICH and Intel MPI, Open MPI,
#: MVAPICH.
_SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE", "MPI_LOCALNRANKS")
#: A rank that has failed waits so many seconds for the others.
_PATIENCE = 5.0
_POLL = 0.02


def is_started_by_mpi(environment: Mapping[str, str]) -> bool:
    """Return whether a launcher of MPI has started several ranks."""
    return any(environment.get(name, "1").isdigit() and int(environment.get(name, "1")) > 1
               for name in _SIZES)  # fmt: skip


def world_of(arguments: Sequence[str]) -> World | None:
    """Return the ranks of MPI, if there are several or ``--mpi`` is given, otherwise None.

    Raises
    ------
    ImportError
        If mpi4py is missing.
    """
    if "--mpi" not in arguments and not is_started_by_mpi(os.environ):
        return None
    try:
        from mpi4py import MPI
    except ImportError as error:
        raise ImportError(
            'several ranks need mpi4py: pip install "adaptsize[mpi]", and an MPI such as mpich'
        ) from error
    return World(MPI.COMM_WORLD)


class World:
    """All ranks of MPI.

    Attributes
    ----------
    comm : Communicator
        For the library.
    """

    comm: Communicator

    def __init__(self, comm: Any) -> None:
        from adaptsize.ranks import as_communicator

        self.comm = as_communicator(comm)
        self._ends = comm.Dup()  # only for the ends of the ranks

    @property
    def is_first(self) -> bool:
        """Whether this rank prints."""
        return self.comm.rank == 0

    def finish(self, code: int, console: Console) -> int:
        """Wait for the other ranks, and return the largest exit code.

        The first rank that failed prints its error.  A failed rank waits some seconds only.  If
        the others have not ended by then, it prints its error and ends them.
        """
        import numpy as np

        codes = np.empty(self.comm.size, np.int32)
        request = self._ends.Iallgather(np.array([code], np.int32), codes)
        deadline = time.monotonic() + _PATIENCE
        while not request.Test():
            if code and time.monotonic() > deadline:
                console.print_failure(f"rank {self.comm.rank}: ")
                sys.stdout.flush()
                self._ends.Abort(code)
            time.sleep(_POLL)
        if codes.any() and self.comm.rank == int(np.flatnonzero(codes)[0]):
            # An error of the library that is raised on all ranks names the rank itself.
            alone = np.count_nonzero(codes) == 1 and self.comm.size > 1
            console.print_failure(f"rank {self.comm.rank}: " if alone else "")
        return int(codes.max())
