"""Sources of sizes whose paths start at another node, or run along edges of the mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.ranks import Communicator
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Share by which sizes along edges may exceed the size at a node that they explain.
_TIE = 1e-10


class Paths(NamedTuple):
    """Nodes, their limited sizes, and how these reach them."""

    points: FloatArray
    """float64[n, dim]"""
    ids: npt.NDArray[np.integer]
    """int[n]: numbers of the nodes; the smallest counts where several allow the same."""
    edges: IntArray
    """int32[m, 2]"""
    h: FloatArray
    """float64[n]"""
    g: float
    start: IntArray
    """int32[n]: the node where the known part of the path starts; -1 if the source is known, or if
    the path runs along edges."""


#: Returns the least or the largest of the values that all ranks have for each node.
Merge = Callable[[FloatArray, Literal["min", "max"]], FloatArray]


def complete(
    paths: Paths, rows: FloatArray, known: BoolArray, ranks: Communicator, merge: Merge
) -> None:
    """Fill the rows of nodes whose sources are not known (In/Out: rows, known).

    A node takes the source of the node where its path starts, else that of the neighbour that
    allows the smallest size.  This is repeated, beginning with the nodes of known sources.

    Parameters
    ----------
    paths : Paths
    rows : float64[n, k + dim]
        Source and last bend of the path to each node; the latter is inf if the path is straight.
        The first column holds the id of a node that is its own source.
    known : bool[n]
    ranks : Communicator
    merge : callable
    """
    if not ranks.allreduce(int(not known.all()), "max"):
        return
    pairs, sizes = _candidates(paths, known)
    keeps_bend = (paths.start >= 0) & np.isfinite(rows[:, -1])
    dim = paths.points.shape[1]
    while True:
        usable = np.flatnonzero(~known[pairs[:, 0]] & known[pairs[:, 1]])
        usable = usable[np.unique(pairs[usable, 0], return_index=True)[1]]
        reached = np.zeros(len(known), np.bool_)
        # The smallest size counts, then the smallest id, then the first rank.
        for key in (sizes, paths.ids[pairs[:, 1]], np.full(len(pairs), ranks.rank)):
            own = np.full(len(known), np.inf)
            own[pairs[usable, 0]] = key[usable]
            least = merge(own, "min")
            reached = np.isfinite(least)
            usable = usable[key[usable] == least[pairs[usable, 0]]]
        nodes, by = pairs[usable].T
        found = np.full(rows.shape, -np.inf)
        found[nodes] = rows[by]
        bends = rows[by, 0] != paths.ids[by]  # else the path from the source is straight
        found[nodes[bends], -dim:] = paths.points[by[bends]]
        kept = nodes[keeps_bend[nodes]]
        found[kept, -dim:] = rows[kept, -dim:]
        rows[reached] = merge(found, "max")[reached]
        known |= reached
        if not ranks.allreduce(int(reached.any()), "max"):
            return


def _candidates(paths: Paths, known: BoolArray) -> tuple[IntArray, FloatArray]:
    """Return pairs of a node and one that its path may come from, and the size this allows.

    They are ordered by the first node, then by the size, then by the id of the second.
    """
    h, start = paths.h, paths.start
    pairs = np.concatenate([paths.edges, paths.edges[:, ::-1]])
    pairs = pairs[~known[pairs[:, 0]] & (start[pairs[:, 0]] < 0)]
    length = np.linalg.norm(paths.points[pairs[:, 0]] - paths.points[pairs[:, 1]], axis=1)
    sizes = h[pairs[:, 1]] + paths.g * length
    tight = sizes <= h[pairs[:, 0]] * (1.0 + _TIE)
    started = np.flatnonzero(~known & (start >= 0)).astype(np.int32)
    pairs = np.concatenate([pairs[tight], np.column_stack([started, start[started]])])
    sizes = np.append(sizes[tight], h[started])
    order = np.lexsort((paths.ids[pairs[:, 1]], sizes, pairs[:, 0]))
    return pairs[order], sizes[order]
