"""Point location in a mesh or octree: the cell that contains a point, or the closest one."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_points
from adaptsize._kernels.interpolate import interpolate
from adaptsize._kernels.location import Located, list_within, locate, locate_in_ranges
from adaptsize._kernels.trees import new_stack
from adaptsize._workers import in_all_threads
from adaptsize.background._curve import along_curve, tree_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.typing import FloatArray, IntArray, LongArray

if TYPE_CHECKING:
    from adaptsize.background.octree import Octree
    from adaptsize.background.simplex import SimplexMesh

# Squares of coordinates must stay in the range of float64.
_FARTHEST = 1e150
# Points per chunk of a thread: some milliseconds in the mesh.
_CHUNK = 2048


def parts_of(n: int, step: int = 256) -> Iterator[tuple[int, int]]:
    """Yield the ranges of consecutive parts of n items.

    A compiled loop cannot be interrupted.  The parts are such that what is done for one of them
    before the next is asked for takes about 0.3 s.
    """
    first = 0
    while first < n:
        last, begin = min(first + step, n), time.perf_counter()
        yield first, last
        step = 2 * step if time.perf_counter() - begin < 0.15 else max(step // 2, 1)
        first = last


class Locator(ABC):
    """Point location and interpolation in the simplices of a mesh or an octree."""

    _mesh: SimplexMesh

    @abstractmethod
    def nearest(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the closest cell, the weights of its nodes and the distance of each point."""

    def weights(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the nodes and weights of the cell that `nearest` finds, and the distance.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        nodes : ndarray of int32, shape (n, cell_dim + 1)
        weights : ndarray of float64, shape (n, cell_dim + 1)
        distances : ndarray of float64, shape (n,)
        """
        cells, weights, distances = self.nearest(points)
        return self._mesh.cells[cells], weights, distances

    def interpolate(
        self, values: npt.ArrayLike, points: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return nodal values, linearly interpolated, at the closest point of each point.

        Parameters
        ----------
        values : array_like of float, shape (n_points,)
            Nodal values, finite or +inf.
        points : array_like of float, shape (n, dim)

        Returns
        -------
        values : ndarray of float64, shape (n,)
            inf if a node of positive weight is inf; otherwise between the values of the nodes
            of positive weight.
        distances : ndarray of float64, shape (n,)
            Distance of each point to the mesh.
        """
        nodal = as_float_array("values", values, (self._mesh.n_points,))
        cells, weights, distances = self.nearest(points)
        result = np.empty(len(cells))
        # The kernel is compiled once, for read-only values, as those of size functions are.
        nodal = read_only(np.ascontiguousarray(nodal))
        interpolate(self._mesh.cells, nodal, cells, weights, result)
        return result, distances


class SimplexLocator(Locator):
    """Tree of bounding boxes over the cells of a mesh, for point location.

    It works for every kind of mesh: surfaces in space, polylines, several components,
    holes, cells of any orientation, overlapping or degenerate cells, repeated points.
    ``mesh.locator`` is the cached locator of a mesh.

    Parameters
    ----------
    mesh : SimplexMesh

    Notes
    -----
    Building the tree takes O(n log n) time.  The set of cells is halved repeatedly, along the
    longest side of the box of their centroids, until four cells are left.  A query for a point
    inside the mesh, or much nearer to it than the length of a cell, takes O(log n) time if the
    boxes of few cells overlap, as for shape-regular cells.  For a point at a distance d from a
    surface with cells of length a, O(d / a) more cells are visited; for a point at equal
    distance from all cells, such as the centre of a sphere, all cells are visited.

    Examples
    --------
    >>> from adaptsize import SimplexMesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> cells, weights, distances = square.locator.nearest([[0.5, 0.25], [1.5, 0.5]])
    >>> cells, distances
    (array([0, 0], dtype=int32), array([0. , 0.5]))
    >>> weights.tolist()
    [[0.5, 0.25, 0.25], [0.0, 0.5, 0.5]]
    """

    def __init__(self, mesh: SimplexMesh) -> None:
        self._mesh = mesh
        nodes = np.flatnonzero(mesh.in_a_cell)
        # Scaling by a power of two is exact; it keeps squares of lengths in range.
        largest = float(np.abs(mesh.points[nodes]).max())
        #: A power of two, which keeps squares of lengths in range: multiplication by it is exact.
        self.scale = math.ldexp(1.0, -math.frexp(largest)[1]) if largest > 0.0 else 1.0
        points = in_space(mesh.points[nodes] * self.scale)
        # Points and cells that are close in space are stored close in memory.
        whole = len(nodes) == mesh.n_points
        along = mesh._along_curve if whole else along_curve(points)
        #: The node of the mesh in each row of the points of the tree.
        self.node_of_point = nodes[along].astype(np.int32)
        number = np.zeros(mesh.n_points, np.int32)
        number[nodes[along]] = np.arange(len(nodes), dtype=np.int32)
        #: The tree, whose coordinates are multiplied by ``scale``.
        self.tree, order = tree_over(points[along], number[mesh.cells])
        #: The cell of the mesh in each row of the tree, int32[n_cells].
        self.cell_of_row = order.astype(np.int32)

    def nearest(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return for each point the cell that contains it, or else the closest cell.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
            Query points; n may be 0.

        Returns
        -------
        cells : ndarray of int32, shape (n,)
            Cell of each point.  If several cells contain a point or are equally close, one of
            them is returned, always the same for the same point.
        weights : ndarray of float64, shape (n, cell_dim + 1)
            Barycentric coordinates of the closest point in that cell, >= 0; their sum is 1 to
            rounding.  ``(weights[:, :, None] * mesh.points[mesh.cells[cells]]).sum(axis=1)``
            are the closest points.
        distances : ndarray of float64, shape (n,)
            Distance to the closest point.  It is 0 inside the mesh, on the faces of cells up
            to rounding.

        Raises
        ------
        ValueError
            If ``points`` has another shape or a coordinate is not finite.
        """
        queries = self._queries(points)
        n, mesh = len(queries), self._mesh
        found = Located(np.empty(n, np.int32), np.empty((n, mesh.cell_dim + 1)), np.empty(n))
        # Sorting queries along a space-filling curve pays once they outgrow the cache.
        order = along_curve(queries).astype(np.int64) if n >= 2000 else np.arange(n)
        full = mesh.cell_dim == mesh.dim >= 2

        def task(first: int, last: int) -> None:
            locate(self.tree, full, queries, order[first:last], new_stack(), found)

        in_all_threads(task, n, _CHUNK)
        return self.cell_of_row[found.cell], found.weights, found.distance / self.scale

    def within(self, points: npt.ArrayLike, reach: npt.ArrayLike) -> tuple[LongArray, IntArray]:
        """Return all cells that are at most a given distance away from each point.

        Unlike the cell that `nearest` chooses among several, they depend on nothing but the point
        and the cells themselves.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
        reach : float or array_like of float, shape (n,)
            Largest distance from each point, >= 0.

        Returns
        -------
        which : ndarray of int64, shape (k,)
            A point of each pair of a point and a cell, ascending.
        cells : ndarray of int32, shape (k,)
            Its cell; ascending for each point.

        Examples
        --------
        >>> from adaptsize import SimplexMesh
        >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> which, cells = square.locator.within([[0.5, 0.5], [0.75, 0.25]], 1e-9)
        >>> which.tolist(), cells.tolist()
        ([0, 0, 1], [0, 1, 0])
        """
        queries = self._queries(points)
        n, room = len(queries), 8 * len(queries)
        limit = np.minimum(np.broadcast_to(as_float_array("reach", reach), (n,)), _FARTHEST)
        limit = limit * self.scale
        while True:
            rows = np.empty((room, 2), np.int32)
            count = list_within(self.tree, queries, limit, new_stack().box, rows)
            if count <= room:
                break
            room = count
        which, cells = rows[:count, 0].astype(np.int64), self.cell_of_row[rows[:count, 1]]
        order = np.lexsort((cells, which))
        return which[order], cells[order]

    def _queries(self, points: npt.ArrayLike) -> FloatArray:
        """Return checked points, scaled and padded like those of the mesh."""
        queries = as_points("points", points, self._mesh.dim) * self.scale
        return in_space(np.clip(queries, -_FARTHEST, _FARTHEST))


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


def in_space(points: FloatArray) -> FloatArray:
    """Return points padded with zero coordinates, float64[n, 3]."""
    padded = np.zeros((len(points), 3))
    padded[:, : points.shape[1]] = points
    return padded
