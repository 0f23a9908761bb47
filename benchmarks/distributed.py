"""Distributed limiting: processor and wall time of each rank, and bytes, on 1 and more ranks.

    mpiexec -n 2 python benchmarks/distributed.py --nodes 1000000

Prints one row per problem: the largest times of all ranks, the sum of their work, and the sum of
the bytes that they send.  Work is processor time outside of collective operations, where MPI waits
busily.  The first call on a mesh also finds the boundary; of three later calls
the least counts.
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


def measured(comm: Communicator, inside: list[float], call) -> tuple[float, float, float]:
    """Return the processor and wall time of the slowest rank, and the work of all."""
    comm.allgather(None)  # all begin at the same time
    inside[0], wall, cpu = 0.0, time.perf_counter(), time.process_time()
    call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    work = comm.allreduce(cpu - inside[0], "sum")
    return comm.allreduce(cpu, "max"), comm.allreduce(wall, "max"), work


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--nodes", type=int, default=100_000)
    nodes = parser.parse_args().nodes
    comm = as_communicator(MPI.COMM_WORLD)
    inside, exact = watch(comm), Exact(face_sources=False, threads=1)
    makers = {"square": (square, 2), "cube": (kuhn_cube, 3)}
    sizes = [(domain, count) for count in (500, nodes) for domain in makers]
    for domain, count in sizes:  # small ones first, silently: kernels are loaded once per process
        make, dim = makers[domain]
        n = round(count ** (1.0 / dim)) - 1
        whole = make(n) if comm.rank == 0 else None
        slabs = None
        if whole is not None:
            middle = whole.points[whole.cells].mean(axis=1)[:, 0]
            slabs = np.minimum((middle * comm.size).astype(int), comm.size - 1)
        part = PartitionedMesh.from_serial(whole, slabs, comm)
        for kind in ("two points", "field"):
            h0 = bounds(part.points, kind, 1.0 / n)
            limit = partial(limit_gradient, part, h0, 0.3, method=exact)
            later = []
            for call in range(4):
                sent = comm.traffic.bytes_sent
                cost = measured(comm, inside, limit)
                sent = comm.allreduce(comm.traffic.bytes_sent - sent, "sum")
                later += [cost] if call else []
                if comm.rank == 0 and count == nodes and call in (0, 3):
                    best = np.min(later, axis=0) if call else cost
                    size = f"{comm.size} ranks, {domain}, {part.n_global_points} nodes, {kind}"
                    text = "cpu {:.3f} s, wall {:.3f} s, work {:.3f} s".format(*best)
                    print(
                        f"{size}, {'later calls' if call else 'first call'}: {text}, {sent} bytes",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
