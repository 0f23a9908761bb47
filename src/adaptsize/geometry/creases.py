"""Feature edges of triangulated surfaces, and the faces between them as tags."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize._checks import as_angle, check_type
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._kernels import sectors as kernels
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import components_of, is_tagged, pairs_of_cells, rings
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: A triangle whose area is below this share of its longest edge squared has no normal.
FLAT_SHARE = 1e-12


def normals_of(surface: SimplexMesh) -> kernels.Surface:
    """Return triangles in space with their unit normals."""
    inner = np.flatnonzero(surface.facet_cell_counts == 2)
    start, ring = rings(surface.cell_facets, len(surface.facets))
    facet_cells = np.full((len(surface.facets), 2), -1, np.int32)
    facet_cells[inner] = ring[start[inner, None] + np.arange(2)]
    normals, areas = np.empty((surface.n_cells, 3)), np.empty(surface.n_cells)
    kernels.fill_face_normals(surface.points, surface.cells, FLAT_SHARE, normals, areas)
    found = kernels.Surface(
        surface.points, surface.cells, surface.cell_facets, facet_cells, normals, areas
    )
    kernels.replace_degenerate_normals(found)
    return found


def sharp_facets(surface: SimplexMesh, normals: kernels.Surface, angle: float) -> BoolArray:
    """Return which edges of a surface are sharp, of one or of several triangles, or tagged.

    The angle is given in radians.
    """
    is_sharp = np.empty(len(surface.facets), np.bool_)
    kernels.mark_creases(normals, surface.facets, angle, is_sharp)
    return is_sharp | is_tagged(surface)


def feature_facets(surface: SimplexMesh, normals: kernels.Surface, angle: float) -> BoolArray:
    """Return which edges of a surface are feature edges; the angle in radians.

    These are the ones of `sharp_facets` without sharp edges that have a loose end.
    """
    is_feature = sharp_facets(surface, normals, angle)
    is_kept = is_tagged(surface) | (surface.facet_cell_counts != 2)
    rows = np.flatnonzero(is_feature)
    number = np.unique(surface.edges[rows], return_inverse=True)[1].reshape(-1, 2)
    while True:
        degree = np.bincount(number.ravel())
        loose = ~is_kept[rows] & (degree[number] == 1).any(axis=1)
        if not loose.any():
            return is_feature
        is_feature[rows[loose]] = False
        rows, number = rows[~loose], number[~loose]


class Folds(NamedTuple):
    """Edges that are not inside flat facets, int32[n, 2] each, rows sorted.

    Parameters
    ----------
    bent : IntArray
        Edges along which the surface is curved, neither flat nor sharp.
    sharp : IntArray
        Feature edges, also those of one triangle or of more than two, and tagged ones.
    """

    bent: IntArray
    sharp: IntArray


def folds_of(surface: SimplexMesh, crease_angle: float) -> Folds:
    """Return the edges of triangles in space that are bent or sharp.

    Neither the place of the surface nor its size matters, but for the rounding of coordinates.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, in any orientation.
    crease_angle : float
        Sharp edges turn by more, in radians.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1], [2, 0, 0]]
    >>> bent, sharp = folds_of(SimplexMesh(points, [[0, 1, 2], [1, 3, 2], [1, 4, 3]]), 0.5)
    >>> bent.tolist(), sharp.tolist()
    ([[1, 2], [1, 3]], [[0, 1], [0, 2], [1, 4], [2, 3], [3, 4]])
    """
    normals = normals_of(surface)
    sharp = sharp_facets(surface, normals, crease_angle)
    smooth = np.flatnonzero(~sharp)  # edges of two triangles
    one, other = normals.facet_cells[smooth].T
    cosine = np.abs(np.einsum("ij,ij->i", normals.normals[one], normals.normals[other]))
    sine = np.linalg.norm(np.cross(normals.normals[one], normals.normals[other]), axis=1)
    doubled = 2.0 * np.minimum(normals.areas[one], normals.areas[other])
    # The corner of the lower triangle is off by its height times the sine.  In nine parts rounded
    # to single precision at up to three diagonals from the origin, corners of flat facets were off
    # by up to 3e-7 diagonals, and in one with slivers by 7e-6; those at edges along which these
    # parts bend by more than 5e-6.
    off = doubled * sine > 1e-6 * surface.diagonal * surface.edge_lengths[smooth]
    bent = smooth[(np.arctan2(sine, cosine) > math.radians(0.1)) & off]
    return Folds(surface.edges[bent], surface.edges[sharp])


def least_angle_between(surface: SimplexMesh, least_height: float) -> tuple[float, FloatArray]:
    """Return the least angle at which two triangles meet at an edge, and the middle of the edge.

    In degrees, 180 where the surface is flat.  Orientations do not matter: a thin wedge and a
    narrow groove have the same angle.  Triangles that are lower than ``least_height`` above the
    edge do not count, nor do edges of other than two triangles.
    """
    inner = surface.facet_cell_counts == 2
    cells, edges = pairs_of_cells(surface, inner) // 3, surface.facets[inner]
    start, end = surface.points[edges].transpose(1, 0, 2)
    with np.errstate(invalid="ignore"):  # of no length: of triangles that have no height
        along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    across, heights = [], []
    for side in cells.T:
        opposite = surface.points[surface.cells[side].sum(axis=1) - edges.sum(axis=1)] - start
        opposite -= np.einsum("ij,ij->i", opposite, along)[:, None] * along
        across.append(opposite)
        heights.append(np.linalg.norm(opposite, axis=1))
    counts = np.flatnonzero(np.minimum(*heights) > max(least_height, 0.0))
    if len(counts) == 0:
        return 180.0, np.full(3, np.nan)
    cosines = np.einsum("ij,ij->i", across[0][counts], across[1][counts])
    sines = np.linalg.norm(np.cross(across[0][counts], across[1][counts]), axis=1)
    angles = np.degrees(np.arctan2(sines, cosines))
    least = int(angles.argmin())
    return float(angles[least]), surface.points[edges[counts[least]]].mean(axis=0)


def tips_of_cones(points: FloatArray, triangles: IntArray, angle: float) -> IndexArray:
    """Return the nodes around which triangles lean as those of a cone, by more than an angle.

    No two neighbours need to differ by the angle, so that there may be no feature edge.  Around the
    tip of a cone that leans by ``a``, in radians, angles add up to 2 pi cos a.  Ends of feature
    edges and nodes of the boundary are returned, too.

    Parameters
    ----------
    points : float64[n, 3]
    triangles : int[m, 3]
    angle : float
        In radians.

    Returns
    -------
    int64[k]
        In ascending order.
    """
    around = angles_around(points, triangles)
    return np.flatnonzero((around > 0.0) & (around < 2.0 * np.pi * np.cos(angle)))


def angles_around(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the sum of the angles of triangles at each point, 0 at points of none."""
    angles = corner_angles(points[triangles])
    return np.asarray(np.bincount(triangles.ravel(), angles.ravel(), len(points)), np.float64)


def corner_angles(corners: FloatArray) -> FloatArray:
    """Return the angles of triangles at their corners, float64[n, 3], from float64[n, 3, 3]."""
    a, b = (np.roll(corners, -turn, axis=1) - corners for turn in (1, 2))
    sine, cosine = np.linalg.norm(np.cross(a, b), axis=2), np.einsum("ijk,ijk->ij", a, b)
    return np.asarray(np.arctan2(sine, cosine))


def crease_edges(surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE) -> IntArray:
    """Return the feature edges of a surface: boundary, non-manifold, sharp and tagged edges.

    See `SimplexMesh.crease_edges`.
    """
    refuse_other_than_surface(surface)
    angle = math.radians(as_angle("crease_angle", crease_angle))
    return surface.facets[feature_facets(surface, normals_of(surface), angle)]


def refuse_other_than_surface(surface: SimplexMesh) -> None:
    """Raise a ValueError if a mesh does not consist of triangles in space."""
    check_type("surface", surface, SimplexMesh)
    if surface.cell_dim != 2 or surface.dim != 3:
        raise ValueError(f"surface must consist of triangles in 3-D, got {surface!r}")


def tag_faces(surface: SimplexMesh, angle: float = CREASE_ANGLE) -> SimplexMesh:
    """Return a surface with a tag for each face; faces are separated by feature edges.

    See `SimplexMesh.tag_faces`.
    """
    refuse_other_than_surface(surface)
    limit = math.radians(as_angle("angle", angle))
    # Edges of three or more triangles are feature edges, too: all others have two.
    is_free = ~feature_facets(surface, normals_of(surface), limit)
    face = components_of(pairs_of_cells(surface, is_free) // 3, surface.n_cells)
    names = {key: name for key, name in surface.tag_names.items() if key[0] != 2}
    return replace(surface, cell_tags=face.astype(np.int32) + 1, tag_names=names)
