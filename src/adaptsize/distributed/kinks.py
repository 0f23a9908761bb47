"""Edges and faces between parts, which may be sources only if all their cells allow it."""

from __future__ import annotations

import numpy as np

from adaptsize.distributed.pieces import Piece
from adaptsize.limiting.exact.problem import Kinks
from adaptsize.typing import FloatArray, IntArray


def merge_kinks(piece: Piece, rows: Kinks) -> Kinks:
    """Return the rows with those of other ranks at the same edges and faces; one exchange."""
    dim = rows.points.shape[1]
    widths = (2, 3) if dim == 3 else (2,)
    sent = []
    for nodes in piece.shared:
        held = np.zeros(len(rows.points), np.bool_)
        held[nodes] = True
        packed = [
            _packed(piece, rows, own[held[own[:, :width]].all(axis=1)], width)
            for own, width in zip(rows[:2], widths, strict=False)
        ]
        sent.append(np.concatenate(packed))
    found = np.concatenate(piece.ranks.alltoallv(sent))
    nodes = found[:, 2:].reshape(-1, 4, dim + 2)
    ids, at = np.unique(nodes[:, :, 0].astype(np.int64), return_index=True)
    own = np.searchsorted(piece.ids, ids)
    known = own < len(piece.ids)
    known[known] = piece.ids[own[known]] == ids[known]
    number = np.where(known, own, 0)
    number[~known] = len(rows.points) + np.arange(np.count_nonzero(~known))
    new = nodes.reshape(-1, dim + 2)[at[~known]]
    named = number[np.searchsorted(ids, nodes[:, :, 0].astype(np.int64))]
    more = [
        _unpacked(named[found[:, 0] == width], found[found[:, 0] == width, 1], width)
        for width in (2, 3)
    ]
    return Kinks(
        np.concatenate([rows.edges, more[0]]),
        np.concatenate([rows.faces, more[1]]),
        np.concatenate([rows.points, new[:, 1:-1]]),
        np.concatenate([rows.h0, new[:, -1]]),
    )


def _packed(piece: Piece, rows: Kinks, own: IntArray, width: int) -> FloatArray:
    """Return rows with the global numbers, places and bounds of their nodes."""
    if len(own) == 0:
        return np.empty((0, 2 + 4 * (rows.points.shape[1] + 2)))
    nodes = np.delete(own, width, axis=1)
    packed = np.concatenate(
        [piece.ids[nodes][:, :, None], rows.points[nodes], rows.h0[nodes][:, :, None]], axis=2
    )
    flags = np.column_stack([np.full(len(own), width), own[:, width]])
    return np.concatenate([flags, packed.reshape(len(own), -1)], axis=1)


def _unpacked(nodes: IntArray, allows: FloatArray, width: int) -> IntArray:
    """Return rows as they are listed."""
    return np.insert(nodes, width, allows.astype(np.int64), axis=1).astype(np.int32)
