"""Interpolation between the nodes of a Cartesian grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_points
from adaptsize._kernels.interpolate import GridFrame, GridNodes, interpolate_grid
from adaptsize.background._mesh_arrays import read_only
from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background.grid import CartesianGrid

# A compiled loop cannot be interrupted; one call of it over so many points takes 0.1 s or less.
_POINTS_PER_CALL = 500_000


class GridLocator:
    """Interpolation between the nodes of a Cartesian grid; ``grid.locator`` is cached.

    Parameters
    ----------
    grid : CartesianGrid

    Notes
    -----
    A query takes a few operations per point, independent of the number of nodes.  There is no
    search and no set-up.

    Examples
    --------
    >>> from adaptsize import CartesianGrid
    >>> grid = CartesianGrid([0.0, 0.0], 1.0, (2, 2))
    >>> values, distances = grid.locator.interpolate([[0, 1], [2, 3]], [[0.5, 0.25], [1.0, 3.0]])
    >>> values, distances
    (array([1.25, 3.  ]), array([0., 2.]))
    """

    def __init__(self, grid: CartesianGrid) -> None:
        self._grid = grid
        farthest = np.maximum(np.abs(grid.lower), np.abs(grid.upper)) / grid.spacing
        # Rounding of a coordinate and of its place along an axis, in units of its last place.
        snap = 4.0 * np.finfo(float).eps * farthest
        active = np.empty(0, np.bool_) if grid.active is None else grid.active.reshape(-1)
        self._nodes = GridNodes(*frame_of(grid), snap, read_only(active))

    def interpolate(
        self, values: npt.ArrayLike, points: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return nodal values, interpolated multilinearly, at the closest points of the box.

        Parameters
        ----------
        values : array_like of float, of the grid's shape
            Nodal values, finite or +inf.
        points : array_like of float, shape (n, dim)
            Query points; n may be 0.

        Returns
        -------
        values : ndarray of float64, shape (n,)
            inf if a corner of positive weight is inf, otherwise between the values of the
            corners of positive weight.  Inactive corners are omitted; the value is inf if no
            corner of positive weight is left.
        distances : ndarray of float64, shape (n,)
            Distance of each point from the box of the grid.

        Raises
        ------
        ValueError
            If a shape is wrong or a coordinate is not finite.
        """
        nodal = read_only(as_float_array("values", values, self._grid.shape).reshape(-1))
        where = read_only(as_points("points", points, self._grid.dim))
        n = len(where)
        result, distances = np.empty(n), np.empty(n)
        for first in range(0, n, _POINTS_PER_CALL):
            part = slice(first, first + _POINTS_PER_CALL)
            interpolate_grid(self._nodes, nodal, where[part], result[part], distances[part])
        return result, distances

    def weights(self, points: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the corners of the box that contains each point, or its closest grid point.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        nodes : ndarray of int32, shape (n, 2**dim)
            Indices of the nodes.
        weights : ndarray of float64, shape (n, 2**dim)
            Multilinear weights, 0 at inactive nodes.  Their sum is 1 to rounding, or 0 if no
            corner of positive weight is active.
        distances : ndarray of float64, shape (n,)
            Distance of each point from the box of the grid.
        """
        where = as_points("points", points, self._grid.dim)
        grid, snap = self._grid, self._nodes.snap
        end = np.array(grid.shape) - 1
        along = (where - grid.lower) / grid.spacing
        inside = np.clip(along, 0.0, end)
        distances = np.linalg.norm((along - inside) * grid.spacing, axis=1)
        lowest = np.minimum(inside.astype(np.int64), end - 1)
        share = inside - lowest
        share = np.where(share <= snap, 0.0, np.where(share >= 1.0 - snap, 1.0, share))
        corners = np.array(list(np.ndindex(*[2] * grid.dim)))
        index = lowest[:, None, :] + corners
        nodes = np.ravel_multi_index(tuple(np.moveaxis(index, -1, 0)), grid.shape)
        weights = np.where(corners == 1, share[:, None, :], 1.0 - share[:, None, :]).prod(axis=2)
        if grid.active is not None:
            weights *= self._nodes.active[nodes]
            total = weights.sum(axis=1, keepdims=True)
            weights = np.divide(weights, total, out=weights, where=total > 0.0)
        return nodes.astype(np.int32), weights, distances


def frame_of(grid: CartesianGrid) -> GridFrame:
    """Return a grid in which missing axes have one node."""
    missing = 3 - grid.dim
    return GridFrame(
        np.append(grid.origin, [0.0] * missing),
        np.append(grid.spacing, [1.0] * missing),
        np.array([*grid.shape, *[1] * missing], np.int64),
    )
