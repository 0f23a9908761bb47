"""Straight feature edges: nodes of a new mesh on these are put exactly on them.

Mmg takes the direction of a feature edge from the normals of the facets on both sides.  Beside a
curved facet it bends a straight edge, within the tolerance.
"""

import math
from dataclasses import replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import marked, regions_beside
from adaptsize.geometry.creases import normals_of, sharp_facets
from adaptsize.remeshing import tuning
from adaptsize.remeshing.surface import facets_of
from adaptsize.remeshing.taken_back import take_back, worst_of_nodes
from adaptsize.typing import BoolArray, FloatArray, IntArray


class StraightEdges:
    """The straight feature edges of a mesh or surface.

    Parameters
    ----------
    given : SimplexMesh
    """

    def __init__(self, given: SimplexMesh) -> None:
        old = facets_of(given)
        edges = feature_edges(old)
        self._curves = SimplexMesh(old.points, edges) if len(edges) else None
        self._is_straight = None if self._curves is None else _are_straight(self._curves)
        self._near = tuning.ON_LINE * given.diagonal

    def straightened(self, mesh: SimplexMesh, tolerance: float) -> SimplexMesh:
        """Return a mesh with the nodes of its straight feature edges exactly on these.

        Parameters
        ----------
        mesh : SimplexMesh
            Cells of full dimension, with positive measure, or triangles in space.
        tolerance : float
            Nodes are moved by at most twice this distance, and only if no cell becomes bad.
        """
        nodes, there, distance = self._nodes(mesh)
        moved = (distance > 0.0) & (distance <= 2.0 * tolerance)
        if not moved.any():
            return mesh
        nodes, points = nodes[moved], mesh.points.copy()
        points[nodes] = there[moved]
        least = np.minimum(worst_of_nodes(mesh.points, mesh.cells), tuning.LEAST_QUALITY)
        take_back(points, mesh.cells, mesh.points, nodes, least)
        return replace(mesh, points=points)

    def are_parts(self, surface: SimplexMesh) -> BoolArray:
        """Return which edges of triangles, or of a curve, are parts of straight edges.

        An edge that connects two straight ones is none: its ends are on these, but not its middle.
        """
        nodes, _, distance = self._nodes(surface)
        is_on = marked(nodes[distance <= self._near], surface.n_points)
        found = np.flatnonzero(is_on[surface.edges].all(axis=1))
        if len(found) and self._curves is not None:
            middles = surface.points[surface.edges[found]].mean(axis=1)
            found = found[self._curves.locator.nearest(middles)[2] <= self._near]
        return marked(found, len(surface.edges))

    def _nodes(self, mesh: SimplexMesh) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return nodes of feature edges closest to straight ones, their places, and distances."""
        nodes = np.unique(feature_edges(facets_of(mesh)))
        curves, is_straight = self._curves, self._is_straight
        if len(nodes) == 0 or curves is None or is_straight is None or not is_straight.any():
            return np.empty(0, np.int32), np.empty((0, mesh.dim)), np.empty(0)
        edges, weights, distance = curves.locator.nearest(mesh.points[nodes])
        there = np.einsum("ij,ijk->ik", weights, curves.points[curves.cells[edges]])
        found = is_straight[edges]
        return nodes[found], there[found], distance[found]


def feature_edges(surface: SimplexMesh) -> IntArray:
    """Return the edges of facets that turn by more than the ridge angle or are of two groups.

    Of facets in the plane, which are edges, all are returned.
    """
    if surface.cell_dim == 1:
        return surface.cells
    kept = sharp_facets(surface, normals_of(surface), math.radians(tuning.RIDGE_ANGLE["surface"]))
    if surface.cell_tags is not None:
        n = len(surface.edges)
        lowest, highest = regions_beside(surface.cell_facets, surface.cell_tags, n)
        kept |= lowest != highest
    return surface.edges[kept]


def _are_straight(curves: SimplexMesh) -> BoolArray:
    """Return which edges continue in a straight line at an end, or end in two corners.

    Corners are nodes of one edge or of more than two, and those at which a curve turns far.
    """
    nodes = curves.cells.ravel()
    order = np.argsort(nodes, kind="stable")
    number, first, count = np.unique(nodes[order], return_index=True, return_counts=True)
    is_corner, is_inner = (np.zeros(curves.n_points, np.bool_) for _ in range(2))
    is_corner[number[count != 2]] = True
    places = order[first[count == 2, None] + np.arange(2)]
    edge, end = np.divmod(places, 2)
    here, there = (curves.points[curves.cells[edge, at]] for at in (end, 1 - end))
    arms = there - here
    lengths = np.maximum(np.linalg.norm(arms, axis=2), np.finfo(float).tiny)
    one, other = np.swapaxes(arms / lengths[:, :, None], 0, 1)
    # Half of their sum is the sine of half of the angle that the curve turns by.
    half = 0.5 * np.linalg.norm(one + other, axis=1)
    middle = number[count == 2]
    is_inner[middle] = half * lengths.min(axis=1) <= tuning.ON_LINE * curves.diagonal
    least = math.radians(tuning.RIDGE_ANGLE["plane triangles" if curves.dim == 2 else "surface"])
    is_corner[middle] = half > math.sin(0.5 * least)
    return np.asarray(is_inner[curves.cells].any(axis=1) | is_corner[curves.cells].all(axis=1))
