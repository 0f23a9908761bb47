"""Partitions of the cells of a mesh, and runs of a function on simulated ranks."""

import numpy as np

from adaptsize.distributed import PartitionedMesh, SimulatedCommunicator

KINDS = ("default", "random", "strips", "single cells", "some empty")


def partition(mesh, kind, size, rng):
    """Return the rank of each cell, or None for the partition that is made by default."""
    if kind == "default":
        return None
    if kind == "random":
        return rng.integers(0, size, mesh.n_cells)
    if kind == "strips":
        x = mesh.points[mesh.cells].mean(axis=1) @ rng.normal(size=mesh.dim)
        return np.minimum((size * (x - x.min()) / np.ptp(x)).astype(int), size - 1)
    rank = np.zeros(mesh.n_cells, int)
    if kind == "single cells":
        rank[rng.choice(mesh.n_cells, size - 1, replace=False)] = np.arange(1, size)
        return rank
    return np.where(rng.random(mesh.n_cells) < 0.5, 0, size - 1)


def on_ranks(mesh, rank_of, size, function):
    """Return ``function(part)`` of all ranks, and the parts."""

    def work(comm):
        part = PartitionedMesh.from_serial(mesh if comm.rank == 0 else None, rank_of, comm)
        return function(part), part

    results = SimulatedCommunicator.run(size, work)
    return [result for result, _ in results], [part for _, part in results]
