"""Edges of a surface that are not inside flat facets: bent edges and feature edges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import are_among, pairs_of_cells, tags_of_facets
from adaptsize.typing import BoolArray, IntArray

_FLAT_ANGLE = np.deg2rad(0.1)


class Folds(NamedTuple):
    """Edges that are not inside flat facets, int32[n, 2] each, rows sorted."""

    bent: IntArray
    """Edges along which the surface is curved, neither flat nor sharp."""
    sharp: IntArray

    def split(self, parents: IntArray, n_points: int) -> Folds:
        """Return the edges after those in ``parents`` were split in half.

        The midpoint of row k of ``parents`` is the node ``n_points + k``.
        """
        return Folds(*(halved_edges(edges, parents, n_points) for edges in self))


def folds_of(mesh: SimplexMesh, crease_angle: float) -> Folds:
    """Return the edges along which two triangles meet at an angle; tagged edges are sharp."""
    corners = mesh.points[mesh.cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice_area = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(twice_area, np.finfo(float).tiny)[:, None]
    paired = mesh.facet_cell_counts == 2
    one, other = pairs_of_cells(mesh, paired).T // 3
    cosine = np.abs(np.einsum("ij,ij->i", normals[one], normals[other]))
    sine = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    angle = np.arctan2(sine, cosine)  # 0 to 90 degrees, whatever the orientation
    # Coordinates may have single precision: the normal of a sliver of that height is uncertain.
    height = np.minimum(twice_area[one], twice_area[other]) / mesh.edge_lengths[paired].clip(1e-300)
    rounding = 4.0 * np.finfo(np.float32).eps * np.abs(mesh.points).max()
    sharp = (angle > crease_angle) | is_tagged(mesh)[paired]
    bent = (angle > _FLAT_ANGLE + rounding / height.clip(1e-300)) & ~sharp
    edges = mesh.edges[paired]
    return Folds(edges[bent], edges[sharp])


def is_tagged(mesh: SimplexMesh) -> BoolArray:
    """Return which facets carry a tag other than 0, bool[n_facets]."""
    if mesh.tagged_facets is None or mesh.facet_tags is None:
        return np.zeros(len(mesh.facets), np.bool_)
    tags = tags_of_facets(mesh.facets, mesh.tagged_facets, mesh.facet_tags, mesh.n_points)
    return np.asarray(tags != 0)


def renumbered_edges(edges: IntArray, new_node: IntArray) -> IntArray:
    """Return the edges with other numbers of nodes, without those that have vanished."""
    ends = np.sort(new_node[edges], axis=1)
    return np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).astype(np.int32)


def halved_edges(edges: IntArray, split: IntArray, n_points: int) -> IntArray:
    """Return ``edges`` with those in ``split`` halved; row k has the midpoint n_points + k."""
    middle = np.arange(n_points, n_points + len(split), dtype=np.int32)
    affected = are_among(split, edges)
    halves = [np.column_stack([split[affected, end], middle[affected]]) for end in (0, 1)]
    return np.concatenate([edges[~are_among(edges, split)], *halves]).astype(np.int32)
