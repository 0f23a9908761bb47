"""What bounds and separates the regions of a mesh whose worst cells are repaired, and its lines."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.local_mesh import PLANE, SURFACE, TETRAHEDRA
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import facets_with_normals
from adaptsize.background.topology import compacted, regions_beside
from adaptsize.geometry.creases import feature_facets, normals_of
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import facet_numbers
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray


def kind_of(mesh: SimplexMesh) -> int:
    """Return the kind of a mesh for the kernels of local operations."""
    if mesh.cell_dim == 3:
        return TETRAHEDRA
    return SURFACE if mesh.dim == 3 else PLANE


class Skin(NamedTuple):
    """What bounds and separates the regions of a mesh, and its lines.

    Parameters
    ----------
    facets : int32[n, 3]
        Triangles, outward on the boundary.
    keys : int64[n, 4]
        Tag, adjacent regions, and whether they differ: facets of the same key are one group.
    lines : int32[m, 2]
    line_tags : int64[m]
        ``NO_TAG`` for lines without one.
    """

    facets: IntArray
    keys: LongArray
    lines: IntArray
    line_tags: LongArray


def skin_of(mesh: SimplexMesh, *, keep_sharp: bool) -> Skin:
    """Return facets and lines of a mesh; sharp edges are lines on request."""
    if kind_of(mesh) == PLANE:
        lines, keys = _separating(mesh)
        return Skin(np.empty((0, 3), np.int32), np.empty((0, 4), np.int64), lines, keys[:, 0])
    if mesh.cell_dim == 3:
        facets, keys = _separating(mesh)
        surface = SimplexMesh(mesh.points, facets, cell_tags=numbers_of(keys))
        edge_tags = np.full(len(surface.edges), NO_TAG)
    else:
        facets, surface = mesh.cells, mesh
        keys = np.zeros((len(facets), 4), np.int64)
        keys[:, 0] = NO_TAG if mesh.cell_tags is None else mesh.cell_tags
        edge_tags = np.full(len(surface.edges), NO_TAG)
        if mesh.tagged_facets is not None and mesh.facet_tags is not None:
            edge_tags[facet_numbers(mesh, mesh.tagged_facets)] = mesh.facet_tags
    is_line = (surface.facet_cell_counts != 2) | (edge_tags != NO_TAG)
    if surface.cell_tags is not None:
        lowest, highest = regions_beside(
            surface.cell_facets, surface.cell_tags, len(surface.facets)
        )
        is_line |= lowest != highest
    if keep_sharp:
        angle = math.radians(tuning.RIDGE_ANGLE["surface"])
        is_line |= feature_facets(surface, normals_of(surface), angle)
    return Skin(facets, keys, surface.edges[is_line], edge_tags[is_line])


def numbers_of(keys: LongArray) -> IntArray:
    """Return the number of each row among the different ones."""
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _separating(mesh: SimplexMesh) -> tuple[IntArray, LongArray]:
    """Return the facets on the boundary, between regions and with a tag, and their keys."""
    n = len(mesh.facets)
    regions = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    lowest, highest = regions_beside(mesh.cell_facets, regions, n)
    is_boundary, tags = mesh.facet_cell_counts == 1, np.full(n, NO_TAG)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        number = facet_numbers(mesh, mesh.tagged_facets)
        tags[number[number >= 0]] = mesh.facet_tags[number >= 0]
    chosen = (mesh.facet_cell_counts != 2) | (lowest != highest) | (tags != NO_TAG)
    cell, opposite, facets, _ = facets_with_normals(mesh, chosen)
    row = mesh.cell_facets[cell, opposite]
    order = np.lexsort((cell, regions[cell], row))
    rows, first = np.unique(row[order], return_index=True)
    keys = np.column_stack([tags, lowest, highest, is_boundary])[rows]
    return facets[order[first]].astype(np.int32), keys


def skin_of_given(given: SimplexMesh, mesh: SimplexMesh, *, keep_sharp: bool) -> Skin:
    """Return facets and lines of the given mesh, with keys like those of the new one."""
    skin = skin_of(given, keep_sharp=keep_sharp)
    if given.cell_dim == mesh.cell_dim:
        return skin
    keys = skin.keys.copy()  # a surface that was filled
    keys[:, 3] = 1
    if mesh.tagged_facets is None:
        keys[:, 0] = NO_TAG
    return skin._replace(keys=keys)


def corners_of(points: FloatArray, lines: IntArray, tags: LongArray) -> BoolArray:
    """Return the nodes where other than two lines meet, or two of different tags, or they turn."""
    is_corner = np.zeros(len(points), np.bool_)
    nodes, lines = compacted(lines)  # few of all points
    points = points[nodes]
    degree = np.bincount(lines.ravel(), minlength=len(points))
    arms = np.zeros((len(points), 3))
    along = points[lines[:, 1]] - points[lines[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    np.add.at(arms, lines[:, 0], along)
    np.add.at(arms, lines[:, 1], -along)
    # Half of the sum of the unit vectors to both neighbours is the sine of half of the turn.
    turns = 0.5 * np.linalg.norm(arms, axis=1) > math.sin(0.5 * math.radians(tuning.TURN_AT_CORNER))
    least, most = np.full(len(points), NO_TAG), np.full(len(points), -NO_TAG)
    np.minimum.at(least, lines, tags[:, None])
    np.maximum.at(most, lines, tags[:, None])
    is_corner[nodes] = (degree != 2) | turns | (least != most)
    return is_corner
