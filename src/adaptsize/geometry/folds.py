"""Edges of a surface that are not inside flat facets: bent edges and feature edges."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.geometry.faces import normals_of, sharp_facets
from adaptsize.typing import IntArray

#: Triangles that turn by less are in one plane, radians.
_FLAT_ANGLE = math.radians(0.1)
#: So are those where the corner of the lower one is off the plane of the other one by less than
#: this share of the diagonal.  In nine parts rounded to single precision at up to three diagonals
#: from the origin, corners of flat facets were off by up to 3e-7, and in one with slivers by 7e-6;
#: those at edges along which these parts bend by more than 5e-6.
_FLAT_SHARE = 1e-6


class Folds(NamedTuple):
    """Edges that are not inside flat facets, int32[n, 2] each, rows sorted."""

    bent: IntArray
    """Edges along which the surface is curved, neither flat nor sharp."""
    sharp: IntArray
    """Feature edges, also those of one triangle or of more than two, and tagged ones."""


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
    twice_area = 2.0 * np.minimum(normals.areas[one], normals.areas[other])
    # The corner of the lower triangle is off by its height times the sine.
    off = twice_area * sine > _FLAT_SHARE * surface.diagonal * surface.edge_lengths[smooth]
    bent = smooth[(np.arctan2(sine, cosine) > _FLAT_ANGLE) & off]
    return Folds(surface.edges[bent], surface.edges[sharp])
