"""Partitions of the cells of a mesh, and runs of a function on simulated ranks."""

import numpy as np
from simulated_ranks import SimulatedCommunicator

from adaptsize import limit_gradient
from adaptsize.distributed import PartitionedMesh

KINDS = ("default", "random", "strips", "single cells", "some empty")
BOUNDS = ("two", "some", "noise", "smooth", "limited", "corner")
SIZE = 4
#: Attributes of `LimitingInfo` that do not depend on the partition.
FIGURES = ["method", "converged", "n_points", "n_changed", "n_free", "residual"]
FIGURES += ["largest_edge_slope", "cell_gradient_quantiles", "n_proved", "largest_gap"]


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


def bounds(mesh, kind, rng):
    """Return bounds in the unit of the mesh."""
    scale, n = mesh.diagonal, mesh.n_points
    if kind == "smooth":
        waves = np.sin(7.0 * mesh.points[:, 0] / scale) * np.cos(9.0 * mesh.points[:, 1] / scale)
        return scale * (0.05 + 0.3 * waves**2)
    h0 = scale * rng.uniform(0.01, 0.3, n)
    if kind == "some":
        h0[rng.random(n) < 0.8] = np.inf
    elif kind == "corner":
        h0[1:] = np.inf
    elif kind in ("two", "limited"):
        h0[rng.permutation(n)[2:]] = np.inf
    return limit_gradient(mesh, h0, 0.3) if kind == "limited" else h0
