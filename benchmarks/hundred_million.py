"""Limit sizes on a large mesh of tetrahedra on one machine, and measure memory and time.

    python benchmarks/hundred_million.py [--divisions 256] [--bounds smooth|few|steep]

The cube is divided into n^3 boxes of six tetrahedra each (Kuhn's division); n = 256 gives 100.7
million tetrahedra and 17.0 million nodes.  Cells and nodes are written slab by slab into arrays
that exist once.  With ``--file`` the cells are a memory-mapped file, which the operating system
may evict.  Prints the peak of the resident memory, and what the limiting adds to that of the input,
per node and per cell.
"""

import argparse
import resource
import time
from itertools import permutations
from pathlib import Path

import numpy as np

from adaptsize import SimplexMesh, limit_gradient

G = 0.3
GIB = 2.0**30


def peak_memory():
    """Return the peak of the resident memory of this process in bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def kuhn_points(n):
    """Return the nodes of the unit cube with n divisions, float64[(n + 1)^3, 3]."""
    points = np.empty(((n + 1), (n + 1), (n + 1), 3))
    axis = np.linspace(0.0, 1.0, n + 1)
    points[..., 0] = axis[:, None, None]
    points[..., 1] = axis[:, None]
    points[..., 2] = axis
    return read_only(points.reshape(-1, 3))


def kuhn_cells(n, file=None):
    """Return the tetrahedra, int32[6 n^3, 4], made slab by slab, in memory or in a file."""
    strides = np.array([(n + 1) ** 2, n + 1, 1])
    steps = [np.concatenate([[0], np.cumsum(strides[list(p)])]) for p in permutations(range(3))]
    paths = np.array(steps, np.int32)  # from one corner of a box to the opposite one
    shape = (6 * n**3, 4)
    cells = np.empty(shape, np.int32) if file is None else np.lib.format.open_memmap(
        file, mode="w+", dtype=np.int32, shape=shape
    )  # fmt: skip
    across = np.arange(n, dtype=np.int32)
    face = (across[:, None] * np.int32(n + 1) + across).ravel()
    slab = (face[:, None, None] + paths).reshape(-1, 4)
    for i in range(n):
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
        h0 = np.full(len(points), np.inf)
        rng = np.random.default_rng(4711)
        chosen = rng.choice(len(points), 1 + len(points) // 1000, replace=False)
        h0[chosen] = (0.5 + rng.random(len(chosen))) / n
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
    small = SimplexMesh(kuhn_points(4), kuhn_cells(4))
    limit_gradient(small, bounds(given.bounds, small.points, 4), G)  # compiles
    program = peak_memory()
    n = given.divisions
    mesh = SimplexMesh(kuhn_points(n), kuhn_cells(n, given.file))
    h0 = bounds(given.bounds, mesh.points, n)
    before = peak_memory()
    wall, own = time.perf_counter(), time.process_time()
    h = limit_gradient(mesh, h0, G, threads=given.threads)
    wall, own = time.perf_counter() - wall, time.process_time() - own
    peak = peak_memory()
    lowered = np.count_nonzero(h < h0) / mesh.n_points
    print(f"{mesh.n_cells} tetrahedra, {mesh.n_points} nodes, bounds {given.bounds}")
    print(f"{lowered:.1%} of the nodes lowered, smallest size {h.min():.6g}, largest {h.max():.6g}")
    for text, bytes_ in (
        ("program and compiled code", program),
        ("with mesh and bounds", before),
        ("peak", peak),
    ):
        print(f"{text:28}{bytes_ / GIB:8.3f} GiB")
    per_node, per_cell = ((peak - program) / count for count in (mesh.n_points, mesh.n_cells))
    print(f"peak without the program: {per_node:.0f} bytes per node, {per_cell:.1f} per cell")
    print(f"limiting: {wall:.1f} s, {own:.1f} s of processor time")


if __name__ == "__main__":
    main()
