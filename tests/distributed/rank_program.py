"""What the ranks of test_mpi.py run: limits compared with the serial ones, and failures."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])

import domains
from meshes import jittered_cube, jittered_square, random_sphere

from adaptsize import adapt, limit_gradient, read, remesh, write
from adaptsize.distributed import PartitionedMesh, read_parts, write_parts
from adaptsize.ranks import as_communicator


def compare(comm):
    """Limit on parts and on the whole, in the plane and in space, convex and not."""
    meshes = jittered_square(12, 881), jittered_cube(5, 882), domains.blocks(10, seed=883)[0]
    rng = np.random.default_rng(884)
    for mesh in (*meshes, random_sphere(80, 885)):
        h0 = mesh.diagonal * rng.uniform(0.01, 0.3, mesh.n_points)
        whole = limit_gradient(mesh, h0, 0.3)
        part = PartitionedMesh.from_serial(mesh if comm.rank == 0 else None, None, comm)
        h = limit_gradient(part, h0[part.global_ids], 0.3)
        if mesh.cell_dim == mesh.dim:
            assert np.array_equal(h, whole[part.global_ids])
        np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-12)
        assert np.array_equal(part.exchange(h), h)
        gathered = part.gather()
        assert gathered is None or np.array_equal(gathered.cells, mesh.cells)


def operations(comm):
    """Each operation of the communicator."""
    q, n = comm.rank, comm.size
    received = comm.alltoallv([np.full((q, 2), 10.0 * q + r) for r in range(n)])
    assert [part.tolist() for part in received] == [[[10.0 * r + q] * 2] * r for r in range(n)]
    empty = comm.alltoallv([np.empty((0, 3), np.int8)] * n)
    assert all(part.shape == (0, 3) and part.dtype == np.int8 for part in empty)
    assert comm.allgather({"rank": q}) == [{"rank": r} for r in range(n)]
    assert comm.allreduce(0.5, "sum") == 0.5 * n
    assert comm.allreduce(np.array([q, -q]), "max").tolist() == [n - 1, 0]
    assert comm.allreduce(q, "min") == 0
    assert comm.bcast("a" if q == n - 1 else None, n - 1) == "a"
    assert comm.alltoall([(q, r) for r in range(n)]) == [(r, q) for r in range(n)]


def waiting(comm):
    """Ranks that wait for another one leave the processor to it."""
    comm.allgather(None)
    used, began = time.process_time(), time.perf_counter()
    if comm.rank == 0:
        time.sleep(0.5)
    comm.allgather(None)
    # A rank that asks again and again uses all of the time, where a processor is free.
    assert time.process_time() - used < 0.5 * (time.perf_counter() - began)


def report(comm):
    """Bad input on the last rank is reported by all."""
    mesh = jittered_square(6, 886)
    part = PartitionedMesh.from_serial(mesh if comm.rank == 0 else None, None, comm)
    h0 = np.ones(part.n_points)
    if comm.rank == comm.size - 1:
        h0[0] = -1.0
    where = f"rank {comm.size - 1}: " if comm.size > 1 else ""
    with pytest.raises(ValueError, match=f"^{where}h0 must be positive"):
        limit_gradient(part, h0, 0.3)


def cycle(comm):
    """One adaptation cycle."""
    mesh = jittered_square(8, 887)
    part = PartitionedMesh.from_serial(mesh if comm.rank == 0 else None, None, comm)
    away = np.linalg.norm(part.points[part.cells].mean(axis=1), axis=1) / mesh.diagonal
    result = adapt(part, np.exp(-5.0 * away), elements=500, fields={"x": part.points})
    np.testing.assert_allclose(result.fields["x"], result.mesh.points, atol=1e-12)
    assert result.remeshed
    assert result.report.budget_met
    assert comm.allgather(str(result)) == [str(result)] * comm.size


def files(comm):
    """A mesh is read, limited, remeshed and written; one process reads the file of all ranks."""
    with tempfile.TemporaryDirectory() as own:
        folder = Path(comm.bcast(own, 0))
        mesh = jittered_square(8, 888)
        bounds = mesh.diagonal * np.where(np.arange(mesh.n_points) == 0, 0.01, 0.05)
        if comm.rank == 0:
            write(folder / "in.vtu", mesh, fields={"h0": bounds})
        comm.allgather(None)  # wait for all
        part = read_parts(folder / "in.vtu", comm)
        h = limit_gradient(part, part.mesh.point_data["h0"], 0.3)
        write_parts(folder / "h.vtkhdf", part, fields={"h": h})
        write_parts(folder / "fine.vtkhdf", remesh(part, h))
        found, fine = read(folder / "h.vtkhdf"), read(folder / "fine.vtkhdf")
        assert found.n_points == mesh.n_points
        whole = limit_gradient(found, found.point_data["h0"], 0.3)
        assert np.array_equal(found.point_data["h"], whole)
        assert fine.measures.sum() == pytest.approx(mesh.measures.sum())
        assert fine.n_cells > 2 * mesh.n_cells
        comm.allgather(None)  # wait for all


if __name__ == "__main__":
    from mpi4py import MPI

    ranks = as_communicator(MPI.COMM_WORLD)
    for task in (operations, waiting, compare, report, cycle, files):
        task(ranks)
    print(f"rank {ranks.rank} done", flush=True)
