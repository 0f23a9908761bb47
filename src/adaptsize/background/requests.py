"""Values that other ranks compute at points: requests and answers between meshes in parts."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background._curve import along_curve
from adaptsize.background.partitioned import AnyMesh, PartitionedMesh
from adaptsize.ranks import Communicator
from adaptsize.typing import FloatArray, IntArray, LongArray

# Points that are compared at once with the boxes of the ranks near all of them.
_CHUNK = 1024
# Pieces of a part that have their own boxes.
_PIECES = 32


def boxes_of(part: PartitionedMesh) -> FloatArray:
    """Return the corners of the boxes of all parts, float64[size, 2, dim]; inf without cells."""
    return boxes_around(part.points[np.unique(part.cells)], part.ranks)


def boxes_around(points: FloatArray, ranks: Communicator) -> FloatArray:
    """Return the corners of the boxes around the points of all ranks; inf without points."""
    box = np.full((2, points.shape[1]), np.inf)
    if len(points):
        box = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.array(ranks.allgather(box))


def boxes_of_pieces(part: PartitionedMesh) -> FloatArray:
    """Return the corners of boxes around pieces of all parts, float64[size, pieces, 2, dim].

    The pieces are runs of cells along a curve.  Their boxes leave out most of what is in the box
    of a part but not in the part.  They are inf without cells.
    """
    boxes = np.full((_PIECES, 2, part.dim), np.inf)
    if part.n_cells:
        corners = part.points[part.cells]
        corners = corners[along_curve(corners.mean(axis=1))]
        starts = np.arange(_PIECES) * part.n_cells // _PIECES
        boxes[:, 0] = np.minimum.reduceat(corners.min(axis=1), starts)
        boxes[:, 1] = np.maximum.reduceat(corners.max(axis=1), starts)
    return np.array(part.ranks.allgather(boxes))


def ranks_that_meet(
    low: FloatArray, high: FloatArray, pieces: FloatArray
) -> tuple[LongArray, LongArray]:
    """Return all pairs of a box and a rank with a piece that meets it, in their order.

    Parameters
    ----------
    low, high : float64[n, dim]
    pieces : float64[ranks, pieces, 2, dim]
        Those of `boxes_of_pieces`.
    """
    # Nearer than the smallest number is at distance 0.
    reach = np.full(len(low), np.nextafter(0.0, 1.0))
    which, piece = ranks_within(low, high, pieces.reshape(-1, 2, low.shape[1]), reach)
    rank = piece // pieces.shape[1]
    first = np.ones(len(which), np.bool_)
    first[1:] = (which[1:] != which[:-1]) | (rank[1:] != rank[:-1])
    return which[first], rank[first]


def ask_nearest(
    old: AnyMesh,
    boxes: FloatArray,
    points: FloatArray,
    answer: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return what the part nearest to each point answers; collective.

    The first column of an answer is the distance.  First the part with the nearest box is asked,
    then all those whose boxes are nearer than the distance that it found.
    """
    comm = old.ranks

    def reply(asked: FloatArray, _: npt.NDArray[Any]) -> FloatArray:
        replies = comm.agree(lambda: answer(asked) if len(asked) else None)
        width = comm.allreduce(1 if replies is None else replies.shape[1], "max")
        return np.empty((0, width)) if replies is None else replies

    first = _nearest_boxes(points, boxes, comm.rank)
    best = comm.ask(points, first, reply)
    which, rank = ranks_within(points, points, boxes, best[:, 0])
    others = rank != first[which]
    which, rank = which[others], rank[others]
    more = comm.ask(points[which], rank, reply)
    order = np.lexsort((rank, more[:, 0], which))[::-1]  # the nearest one, of the lowest rank, last
    which, more = which[order], more[order]
    closer = more[:, 0] < best[which, 0]
    best[which[closer]] = more[closer]
    return best


def _nearest_boxes(points: FloatArray, boxes: FloatArray, own: int) -> LongArray:
    """Return the rank of the nearest box to each point, this rank if none is nearer."""
    first = np.empty(len(points), np.int64)
    for rows in _chunks(points):
        low, high = points[rows].min(axis=0), points[rows].max(axis=0)
        gap = _distances(low, high, boxes)
        # The box nearest to those of all points is at most so far from each of them.
        near = np.flatnonzero(gap <= gap.min() + np.linalg.norm(high - low))
        away = _distances(points[rows, None], points[rows, None], boxes[near])
        here = (away[:, near == own] <= away.min(axis=1, keepdims=True)).any(axis=1)
        first[rows] = np.where(here, own, near[away.argmin(axis=1)])
    return first


def ranks_within(
    low: FloatArray, high: FloatArray, boxes: FloatArray, reach: FloatArray
) -> tuple[LongArray, LongArray]:
    """Return all pairs of a box and a rank whose box is nearer than a distance, in their order.

    Boxes are compared in chunks along a curve, with the ranks near a chunk, so that neither time
    nor memory is proportional to the number of boxes times that of ranks.

    Parameters
    ----------
    low, high : float64[n, dim]
    boxes : float64[ranks, 2, dim]
    reach : float64[n]
    """
    pairs = [np.empty((0, 2), np.int64)]
    for rows in _chunks(low):
        gap = _distances(low[rows].min(axis=0), high[rows].max(axis=0), boxes)
        near = np.flatnonzero(gap < reach[rows].max())
        away = _distances(low[rows, None], high[rows, None], boxes[near])
        which, place = np.nonzero(away < reach[rows, None])
        pairs.append(np.column_stack([rows[which], near[place]]))
    which, rank = np.concatenate(pairs).T
    order = np.lexsort((rank, which))
    return which[order], rank[order]


def _chunks(points: FloatArray) -> Iterator[IntArray]:
    order = along_curve(points)
    for begin in range(0, len(order), _CHUNK):
        yield order[begin : begin + _CHUNK]


def _distances(low: FloatArray, high: FloatArray, boxes: FloatArray) -> FloatArray:
    """Return the distances between boxes; inf from those without cells."""
    gaps = np.maximum(0.0, np.maximum(boxes[:, 0] - high, low - boxes[:, 1]))
    return np.asarray(np.linalg.norm(gaps, axis=-1))
