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


class Reach(NamedTuple):
    """Boxes around the nodes of a rank, and the largest size in each."""

    lower: FloatArray
    """float64[k, dim]"""
    upper: FloatArray
    largest: FloatArray
    """float64[k]"""

    def may_change(self, wave: Wave, g: float) -> BoolArray:
        """Return which entries may allow less than the largest size in any of the boxes."""
        low, high = wave.places.min(axis=1), wave.places.max(axis=1)
        least = wave.sizes.min(axis=1)
        found = np.zeros(len(least), np.bool_)
        for lower, upper, largest in zip(*self, strict=True):
            rest = np.flatnonzero(~found)
            gap = np.maximum(np.maximum(lower - high[rest], low[rest] - upper), 0.0)
            away = np.sqrt(np.einsum("ij,ij->i", gap, gap))
            found[rest] = _SLACK * (least[rest] + g * away) < largest
        return found


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


def exchange_rows(
    comm: Communicator, wave: Wave, rows: FloatArray, own: Reach, g: float
) -> FloatArray:
    """Return the rows of other ranks whose entries may act on this one; one exchange.

    ``rows``: float64[m, k], what is sent of each entry.
    """
    reaches: list[Reach] = comm.allgather(own)
    sent = []
    for rank, reach in enumerate(reaches):
        chosen = reach.may_change(wave, g) if rank != comm.rank else np.zeros(0, np.int64)
        sent.append(rows[chosen])
    received: FloatArray = np.concatenate(comm.alltoallv(sent))
    return received


def exchange_entries(comm: Communicator, wave: Wave, own: Reach, g: float) -> Wave:
    """Return the entries of other ranks that may act on this one; one exchange."""
    table = exchange_rows(comm, wave, wave.table, own, g)
    return sorted_wave(table, np.full((len(table), wave.nodes.shape[1]), -1, np.int32))
