"""Point location in an octree: the leaf by its place along the Z curve, then its simplices."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_points
from adaptsize._kernels.location import Located, locate_in_ranges
from adaptsize.background.location import Locator, in_space, parts_of
from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background.octree import Octree


class OctreeLocator(Locator):
    """Point location in the simplices of the leaves of an octree.

    ``tree.locator`` is the cached locator of an octree.  It needs no other tree over the cells of
    ``tree.mesh``, which would take more memory and a longer time than the octree itself.

    Parameters
    ----------
    tree : Octree

    Examples
    --------
    >>> from adaptsize import Octree
    >>> tree = Octree([0, 0], [2, 1], (2, 1), [0, 0])
    >>> cells, weights, distances = tree.locator.nearest([[1.5, 0.5], [3.0, 0.0]])
    >>> cells.tolist(), distances.tolist()
    ([2, 2], [0.0, 1.0])
    """

    def __init__(self, tree: Octree) -> None:
        self._tree, self._mesh = tree, tree.mesh
        # Scaling by a power of two keeps squares of lengths in range; see `SimplexLocator`.
        largest = float(np.abs([tree.lower, tree.upper]).max())
        self._scale = math.ldexp(1.0, -math.frexp(largest)[1])
        self._points = in_space(tree.points * self._scale)

    def nearest(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return for each point the cell that contains it, or else the closest point of the box.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        cells : ndarray of int32, shape (n,)
            Rows of ``tree.mesh.cells``.
        weights : ndarray of float64, shape (n, dim + 1)
        distances : ndarray of float64, shape (n,)
            As those of `SimplexLocator.nearest`; exactly 0 in the box.
        """
        tree = self._tree
        where = as_points("points", points, tree.dim)
        inside = np.clip(where, tree.lower, tree.upper)
        leaves, n = tree.find_leaves(inside), len(where)
        found = Located(np.empty(n, np.int32), np.empty((n, tree.dim + 1)), np.empty(n))
        queries = in_space(inside * self._scale)
        order = np.argsort(leaves)  # neighbours follow each other, for the cache
        mesh = (self._points, self._mesh.cells)
        for first, last in parts_of(n):
            which = order[first:last]
            locate_in_ranges(mesh, tree.first_cells, leaves, queries, which, found)
        distances = np.linalg.norm((where - inside) * self._scale, axis=1) / self._scale
        return found.cell, found.weights, distances
