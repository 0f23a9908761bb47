"""Sources of sizes whose paths start at another node, or run along edges of the mesh."""

from __future__ import annotations

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.limiting.exact.candidates import TIE
from adaptsize.typing import BoolArray, FloatArray, IntArray


def complete(
    mesh: SimplexMesh,
    sizes: tuple[FloatArray, float],
    start: IntArray,
    found: tuple[IntArray, FloatArray],
    known: BoolArray,
) -> None:
    """Name the sources of nodes that are not known, and the last bends of their paths.

    A node takes the source of the node where its path starts, else that of the neighbour that
    allows the smallest size, of these the one of the smallest number.  This is repeated, beginning
    with the nodes of known sources.

    Parameters
    ----------
    mesh : SimplexMesh
    sizes : tuple of float64[n], float
        Limited sizes, and g.
    start : int32[n]
        The node where the known part of the path starts; -1 if the source is known, or if the path
        runs along edges.
    found : tuple of int32[n, dim], float64[n, dim]
        In/Out: the nodes of the source, first that of a node that is its own; the last bend, nan if
        the path is straight.
    known : bool[n]
        In/Out.
    """
    pairs, (nodes, bend) = _candidates(mesh, sizes, start, known), found
    keeps_bend = (start >= 0) & np.isfinite(bend[:, 0])
    while True:
        usable = np.flatnonzero(~known[pairs[:, 0]] & known[pairs[:, 1]])
        usable = usable[np.unique(pairs[usable, 0], return_index=True)[1]]
        if len(usable) == 0:
            return
        at, by = pairs[usable].T
        bends = nodes[by, 0] != by  # else the path from the source is straight
        last = np.where(bends[:, None], mesh.points[by], bend[by])
        bend[at] = np.where(keeps_bend[at, None], bend[at], last)
        nodes[at], known[at] = nodes[by], True


def _candidates(
    mesh: SimplexMesh, sizes: tuple[FloatArray, float], start: IntArray, known: BoolArray
) -> IntArray:
    """Return pairs of a node and one that its path may come from.

    They are ordered by the first node, then by the size that this allows, then by the second.
    """
    h, g = sizes
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    pairs = pairs[~known[pairs[:, 0]] & (start[pairs[:, 0]] < 0)]
    length = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
    along = h[pairs[:, 1]] + g * length
    tight = along <= h[pairs[:, 0]] * (1.0 + TIE)
    started = np.flatnonzero(~known & (start >= 0)).astype(np.int32)
    pairs = np.concatenate([pairs[tight], np.column_stack([started, start[started]])])
    along = np.append(along[tight], h[started])
    return pairs[np.lexsort((pairs[:, 1], along, pairs[:, 0]))]
