"""The surface of a solid, prepared for being filled and adapted.

Triangles of CAD parts are as long as the part and narrow as a fillet.  They are divided and
flipped in flat facets, which leaves the surface as it is.  Slivers are removed, which moves it by a
share of the tolerance.  Edges that must not be rounded are listed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.flipping import flip_edges
from adaptsize.background.splitting import halved_edges, split_edges
from adaptsize.background.topology import are_among, is_tagged, renumbered_edges
from adaptsize.geometry.faces import normals_of, sharp_facets
from adaptsize.geometry.folds import folds_of
from adaptsize.remeshing.mmg import RIDGE_ANGLE
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.slivers import remove_slivers
from adaptsize.typing import IntArray

#: Edges are divided until they are not longer than this many sizes ...
_EDGE_OVER_SIZE = 4.0
#: ... or the surface would have more triangles than this.
_MAX_TRIANGLES = 400_000
#: Triangles of less height than these shares of the tolerance are removed, in two attempts.
THINNEST = (0.2, 0.02)
#: Triangles higher than this share of the smallest size are no slivers.
_SLIVER_OVER_SIZE = 0.1
#: Ridges closer than this share of the size are too close for good cells between them.
_NARROW = 0.3
#: Angle above which an edge is a feature edge, for Mmg, too; in radians.
_FEATURE_ANGLE = math.radians(RIDGE_ANGLE["MmgMeshS"])
#: Mmg rounds the triangles at an edge that is not a feature edge.  They may bulge by this share
#: of the tolerance.
_BULGE = 0.25


def refine_surface(
    mesh: SimplexMesh, size: Size, tolerance: float, thinnest: float = THINNEST[0]
) -> tuple[SimplexMesh, IntArray]:
    """Return nearly the same surface with shorter edges, and those that must not be rounded.

    Edges are divided until they are at most four times as long as the size.  Edges in flat
    facets are flipped to avoid slivers.

    Parameters
    ----------
    mesh : SimplexMesh
        A closed surface.  Tagged edges are feature edges.
    size : callable
    tolerance : float
        Allowed distance from the surface, in the unit of the coordinates.
    thinnest : float
        Triangles of less height than this share of the tolerance are removed.

    Returns
    -------
    SimplexMesh
        Slivers apart, exactly the given surface.  Cell tags are kept; data are dropped.
    int32[n, 2]
        Edges that must not be rounded, rows sorted.
    """
    height = sliver_height(mesh, size, thinnest * tolerance)
    mesh, _ = _without_slivers(mesh, height)
    mesh = _with_better_facets(mesh)
    kept = _edges_to_keep(mesh, tolerance)
    while True:
        middles = mesh.points[mesh.edges].mean(axis=1)
        long = mesh.edge_lengths > _EDGE_OVER_SIZE * size(middles)
        if not long.any() or mesh.n_cells + 2 * int(long.sum()) > _MAX_TRIANGLES:
            return mesh, _ridges(mesh, kept, size)
        split = split_edges(mesh, long)
        kept = halved_edges(kept, mesh.edges[split.split_edges], mesh.n_points)
        mesh, new_node = _without_slivers(split.mesh, height)
        kept = renumbered_edges(kept, new_node)
        mesh = _with_better_facets(mesh)


def sliver_height(mesh: SimplexMesh, size: Size, height: float) -> float:
    """Return a height of slivers, lowered to what is small compared with all sizes on a surface.

    Where the tolerance is larger than a thin plate, its sides must not be joined.
    """
    return min(height, _SLIVER_OVER_SIZE * float(size(mesh.points).min()))


def _without_slivers(mesh: SimplexMesh, height: float) -> tuple[SimplexMesh, IntArray]:
    """Remove slivers, but keep tagged edges; return the new node for each node, too."""
    thicker, new_node = remove_slivers(mesh, height)
    tagged = mesh.edges[is_tagged(mesh)]
    if thicker is mesh or len(tagged) == 0:
        return thicker, new_node
    tagged = renumbered_edges(tagged, new_node)
    return replace(thicker, tagged_facets=tagged, facet_tags=np.ones(len(tagged), int)), new_node


def _with_better_facets(mesh: SimplexMesh) -> SimplexMesh:
    """Flip edges in flat facets."""
    folds = folds_of(mesh, _FEATURE_ANGLE)
    return flip_edges(mesh, np.concatenate([folds.bent, folds.sharp]))


def _edges_to_keep(mesh: SimplexMesh, tolerance: float) -> IntArray:
    """Return the edges, not sharp, at which a smooth surface would bulge too far.

    A smooth surface through the corners of a triangle of height l bulges by about l a / 8 if its
    normal turns by the angle a on the way to the next triangle.
    """
    bent = are_among(mesh.edges, folds_of(mesh, _FEATURE_ANGLE).bent)
    normals = normals_of(mesh)
    one, other = normals.facet_cells[bent].T
    sine = np.linalg.norm(np.cross(normals.normals[one], normals.normals[other]), axis=1)
    height = 2.0 * np.maximum(normals.areas[one], normals.areas[other]) / mesh.edge_lengths[bent]
    return np.asarray(mesh.edges[bent][sine * height / 8.0 > _BULGE * tolerance])


def _ridges(mesh: SimplexMesh, kept: IntArray, size: Size) -> IntArray:
    """Return feature edges and edges to keep, except for the latter beside other ones.

    Between two ridges much closer than the size, all tetrahedra are flat.
    """
    sharp = sharp_facets(mesh, normals_of(mesh), _FEATURE_ANGLE)
    kept_now = are_among(mesh.edges, kept) & ~sharp
    on_ridge = np.zeros(mesh.n_points, bool)
    on_ridge[mesh.edges[sharp | kept_now]] = True
    height = 2.0 * mesh.measures[:, None] / mesh.edge_lengths[mesh.cell_facets]
    narrow = height < _NARROW * size(mesh.points[mesh.cells].mean(axis=1))[:, None]
    crowded = np.zeros(len(mesh.edges), bool)
    crowded[mesh.cell_facets[narrow & on_ridge[mesh.cells]]] = True
    return mesh.edges[sharp | (kept_now & ~crowded)]
