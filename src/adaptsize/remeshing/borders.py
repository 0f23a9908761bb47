"""Lines between groups of facets: nodes of a new mesh that are on these move along them only.

The distance of surfaces does not see a line that moves along the surface.
"""

from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import regions_beside
from adaptsize.remeshing.boundary_repair import corners_of
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.typing import BoolArray, FloatArray, IntArray


def borders_of(surface: SimplexMesh) -> IntArray:
    """Return the edges between facets of different groups, and those with a tag.

    Of edges in the plane, the nodes between two groups.
    """
    found = surface.facets[:0]
    if surface.cell_tags is not None:
        lowest, highest = regions_beside(
            surface.cell_facets, surface.cell_tags, len(surface.facets)
        )
        found = surface.facets[lowest != highest]
    if surface.tagged_facets is not None and surface.cell_dim == 2:
        found = np.concatenate([found, surface.tagged_facets])
    return np.unique(np.sort(found, axis=1), axis=0)


class OnBorders(NamedTuple):
    """Nodes and edges of a new surface that are on its borders.

    Parameters
    ----------
    is_on, stays : bool[n_points]
        Nodes of borders, and those at which these end, meet or turn.
    keys : int64[n]
        Of the edges, in ascending order.
    """

    is_on: BoolArray
    stays: BoolArray
    keys: IntArray

    @classmethod
    def of(cls, surface: SimplexMesh) -> "OnBorders":
        """Return those of a surface."""
        borders, n = borders_of(surface), surface.n_points
        is_on = np.zeros(n, np.bool_)
        is_on[borders] = True
        if borders.shape[1] == 1 or not len(borders):
            return cls(is_on, is_on, np.empty(0, np.int64))
        tags = np.full(len(borders), NO_TAG)
        return cls(is_on, corners_of(surface.points, borders, tags), _keys(borders, n))

    def have(self, edges: IntArray) -> BoolArray:
        """Return which edges, given by sorted nodes, are on borders."""
        return np.isin(_keys(edges, len(self.is_on)), self.keys)


def _keys(edges: IntArray, n: int) -> IntArray:
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    return np.asarray(low * n + high)


class Borders:
    """The borders of a given surface.

    Parameters
    ----------
    old : SimplexMesh
        Its facets.
    """

    def __init__(self, old: SimplexMesh) -> None:
        lines = borders_of(old)
        is_line = len(lines) > 0 and lines.shape[1] == 2
        self._curves = SimplexMesh(old.points, lines) if is_line else None

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the closest points on the borders, and their distances; inf if there are none."""
        if self._curves is None:
            return points, np.full(len(points), np.inf)
        edges, weights, distance = self._curves.locator.nearest(points)
        corners = self._curves.points[self._curves.cells[edges]]
        return np.einsum("ij,ijk->ik", weights, corners), distance

    @property
    def are_any(self) -> bool:
        """Whether there are borders."""
        return self._curves is not None

    def nodes_off(self, surface: SimplexMesh, limit: float) -> tuple[IntArray, FloatArray]:
        """Return the nodes on borders that are farther away than a limit, and their places."""
        nodes = np.unique(borders_of(surface))
        there, distance = self.nearest(surface.points[nodes])
        off = (distance > limit) & np.isfinite(distance)
        return nodes[off], there[off]

    def edges_off(self, surface: SimplexMesh, limit: float) -> tuple[IntArray, FloatArray]:
        """Return the edges on borders that are too far away between near ends, and their places."""
        edges = borders_of(surface)
        if edges.shape[1] != 2 or self._curves is None or not len(edges):
            return np.empty((0, 2), np.int32), np.empty((0, surface.dim))
        one, other = surface.points[edges[:, 0]], surface.points[edges[:, 1]]
        away = [self.nearest((1.0 - t) * one + t * other)[1] for t in np.linspace(0.0, 1.0, 5)]
        far = (np.maximum(away[0], away[-1]) <= limit) & (np.max(away, axis=0) > limit)
        return edges[far], self.nearest(0.5 * (one + other)[far])[0]

    def kept_on(
        self, surface: SimplexMesh, nodes: IntArray, edges: IntArray, there: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return places at which nodes stay on borders, and which may be served.

        Parameters
        ----------
        surface : SimplexMesh
            The facets of the new mesh.
        nodes : int32[n]
            The node to move to each place; or -1.
        edges : int32[n, 2]
            The edge to divide instead.
        there : float64[n, dim]
        """
        on = OnBorders.of(surface)
        if not on.is_on.any():
            return there, np.ones(len(there), np.bool_)
        moved = nodes >= 0
        is_bound = np.where(moved, on.is_on[nodes], on.have(edges))
        places, distance = self.nearest(there[is_bound])
        may = ~(moved & on.stays[nodes])
        may[is_bound] &= np.isfinite(distance)
        new = there.copy()
        new[is_bound] = places
        return new, may
