"""Simulated ranks: results, counts, and failures that reach all ranks."""

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator

from adaptsize.ranks import SingleRank, as_communicator, split_rows

run = SimulatedCommunicator.run


def test_each_operation():
    def work(comm):
        rows = [np.full((comm.rank, 2), 10 * comm.rank + q) for q in range(comm.size)]
        received = comm.alltoallv(rows)
        assert [len(part) for part in received] == [0, 1, 2]
        assert [set(part.ravel()) for part in received[1:]] == [{10 + comm.rank}, {20 + comm.rank}]
        assert comm.allgather({"rank": comm.rank}) == [{"rank": q} for q in range(3)]
        assert comm.allreduce(0.1 * comm.rank, "sum") == pytest.approx(0.3)
        assert comm.allreduce(np.array([comm.rank, 5]), "max").tolist() == [2, 5]
        assert comm.allreduce(comm.rank, "min") == 0
        assert comm.bcast("a" if comm.rank == 1 else None, 1) == "a"
        assert comm.alltoall([comm.rank, None, [comm.rank]])[comm.rank] in (0, None, [2])
        comm.barrier()
        return comm.traffic

    traffic = run(3, work)
    assert [own.exchanges for own in traffic] == [2, 2, 2]
    assert traffic[2].bytes_sent >= 2 * 2 * 2 * 8


def test_received_arrays_are_copies():
    def work(comm):
        own = np.zeros(1)
        received = comm.alltoallv([own, own])
        own[0] = 7.0
        comm.barrier()
        return [part[0] for part in received]

    assert run(2, work) == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_a_failure_on_one_rank_ends_all(bad):
    def work(comm):
        comm.barrier()
        if comm.rank == bad:
            raise KeyError("lost")
        comm.allgather(0)

    with pytest.raises(KeyError, match="lost"):
        run(3, work)


def test_a_rank_that_returns_early_is_an_error_not_a_deadlock():
    with pytest.raises(RuntimeError, match=r"ranks \[1\] do not take part in barrier"):
        run(2, lambda comm: comm.barrier() if comm.rank == 0 else None)


def test_different_operations_are_an_error():
    def work(comm):
        return comm.barrier() if comm.rank else comm.allgather(1)

    with pytest.raises(RuntimeError, match="different operations"):
        run(2, work)


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
