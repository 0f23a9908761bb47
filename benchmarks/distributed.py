"""Distributed limiting: processor and wall time of each rank, and bytes, on 1 and more ranks.

    mpiexec -n 2 python benchmarks/distributed.py --nodes 1000000

Prints one row per problem: the largest times of all ranks, the sum of their work, and the sum of
the bytes that they send.  Work is processor time outside of collective operations, where MPI waits
busily.  The first call on a mesh also finds the boundary.  The least of several measurements
counts, each with a new mesh, after one that loads the kernels.
"""

import argparse
import time
from functools import partial

import numpy as np
from mpi4py import MPI

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.distributed import PartitionedMesh
from adaptsize.limiting import Exact
from adaptsize.ranks import Communicator, as_communicator

#: Meshes on which first and later calls are measured.
REPETITIONS = 4


def kuhn_cube(n):
    """Return the unit cube as n^3 boxes of six tetrahedra each."""
    axis = np.linspace(0.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    step = np.array([(n + 1) ** 2, n + 1, 1])
    first = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1) @ step).ravel()
    cells = []
    for a, b, c in [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]:
        offsets = np.cumsum([0, step[a], step[b], step[c]])
        cells.append(first[:, None] + offsets)
    return SimplexMesh(points, np.concatenate(cells))


def square(n):
    """Return the unit square as n^2 boxes of two triangles each."""
    axis = np.linspace(0.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = [first[:, None] + [0, n + 1, n + 2], first[:, None] + [0, n + 2, 1]]
    return SimplexMesh(points, np.concatenate(cells))


def bounds(points, kind, spacing):
    """Return bounds: at two points, or a field at every node with |grad| up to 4 g."""
    if kind == "field":
        x, y = points[:, 0], points[:, 1]
        return 0.02 + 0.1 * (np.sin(9.0 * x) * np.cos(7.0 * y)) ** 2
    away = [np.abs(points - corner).max(axis=1) for corner in (0.25, 0.75)]
    return np.where(np.minimum(*away) < 0.6 * spacing, 0.01, np.inf)


def watch(comm: Communicator) -> list[float]:
    """Return a list to which the processor seconds inside of collective operations are added."""
    seconds, depth = [0.0], [0]

    def timed(method):
        def call(*given):
            depth[0] += 1
            began = time.process_time()
            try:
                return method(*given)
            finally:
                depth[0] -= 1
                if depth[0] == 0:  # some operations consist of others
                    seconds[0] += time.process_time() - began

        return call

    for name in ("allgather", "allreduce", "alltoallv"):
        setattr(comm, name, timed(getattr(comm, name)))
    return seconds


def measured(comm: Communicator, inside: list[float], call) -> tuple[float, ...]:
    """Return the processor and wall time of the slowest rank, and the work and bytes of all."""
    comm.allgather(None)  # all begin at the same time
    sent = comm.traffic.bytes_sent
    inside[0], wall, cpu = 0.0, time.perf_counter(), time.process_time()
    call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    sums = np.array([cpu - inside[0], comm.traffic.bytes_sent - sent])
    most = comm.allreduce(np.array([cpu, wall]), "max")
    return (*most.tolist(), *comm.allreduce(sums, "sum").tolist())


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--nodes", type=int, default=100_000)
    nodes = parser.parse_args().nodes
    comm = as_communicator(MPI.COMM_WORLD)
    inside, exact = watch(comm), Exact(face_sources=False, threads=1)
    for domain, (make, dim) in {"square": (square, 2), "cube": (kuhn_cube, 3)}.items():
        n = round(nodes ** (1.0 / dim)) - 1
        whole = make(n) if comm.rank == 0 else None
        slabs = None
        if whole is not None:
            middle = whole.points[whole.cells].mean(axis=1)[:, 0]
            slabs = np.minimum((middle * comm.size).astype(int), comm.size - 1)
        for kind in ("two points", "field"):
            costs = {"first call": [], "later calls": []}
            for _ in range(1 + REPETITIONS):
                part = PartitionedMesh.from_serial(whole, slabs, comm)
                limit = partial(
                    limit_gradient, part, bounds(part.points, kind, 1.0 / n), 0.3, method=exact
                )
                for which in ("first call", "later calls", "later calls"):
                    costs[which].append(measured(comm, inside, limit))
            for which, found in costs.items():
                if comm.rank == 0:
                    # The first mesh loads kernels, some of which only large meshes need.
                    cpu, wall, work, sent = np.min(found[len(found) // (1 + REPETITIONS) :], axis=0)
                    print(
                        f"{comm.size} ranks, {domain}, {part.n_global_points} nodes, {kind}, "
                        f"{which}: cpu {cpu:.3f} s, wall {wall:.3f} s, work {work:.3f} s, "
                        f"{sent:.0f} bytes",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
