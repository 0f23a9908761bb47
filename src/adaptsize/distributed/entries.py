"""The one exchange of the exact method: each rank gets the sources that may act on its nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.distributed.communicator import Communicator
from adaptsize.limiting.exact.waves import Wave, sorted_wave
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Pieces into which the nodes of a rank are divided.  Their boxes are smaller than one for all.
_PIECES = 16

# Lower bounds are lowered by this share, so that rounding discards no source.
_SLACK = 1.0 - 1e-13


class Extent(NamedTuple):
    """Boxes around entries, and their smallest sizes."""

    low: FloatArray
    """float64[m, dim]"""
    high: FloatArray
    least: FloatArray
    """float64[m]"""

    def of(self, some: IntArray) -> Extent:
        """Return those of some entries."""
        return Extent(self.low[some], self.high[some], self.least[some])

    def may_lower(
        self, lower: FloatArray, upper: FloatArray, largest: float, g: float
    ) -> BoolArray:
        """Return which entries may allow less than a size in a box."""
        square = np.zeros(len(self.least))
        for d in range(len(lower)):
            gap = np.maximum(np.maximum(lower[d] - self.high[:, d], self.low[:, d] - upper[d]), 0.0)
            square += gap * gap
        return np.asarray(_SLACK * (self.least + g * np.sqrt(square)) < largest)


class Reach(NamedTuple):
    """Boxes around the nodes of a rank, and the largest size in each."""

    lower: FloatArray
    """float64[k, dim]"""
    upper: FloatArray
    largest: FloatArray
    """float64[k]"""

    def may_change(self, extent: Extent, g: float) -> IntArray:
        """Return the entries that may allow less than the largest size in any of the boxes."""
        if len(self.largest) == 0:
            return np.empty(0, np.int32)
        whole = (self.lower.min(axis=0), self.upper.max(axis=0), self.largest.max())
        rest = np.flatnonzero(extent.may_lower(*whole, g)).astype(np.int32)
        found = [rest[:0]]
        for box in zip(*self, strict=True):
            chosen = extent.of(rest).may_lower(*box, g)
            found.append(rest[chosen])
            rest = rest[~chosen]
        return np.sort(np.concatenate(found))


def reach_of(points: FloatArray, order: IntArray, h: FloatArray) -> Reach:
    """Return the boxes around nodes, given their order along a Morton curve."""
    n, dim = len(order), points.shape[1]
    if n == 0:
        return Reach(np.empty((0, dim)), np.empty((0, dim)), np.empty(0))
    first = np.unique(np.linspace(0, n, _PIECES, endpoint=False).astype(np.int64))
    places = points[order]
    return Reach(
        np.minimum.reduceat(places, first),
        np.maximum.reduceat(places, first),
        np.maximum.reduceat(h[order], first),
    )


def joined(first: Reach, second: Reach) -> Reach:
    """Return the boxes of both."""
    return Reach(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def at_nodes_only(wave: Wave, n_points: int) -> Wave:
    """Return the entries without sources between the nodes, which all ranks know."""
    is_node = wave.nodes[:, 0] < n_points
    return wave if is_node.all() else wave.only(is_node)


def exchange_rows(
    comm: Communicator, wave: Wave, rows: FloatArray, own: Reach, g: float
) -> FloatArray:
    """Return the rows of other ranks whose entries may act on this one; one exchange.

    ``rows``: float64[m, k], what is sent of each entry.
    """
    reaches: list[Reach] = comm.allgather(own)
    places = wave.places
    extent = Extent(places.min(axis=1), places.max(axis=1), wave.sizes.min(axis=1))
    sent = []
    for rank, reach in enumerate(reaches):
        chosen = reach.may_change(extent, g) if rank != comm.rank else slice(0)
        sent.append(rows[chosen])
    received: FloatArray = np.concatenate(comm.alltoallv(sent))
    return received


def exchange_entries(comm: Communicator, wave: Wave, own: Reach, g: float) -> Wave:
    """Return the entries of other ranks that may act on this one; one exchange."""
    table = exchange_rows(comm, wave, wave.table, own, g)
    return sorted_wave(table, np.full((len(table), wave.nodes.shape[1]), -1, np.int32))
