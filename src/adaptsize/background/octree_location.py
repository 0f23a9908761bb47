"""Point location and linear interpolation in an octree."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_points
from adaptsize._kernels.interpolate import interpolate
from adaptsize._kernels.octree import fill_places, fill_weights
from adaptsize.background._octree_growth import codes_of
from adaptsize.typing import FloatArray, IndexArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background.octree import Octree

_T = TypeVar("_T", bound=np.generic)


class OctreeLocator:
    """Point location in an octree; ``octree.locator`` is the cached locator of an octree.

    Interpolation is that of ``octree.mesh`` and hence continuous, but the mesh is not built.
    The leaf is found by bisection among the leaves along the Z curve, and the simplex in it
    by descending through its face.

    Parameters
    ----------
    octree : Octree

    Notes
    -----
    A query takes O(log n) time per point in any tree.

    Examples
    --------
    >>> from adaptsize import Octree, refine_at_boundary
    >>> tree = Octree.build([0, 0], [1, 1], refine_at_boundary(lambda x: x[:, 0]), max_level=2)
    >>> tree.locator.leaf([[0.1, 0.1], [0.9, 0.1]])
    array([0, 8], dtype=int32)
    >>> values, distances = tree.locator.interpolate(tree.points[:, 1], [[0.3, 0.2], [2, 0.5]])
    >>> values, distances
    (array([0.2, 0.5]), array([0., 1.]))
    """

    def __init__(self, octree: Octree) -> None:
        self._octree = octree

    def leaf(self, points: npt.ArrayLike) -> IntArray:
        """Return the leaf that contains each point; outside, that of the closest point of the box.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
            Query points; n may be 0.

        Returns
        -------
        ndarray of int32, shape (n,)
            Points on a face that two leaves share belong to the upper leaf.

        Raises
        ------
        ValueError
            If ``points`` has another shape or a coordinate is not finite.
        """
        order, _, leaves, _ = self._find(points)
        return _put_back(order, leaves)

    def weights(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the nodes of the simplex that contains each point, and their weights.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
            Query points; n may be 0.

        Returns
        -------
        nodes : ndarray of int32, shape (n, dim + 1)
            Nodes of a cell of ``octree.mesh``; arbitrary nodes where the weight is 0.
        weights : ndarray of float64, shape (n, dim + 1)
            Barycentric coordinates of the closest point of the box, >= 0; their sum is 1 to
            rounding.  At a node of the octree, the weight of that node is exactly 1.
        distances : ndarray of float64, shape (n,)
            Distance of each point to the box, 0 inside.

        Raises
        ------
        ValueError
            If ``points`` has another shape or a coordinate is not finite.
        """
        order, nodes, weights, distances = self._weigh(points)
        return _put_back(order, nodes), _put_back(order, weights), distances

    def interpolate(
        self, values: npt.ArrayLike, points: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return nodal values, linearly interpolated, at the closest point of each point.

        Parameters
        ----------
        values : array_like of float, shape (n_points,)
            Nodal values, finite or +inf.
        points : array_like of float, shape (n, dim)
            Query points; n may be 0.

        Returns
        -------
        values : ndarray of float64, shape (n,)
            inf if a node of positive weight is inf; otherwise between the values of the nodes
            of positive weight.
        distances : ndarray of float64, shape (n,)
            Distance of each point to the box, 0 inside.

        Raises
        ------
        ValueError
            If a shape is wrong or a coordinate is not finite.
        """
        nodal = as_float_array("values", values, self._octree.nodal_shape)
        order, nodes, weights, distances = self._weigh(points)
        result = np.empty(len(nodes))
        interpolate(nodes, nodal, np.arange(len(nodes), dtype=np.int32), weights, result)
        return _put_back(order, result), distances

    def _find(self, points: npt.ArrayLike) -> tuple[IndexArray, FloatArray, IntArray, FloatArray]:
        """Return points as lattice coordinates, their leaves, and their distances.

        Coordinates and leaves are in the order along the Z curve that is returned first, so
        that points close in space are close in memory.  The distances are in the given order.
        """
        tree, lattice = self._octree, self._octree._lattice
        # A writable copy, since kernels are compiled for one kind of array only.
        queries = as_points("points", points, tree.dim).copy()
        places = np.empty_like(queries)
        distances = np.empty(len(queries))
        fill_places(queries, (tree.lower, tree.upper, lattice.counts), places, distances)
        indices = np.minimum(places.astype(np.int64), lattice.counts - 1)
        codes = codes_of(indices, lattice.depth, tree.root_shape)
        order = np.argsort(codes)
        leaves = np.searchsorted(lattice.starts, codes[order], side="right") - 1
        return order, places[order], leaves.astype(np.int32), distances

    def _weigh(self, points: npt.ArrayLike) -> tuple[IndexArray, IntArray, FloatArray, FloatArray]:
        """Return the result of `weights`, with nodes and weights in the order returned first."""
        order, places, leaves, distances = self._find(points)
        nodes = np.empty((len(leaves), self._octree.dim + 1), np.int32)
        weights = np.empty(nodes.shape)
        fill_weights(places, leaves, self._octree._nodes, nodes, weights)
        return order, nodes, weights, distances


def _put_back(order: IndexArray, values: npt.NDArray[_T]) -> npt.NDArray[_T]:
    """Return rows in their order before sorting."""
    result = np.empty_like(values)
    result[order] = values
    return result
