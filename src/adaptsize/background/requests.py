"""Values that other ranks compute at points: requests and answers between meshes in parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.simplex import SimplexMesh
from adaptsize.ranks import split_rows
from adaptsize.typing import FloatArray


def boxes_of(part: PartitionedMesh) -> FloatArray:
    """Return the corners of the boxes of all parts, float64[size, 2, dim]; inf without cells."""
    box = np.full((2, part.dim), np.inf)
    if part.mesh is not None:
        used = part.points[np.unique(part.cells)]
        box = np.stack([used.min(axis=0), used.max(axis=0)])
    return np.array(part.ranks.allgather(box))


def ask_nearest(
    old: PartitionedMesh,
    boxes: FloatArray,
    points: FloatArray,
    answer: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return what the part nearest to each point answers; collective.

    The first column of an answer is the distance.  First the part with the nearest box is asked,
    then all those whose boxes are nearer than the distance that it found.
    """
    away = np.linalg.norm(
        np.maximum(0.0, np.maximum(boxes[:, 0] - points[:, None], points[:, None] - boxes[:, 1])),
        axis=2,
    )
    away[np.isnan(away)] = np.inf
    here = away[:, old.ranks.rank] <= away.min(axis=1, initial=np.inf)
    first = np.where(here, old.ranks.rank, away.argmin(axis=1))
    every = np.arange(len(points))
    best = ask_ranks(old, points, every, first, answer)
    nearer = away < best[:, :1]
    nearer[every, first] = False
    which, rank = np.nonzero(nearer)
    more = ask_ranks(old, points, which, rank, answer)
    order = np.lexsort((rank, more[:, 0], which))[::-1]  # the nearest one, of the lowest rank, last
    which, more = which[order], more[order]
    closer = more[:, 0] < best[which, 0]
    best[which[closer]] = more[closer]
    return best


def ask_ranks(
    old: PartitionedMesh,
    points: FloatArray,
    which: npt.NDArray[np.int64],
    rank: npt.NDArray[Any],
    answer: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the answers of given ranks for given points, one row for each; collective."""
    comm = old.ranks
    order = np.argsort(rank, kind="stable")
    asked = comm.alltoallv(split_rows(points[which], rank, comm.size))
    every = np.concatenate(asked)
    replies = comm.agree(lambda: answer(every) if len(every) else None)
    width = comm.allreduce(1 if replies is None else replies.shape[1], "max")
    rows = np.empty((0, width)) if replies is None else replies
    ends = np.cumsum([len(part) for part in asked])
    found = np.empty((len(which), width))
    found[order] = np.concatenate(comm.alltoallv(np.split(rows, ends[:-1])))
    return found


def values_at(
    mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray, *, of_one_node: bool = False
) -> FloatArray:
    """Return the distance of each point and the values there, float64[n, 1 + columns]."""
    assert mesh is not None
    nodes, weights, distance = mesh.locator.weights(points)
    if of_one_node:
        values = columns[nodes[np.arange(len(nodes)), weights.argmax(axis=1)]]
    else:
        values = np.einsum("iv,ivc->ic", weights, columns[nodes])
    return np.column_stack([distance, values])
