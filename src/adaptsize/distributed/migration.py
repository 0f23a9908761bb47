"""Cells that move from rank to rank, and interfaces between parts."""

from __future__ import annotations

import numpy as np

from adaptsize.distributed.assembly import Piece, from_pieces
from adaptsize.distributed.mesh import PartitionedMesh
from adaptsize.distributed.parts import cut_part
from adaptsize.ranks import split_rows
from adaptsize.typing import BoolArray, IntArray

# Bits per axis of keys along a Morton curve, and keys that each rank contributes to the division.
_BITS = 20
_SAMPLES = 1000


def migrate(part: PartitionedMesh, rank_of_cells: IntArray) -> PartitionedMesh:
    """Return the same mesh with each cell on another rank; collective.

    Tags and fields move with the cells.  Nodes in no cell are left out, and nodes get new numbers.
    """
    pieces: list[Piece | None] = [None] * part.ranks.size
    if part.mesh is not None:
        nobody = np.full(part.n_points, -1, np.int32)
        for rank in np.unique(rank_of_cells).tolist():
            cut = cut_part(part.mesh, rank_of_cells, nobody, rank)
            if cut.mesh is not None:
                pieces[rank] = Piece(cut.mesh, part.global_ids[cut.global_ids])
    received = part.ranks.alltoall(pieces)
    return from_pieces(part.ranks, [piece for piece in received if piece is not None])


def interface_facets(part: PartitionedMesh) -> IntArray:
    """Return the facets that this rank shares with others, as local nodes; collective."""
    facets, is_between = _free_facets(part)
    between: IntArray = facets[is_between]
    return between


def boundary_facets(part: PartitionedMesh) -> IntArray:
    """Return the facets on the boundary of the whole mesh, as local nodes; collective."""
    facets, is_between = _free_facets(part)
    boundary: IntArray = facets[~is_between]
    return boundary


def _free_facets(part: PartitionedMesh) -> tuple[IntArray, BoolArray]:
    """Return the facets with one cell on this rank, and whether other ranks have them too.

    Two exchanges: each candidate goes to a rank that follows from its lowest node, which counts
    the ranks that have it.
    """
    comm = part.ranks
    free = np.empty((0, part.cell_dim), np.int32)
    is_shared = np.zeros(part.n_points, np.bool_)
    is_shared[part.shared.every] = True
    if part.mesh is not None:
        free = part.mesh.facets[part.mesh.facet_cell_counts == 1]
    candidates = is_shared[free].all(axis=1)
    keys = np.sort(part.global_ids[free[candidates]], axis=1)
    at = keys[:, 0] % comm.size
    order = np.argsort(at, kind="stable")
    asked = comm.alltoallv(split_rows(keys, at, comm.size))
    rows = np.concatenate(asked)
    by = np.repeat(np.arange(comm.size), [len(part) for part in asked])
    count = np.zeros(0, np.int64)
    if len(rows):
        _, group, times = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
        count = times[group.ravel()]
    found = np.empty(len(keys), np.int64)
    found[order] = np.concatenate(comm.alltoallv(split_rows(count, by, comm.size)))
    is_between = np.zeros(len(free), np.bool_)
    is_between[candidates] = found > 1
    return free, is_between


def displaced(part: PartitionedMesh, layers: int) -> IntArray:
    """Return a rank for each cell such that present interfaces lie inside parts; collective.

    Parts with fewer cells grow by some layers of cells into those with more; of equal ones, that of
    the lower rank.  One exchange for each layer.
    """
    comm = part.ranks
    counts = np.array(comm.allgather(part.n_cells))
    by_priority = np.lexsort((-np.arange(comm.size), -counts))  # the last one grows most
    priority = np.empty(comm.size)
    priority[by_priority] = np.arange(comm.size)
    of_cells = np.full(part.n_cells, priority[comm.rank])
    for _ in range(layers):
        of_nodes = np.full(part.n_points, -1.0)
        if part.n_cells:
            np.maximum.at(of_nodes, part.cells, of_cells[:, None])
        of_nodes = part.maximum(of_nodes)
        if part.n_cells:
            of_cells = of_nodes[part.cells].max(axis=1)
    return by_priority[of_cells.astype(np.int64)].astype(np.int32)


def balanced(part: PartitionedMesh) -> IntArray:
    """Return a rank for each cell such that all have about the same number; collective.

    Cells along a Morton curve are divided into pieces of equal length, to about 1 % of a share.
    """
    comm = part.ranks
    centroids = part.points[part.cells].mean(axis=1)
    low, high = centroids.min(axis=0, initial=np.inf), -centroids.max(axis=0, initial=-np.inf)
    ends = comm.allreduce(np.concatenate([low, high]), "min")
    width = float((-ends[part.dim :] - ends[: part.dim]).max())
    scale = (2**_BITS - 1) / width if width > 0.0 else 0.0
    steps = ((centroids - ends[: part.dim]) * scale).astype(np.int64)
    keys = np.zeros(len(steps), np.int64)
    for bit in range(_BITS):
        for axis in range(part.dim):
            keys |= ((steps[:, axis] >> bit) & 1) << (bit * part.dim + axis)
    count = min(_SAMPLES, len(keys))
    at = (np.arange(count) + 0.5) * len(keys) / max(count, 1)
    own = np.sort(keys)[at.astype(np.int64)]
    every = comm.allgather((own, np.full(count, len(keys) / max(count, 1))))
    samples = np.concatenate([keys for keys, _ in every])
    weights = np.concatenate([weights for _, weights in every])
    order = np.argsort(samples, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    cuts = np.searchsorted(share, np.arange(1, comm.size) / comm.size)
    ranks: IntArray = np.searchsorted(samples[order[cuts]], keys, side="left").astype(np.int32)
    return ranks
