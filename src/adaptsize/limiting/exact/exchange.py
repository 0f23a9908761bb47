"""Which entries of the exact method act on other ranks, and their exchange."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsize._kernels import exact_plane as plane
from adaptsize._kernels.exact_reach import list_entries_in_reach
from adaptsize._kernels.trees import DEPTH
from adaptsize.limiting.exact.field import Entries
from adaptsize.ranks import Communicator
from adaptsize.typing import FloatArray, IntArray


def reach_of(points: FloatArray, order: IntArray, h: FloatArray) -> FloatArray:
    """Return the boxes around nodes, given their order along a Morton curve.

    Each row, float64[2 * dim + 1], holds the lower and the upper corner of a box, and the largest
    size in it.
    """
    n, dim = len(order), points.shape[1]
    if n == 0:
        return np.empty((0, 2 * dim + 1))
    # The boxes of 16 pieces are smaller than one for all.
    first = np.unique(np.linspace(0, n, 16, endpoint=False).astype(np.int64))
    places = points[order]
    lower, upper = np.minimum.reduceat(places, first), np.maximum.reduceat(places, first)
    return np.column_stack([lower, upper, np.maximum.reduceat(h[order], first)])


def entries_in_reach(entries: Entries, boxes: FloatArray, g: float) -> IntArray:
    """Return the entries that may allow less than the largest size in any of the boxes."""
    found = np.empty(len(entries.nodes), np.int32)
    count = list_entries_in_reach(
        entries.table,
        entries.boxes,
        (0,) * entries.nodes.shape[1],
        g,
        boxes,
        np.empty(len(boxes), np.int32),
        np.empty((DEPTH, 2), np.int32),
        found,
    )
    return found[:count]


def of_this_rank(entries: Entries, n_points: int) -> Entries:
    """Return the entries without those that all ranks have: corners, sources between the nodes."""
    kept = entries.nodes[:, 0] < n_points
    if entries.table.shape[1] > plane.CORNER:
        kept &= entries.table[:, plane.CORNER] == 0.0
    return entries if kept.all() else entries.only(kept)


def exchange_rows(
    comm: Communicator,
    groups: Sequence[Entries],
    rows: Sequence[FloatArray],
    own: FloatArray,
    g: float,
) -> FloatArray:
    """Return the rows of other ranks whose entries may act on this one; one exchange.

    ``rows`` holds what is sent of the entries of each group, float64[m, k]; ``own`` are the boxes
    of this rank.
    """
    sent = []
    for rank, boxes in enumerate(comm.allgather(own)):
        few = boxes if rank != comm.rank else boxes[:0]
        chosen = [entries_in_reach(entries, few, g) for entries in groups]
        pairs = zip(rows, chosen, strict=True)
        sent.append(np.concatenate([some[which] for some, which in pairs]))
    received: FloatArray = np.concatenate(comm.alltoallv(sent))
    return received
