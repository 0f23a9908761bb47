"""Thickness of the regions of a mesh where they are thin layers."""

from __future__ import annotations

import math

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.geometry.medial.inscribed_spheres import InscribedSpheres, SphereFinder
from adaptsize.typing import FloatArray, IntArray

# A region is a layer where it is thinner than this share of the widths of its two faces.
_THIN = 0.25
# The cosine of the least angle between the normals of its two faces, 120 degrees.
_FACING = -0.5
# A point is on an edge or at a node of its facet if a weight is below this.
_ON_EDGE = 1e-6


def half_thickness(mesh: SimplexMesh, *, crease_angle: float) -> FloatArray:
    r"""Return half the thickness of thin layers at the nodes of their boundaries.

    The largest sphere inside a region that touches its boundary at a node has a radius r
    (`inscribed_spheres`).  The region is a thin layer there if :math:`2 r \le w / 4` for the width
    w of both faces that the sphere touches, and their normals differ by more than 120 degrees, so
    that corners are no layers.  The width of a face of area A with a rim of length L
    is :math:`4 A / L`, that of a line in the plane its length, and that of a face without rim is
    infinite.  At feature edges, the narrowest face counts.

    The steps of an interface that follows the faces of voxels are as wide as they are high, and
    are no layers.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra, with regions (``cell_tags``).
    crease_angle : float
        Faces end where the boundary of a region turns by more, degrees.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Inf at all other nodes.
    """
    radii = np.full(mesh.n_points, np.inf)
    if mesh.cell_tags is None or mesh.cell_tags.min() == mesh.cell_tags.max():
        return radii
    order = np.argsort(mesh.cell_tags, kind="stable")
    for cells in np.split(order, np.flatnonzero(np.diff(mesh.cell_tags[order])) + 1):
        nodes, local = np.unique(mesh.cells[cells], return_inverse=True)
        region = SimplexMesh(mesh.points[nodes], local.reshape(len(cells), -1))
        if region.is_closed:  # only if cells overlap
            continue
        boundary = region.boundary()
        spheres = SphereFinder(boundary.mesh, crease_angle=crease_angle).at_nodes()
        thin = _between_wide_faces(boundary.mesh, spheres, crease_angle)
        at = nodes[boundary.nodes[spheres.owners[thin]]]
        np.minimum.at(radii, at, spheres.radii[thin])
    return radii


def _between_wide_faces(
    boundary: SimplexMesh, spheres: InscribedSpheres, crease_angle: float
) -> IntArray:
    """Return the spheres between two faces that are wide for their distance."""
    normals = _normals(boundary)
    finite = np.flatnonzero(np.isfinite(spheres.radii))
    width = _face_widths(boundary, normals, crease_angle)
    other, weights, _ = boundary.locator.nearest(spheres.contacts[finite])
    own = _facets_of(boundary, normals, spheres.owners[finite], spheres.normals[finite])
    narrower = np.minimum(width[own], _narrowest(boundary, width, other, weights))
    thin = 2.0 * spheres.radii[finite] <= _THIN * narrower
    thin &= (normals[own] * normals[other]).sum(axis=1) < _FACING
    return finite[thin].astype(np.int32)


def _normals(boundary: SimplexMesh) -> FloatArray:
    """Return unit outward normals of facets; nan if they have no area."""
    corners = boundary.points[boundary.cells]
    sides = corners[:, 1:] - corners[:, :1]
    if boundary.dim == 2:
        normals = np.column_stack([sides[:, 0, 1], -sides[:, 0, 0]])
    else:
        normals = np.cross(sides[:, 0], sides[:, 1])
    with np.errstate(invalid="ignore"):
        unit: FloatArray = normals / np.linalg.norm(normals, axis=1)[:, None]
    return unit


def _face_widths(boundary: SimplexMesh, normals: FloatArray, crease_angle: float) -> FloatArray:
    """Return for each facet the width of its face, inf if the face has no rim."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n, corners = boundary.n_cells, boundary.cell_dim + 1
    edge = boundary.cell_facets.ravel()
    order = np.argsort(edge, kind="stable")
    paired = order[boundary.facet_cell_counts[edge[order]] == 2]
    one, two = (paired // corners).reshape(-1, 2).T
    smooth = (normals[one] * normals[two]).sum(axis=1) >= math.cos(math.radians(crease_angle))
    links = coo_array((np.ones(smooth.sum()), (one[smooth], two[smooth])), shape=(n, n))
    face = connected_components(links, directed=False)[1]
    length = np.ones(len(boundary.facets))
    if boundary.dim == 3:
        start, end = boundary.points[boundary.facets.T]
        length = np.linalg.norm(start - end, axis=1)
    length[edge[paired[::2][smooth]]] = 0.0
    rim = np.bincount(np.repeat(face, corners), length[edge])
    area = np.bincount(face, boundary.measures)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(rim > 0.0, 2.0 * boundary.cell_dim * area / rim, np.inf)
    of_facets: FloatArray = width[face]
    return of_facets


def _narrowest(
    boundary: SimplexMesh, width: FloatArray, cell: IntArray, weights: FloatArray
) -> FloatArray:
    """Return the smallest width of the faces at points of the boundary."""
    at_node = np.full(boundary.n_points, np.inf)
    np.minimum.at(at_node, boundary.cells, width[:, None])
    at_edge = np.full(len(boundary.facets), np.inf)
    np.minimum.at(at_edge, boundary.cell_facets, width[:, None])
    on = weights > _ON_EDGE
    node = boundary.cells[cell, np.argmax(weights, axis=1)]
    edge = boundary.cell_facets[cell, np.argmin(weights, axis=1)]
    choices = [on.all(axis=1), on.sum(axis=1) > 1]
    narrowest: FloatArray = np.select(choices, [width[cell], at_edge[edge]], at_node[node])
    return narrowest


def _facets_of(
    boundary: SimplexMesh, normals: FloatArray, nodes: IntArray, inward: FloatArray
) -> IntArray:
    """Return for each node and inward normal the facet at the node with the closest normal."""
    first, ring = boundary.rings
    count = np.diff(first)[nodes]
    start = np.cumsum(count) - count
    sphere = np.repeat(np.arange(len(nodes)), count)
    facet = ring[np.arange(len(sphere)) - start[sphere] + first[nodes][sphere]]
    against = np.nan_to_num((normals[facet] * inward[sphere]).sum(axis=1), nan=1.0)
    order = np.lexsort((against, sphere))
    closest: IntArray = facet[order[start]]
    return closest
