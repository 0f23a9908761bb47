"""Limit sizes on a large mesh of tetrahedra on one machine, and measure memory and time.

    python benchmarks/hundred_million.py [--divisions 256] [--bounds smooth|few|steep]
    mpiexec -n 2 python benchmarks/hundred_million.py [the same]

The cube is divided into n^3 boxes of six tetrahedra each (Kuhn's division); n = 256 gives 100.7
million tetrahedra and 17.0 million nodes.  Cells and nodes are written slab by slab into arrays
that exist once.  With ``--file`` the cells are a memory-mapped file, which the operating system
may evict.  Prints the peak of the resident memory, and what the limiting adds to that of the input,
per node and per cell.  Started by mpiexec (with mpi4py), each rank makes the slabs of its own, and
figures are sums over the ranks, or those of the slowest one.
"""

import argparse
import os
import resource
import time
from itertools import permutations
from pathlib import Path

import numpy as np

from adaptsize import SimplexMesh, distributed, limit_gradient
from adaptsize.limiting import Exact

G = 0.3
GIB = 2.0**30


def peak_memory():
    """Return the peak of the resident memory of this process in bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def kuhn_points(n, slabs=None):
    """Return the nodes of the slabs of the unit cube with n divisions, by default of all."""
    first, end = slabs or (0, n)
    points = np.empty((end - first + 1, n + 1, n + 1, 3))
    axis = np.linspace(0.0, 1.0, n + 1)
    points[..., 0] = axis[first : end + 1, None, None]
    points[..., 1] = axis[:, None]
    points[..., 2] = axis
    return read_only(points.reshape(-1, 3))


def kuhn_cells(n, file=None, slabs=None):
    """Return the tetrahedra, int32[6 n^2 slabs, 4], made slab by slab, in memory or in a file."""
    first, end = slabs or (0, n)
    strides = np.array([(n + 1) ** 2, n + 1, 1])
    steps = [np.concatenate([[0], np.cumsum(strides[list(p)])]) for p in permutations(range(3))]
    paths = np.array(steps, np.int32)  # from one corner of a box to the opposite one
    shape = (6 * n**2 * (end - first), 4)
    cells = np.empty(shape, np.int32) if file is None else np.lib.format.open_memmap(
        file, mode="w+", dtype=np.int32, shape=shape
    )  # fmt: skip
    across = np.arange(n, dtype=np.int32)
    face = (across[:, None] * np.int32(n + 1) + across).ravel()
    slab = (face[:, None, None] + paths).reshape(-1, 4)
    for i in range(end - first):
        np.add(slab, np.int32(i * (n + 1) ** 2), out=cells[i * len(slab) : (i + 1) * len(slab)])
    if file is not None:
        cells.flush()
        return np.load(file, mmap_mode="r")
    return read_only(cells)


def read_only(array):
    """Return the array; a mesh does not copy what nobody can modify."""
    array.flags.writeable = False
    return array


def bounds(kind, points, n):
    """Return h0: 'few' bounds, 'smooth' ones with a steep shell, or ones 'steep' everywhere."""
    if kind == "few":
        first = round(points[0, 0] * n) * (n + 1) ** 2  # number of the first node of these slabs
        rng = np.random.default_rng(4711)
        n_nodes = (n + 1) ** 3
        chosen = rng.choice(n_nodes, 1 + n_nodes // 1000, replace=False)
        values = (0.5 + rng.random(len(chosen))) / n
        here = (chosen >= first) & (chosen < first + len(points))
        h0 = np.full(len(points), np.inf)
        h0[chosen[here] - first] = values[here]
        return h0
    h0 = np.empty(len(points))
    for first in range(0, len(points), 2**20):
        x = points[first : first + 2**20]
        if kind == "steep":  # waves with twice the slope that is allowed
            phase = 2.0 * np.pi * 8.0 * x.sum(axis=1)
            h0[first : first + 2**20] = 0.05 + 2.0 * G / (16.0 * np.pi * 3**0.5) * np.sin(phase)
        else:
            away = np.linalg.norm(x - 0.5, axis=1) - 0.3
            h0[first : first + 2**20] = 0.02 + 0.2 * np.tanh(5.0 * np.abs(away)) ** 2
    return h0


def main():
    """Make the mesh, limit, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--divisions", type=int, default=256)
    parser.add_argument("--bounds", choices=("few", "smooth", "steep"), default="smooth")
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--file", type=Path, default=None, help="memory-mapped file for the cells")
    given = parser.parse_args()
    comm = processes()
    small = SimplexMesh(kuhn_points(4), kuhn_cells(4))
    limit_gradient(small, bounds(given.bounds, small.points, 4), G)  # compiles
    program = peak_memory()
    mesh, limit = whole_mesh(given) if comm is None else part_of_mesh(given, comm)
    h0 = bounds(given.bounds, mesh.points, given.divisions)
    before = peak_memory()
    wall, own = time.perf_counter(), time.process_time()
    h = limit(h0)
    wall, own = time.perf_counter() - wall, time.process_time() - own
    mine = (program, before, peak_memory(), wall, own, h.min(), h.max(), np.mean(h < h0))
    rows = np.array([mine] if comm is None else comm.allgather(mine))
    if comm is None or comm.rank == 0:
        report(given, rows)


def processes():
    """Return the communicator if mpiexec started several processes, else None."""
    if not {"PMI_SIZE", "OMPI_COMM_WORLD_SIZE"} & set(os.environ):
        return None
    from mpi4py import MPI  # one process needs no MPI

    return MPI.COMM_WORLD


def whole_mesh(given):
    """Return the mesh, and the function that limits sizes on it."""
    n = given.divisions
    mesh = SimplexMesh(kuhn_points(n), kuhn_cells(n, given.file))
    return mesh, lambda h0: limit_gradient(mesh, h0, G, method=Exact(threads=given.threads))


def part_of_mesh(given, comm):
    """Return the slabs of this rank, and the function that limits sizes on them."""
    n = given.divisions
    first, end = (n * rank // comm.size for rank in (comm.rank, comm.rank + 1))
    own = SimplexMesh(kuhn_points(n, (first, end)), kuhn_cells(n, given.file, (first, end)))
    plane = (n + 1) ** 2
    numbers = first * plane + np.arange(own.n_points)
    owner = np.full(own.n_points, comm.rank)
    if comm.rank > 0:
        owner[:plane] -= 1  # the first plane is the last one of the rank below
    part = distributed.PartitionedMesh(own, numbers, owner, comm)
    return own, lambda h0: limit_gradient(part, h0, G)


def report(given, rows):
    """Print sums of the memory and the largest times of the processes."""
    n_cells, n_points = 6 * given.divisions**3, (given.divisions + 1) ** 3
    program, before, peak = rows[:, :3].sum(axis=0)
    wall, own = rows[:, 3:5].max(axis=0)
    print(f"{n_cells} tetrahedra, {n_points} nodes, bounds {given.bounds}, {len(rows)} processes")
    print(
        f"{rows[:, 7].mean():.1%} of the nodes lowered, smallest size {rows[:, 5].min():.9g}, "
        f"largest {rows[:, 6].max():.9g}"
    )
    for text, bytes_ in (
        ("program and compiled code", program),
        ("with mesh and bounds", before),
        ("peak", peak),
    ):
        print(f"{text:28}{bytes_ / GIB:8.3f} GiB")
    per_node, per_cell = ((peak - program) / count for count in (n_points, n_cells))
    print(f"peak without the program: {per_node:.0f} bytes per node, {per_cell:.1f} per cell")
    print(f"limiting: {wall:.1f} s, {own:.1f} s of processor time of the slowest process")


if __name__ == "__main__":
    main()
