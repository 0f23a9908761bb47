"""Marching on distributed meshes, over cells or along edges: rounds within a window of sizes.

Each rank marches over its own cells.  The updates are those of the serial method, and sizes only
decrease; whatever the order, they end at the same largest solution of the discrete equations.
In each round, nodes up to the least waiting size of all ranks plus the width of a window are
accepted, and sizes that have decreased at shared nodes are exchanged.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptsize._kernels import fast_marching as kernels
from adaptsize._kernels.heap import Heap, new_heap
from adaptsize.background.marching import (
    CHUNK,
    KEEP,
    patience,
    stars_in,
    sweep_into_heap,
)
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.limiting.fast_marching import largest_excess
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.in_parts.info import Solved
from adaptsize.typing import FloatArray, ProgressCallback

# Width of a window in edges: nodes accepted too early are accepted again, and narrow windows mean
# many rounds.  Measured on 40 000 nodes and 4 to 16 parts: 3 to 37 per cent more work.
_WIDTH = 8.0


class Marched(NamedTuple):
    """The result of marching."""

    h: FloatArray
    accepted: int
    """Number of nodes that this rank accepted."""


def solve_fast_marching(
    part: PartitionedMesh,
    h0: FloatArray,
    slope: Slope,
    report: ProgressCallback,
    *,
    residual: bool = False,
) -> Solved | None:
    """Return the limited sizes on the nodes of this rank; collective.

    Returns None, on all ranks, if dependencies between nodes are cyclic (see
    `adaptsize.limiting.FastMarching`).
    """
    marched = _in_rounds(part, h0, slope, _window(part, slope), report)
    if marched is None:
        return None
    excess = 0.0
    if residual and part.mesh is not None:
        excess = largest_excess(part.mesh, slope, marched.h, kernels.sweep_cells)
    return Solved(marched.h, marched.accepted, excess=excess)


def solve_along_edges(
    part: PartitionedMesh, h0: FloatArray, slope: Slope, report: ProgressCallback
) -> Marched:
    """Return the sizes that the edge-based scheme gives; collective.

    The result equals that of `adaptsize.limiting.EdgeBased` bit by bit: it is
    the minimum of the same sums over paths.  Rounds have no windows, since few nodes are lowered
    by other ranks.
    """
    marched = _in_rounds(part, h0, slope, None, report)
    assert marched is not None  # no dependencies are cyclic
    return marched


def _in_rounds(
    part: PartitionedMesh,
    h0: FloatArray,
    slope: Slope,
    window: float | None,
    report: ProgressCallback,
) -> Marched | None:
    """March and exchange sizes until no node waits on any rank; without a window along edges."""
    comm, n = part.ranks, part.n_points
    sweep, march = kernels.sweep_cells, kernels.march
    keep = KEEP
    if window is None:
        sweep, march, keep = kernels.sweep_edges, kernels.march_edges, 1.0
    h, heap = h0.copy(), new_heap(n)
    stars: tuple[Any, ...] = ()
    limit = (slope.values, slope.step)
    if part.mesh is not None:
        sweep_into_heap(part.mesh, sweep, h, limit, heap, keep)
        stars = stars_in(part.mesh, limit)
    known = h0.copy()  # the sizes at shared nodes that other ranks know
    accepted = 0
    while True:
        waiting = float(heap.key[0]) if heap.size[0] > 0 else np.inf
        impatient = window is not None and accepted > patience(n)
        least, go_on = comm.allreduce(np.array([waiting, 0.0 if impatient else 1.0]), "min")
        if least == np.inf:
            return Marched(h, accepted)
        if not go_on:
            return None
        until = np.inf if window is None else least + window
        count = CHUNK if part.mesh is not None else 0
        while count == CHUNK:
            count = march(stars, h, limit, heap, (keep, float(until), CHUNK))
            accepted += count
            report("limiting the gradient", min(accepted / n, 1.0))
        _exchange(part, h, known, heap)


def _exchange(part: PartitionedMesh, h: FloatArray, known: FloatArray, heap: Heap) -> None:
    """Send sizes that have decreased at shared nodes, and queue those received (In/Out: all)."""
    sent = []
    for nodes in part.shared.nodes:
        changed = np.flatnonzero(h[nodes] < known[nodes])
        sent.append(np.column_stack([changed, h[nodes[changed]]]).astype(np.float64))
    received = part.ranks.alltoallv(sent)
    candidate = np.full(part.n_points, np.inf)
    for nodes, rows in zip(part.shared.nodes, received, strict=True):
        at = nodes[rows[:, 0].astype(np.int64)]
        candidate[at] = np.minimum(candidate[at], rows[:, 1])
    kernels.queue_lowered(h, candidate, 1.0, heap)
    every = part.shared.every
    known[every] = h[every]


def _window(part: PartitionedMesh, slope: Slope) -> float:
    """Return by how much sizes grow over several edges at nodes between parts; collective."""
    grown, count = 0.0, 0
    every = part.shared.every
    if part.mesh is not None and len(every):
        between = np.zeros(part.n_points, np.bool_)
        between[every] = True
        near = np.flatnonzero(between[part.cells].any(axis=1))
        corners = part.mesh.points[part.cells[near]]
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        grown = float((lengths * slope.values[near * slope.step]).sum())
        count = len(near)
    total, number = part.ranks.allreduce(np.array([grown, count]), "sum").tolist()
    return float(_WIDTH * total / number) if total > 0.0 else float(np.inf)
