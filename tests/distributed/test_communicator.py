"""Simulated ranks: results, counts, and failures that reach all ranks."""

import numpy as np
import pytest
from rank_program import operations
from simulated_ranks import SimulatedCommunicator

from adaptsize.ranks import SingleRank, as_communicator, split_rows

run = SimulatedCommunicator.run


def test_each_operation():
    run(3, operations)


def test_agreement_raises_the_same_error_on_all_ranks():
    def work(comm):
        def task():
            if comm.rank == 1:
                raise ValueError("g must be >= 0")

        with pytest.raises(ValueError, match=r"^rank 1: g must be >= 0$"):
            comm.agree(task)
        return comm.agree(lambda: comm.rank)

    assert run(3, work) == [0, 1, 2]


def test_a_single_process_needs_no_communicator():
    comm = as_communicator(None)
    assert isinstance(comm, SingleRank)
    assert comm.allreduce(3, "sum") == 3
    assert comm.alltoall(["x"]) == ["x"]
    with pytest.raises(ValueError, match=r"^bad$"):
        comm.agree(lambda: (_ for _ in ()).throw(ValueError("bad")))
    with pytest.raises(ValueError, match="comm must be a communicator of mpi4py or None, got 3"):
        as_communicator(3)


def test_rows_keep_their_order():
    parts = split_rows(np.array([5, 6, 7, 8]), np.array([1, 0, 1, 0]), 3)
    assert [part.tolist() for part in parts] == [[6, 8], [5, 7], []]
