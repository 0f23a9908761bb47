"""Surfaces whose sharp edges are no features: rough by less than the tolerance.

A thread that was extruded in steps, or a scan with noise, has thousands of sharp edges between
facets that are narrower than the tolerance.  As feature edges they would be kept, with two
triangles for each size along them, and the sizes would resolve them.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.geometry.creases import normals_of, sharp_facets
from adaptsize.geometry.faces import Faces
from adaptsize.remeshing import tuning
from adaptsize.remeshing.boundary_repair import blunted
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.typing import FloatArray, IntArray


def is_rough_within(surface: SimplexMesh, tolerance: float) -> bool:
    """Return whether most faces are single facets, and enough sharp edges are lower than a height.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    tolerance : float
        In the unit of the coordinates.
    """
    low = np.count_nonzero(heights_of_edges(surface) < tolerance)
    return bool(low > tuning.LOW_EDGES * surface.n_cells) and Faces.of(surface).is_rough


def heights_of_edges(surface: SimplexMesh) -> FloatArray:
    """Return the heights of sharp edges between two facets: how far each is from where it is cut.

    It is cut off where the nodes opposite to it are connected.
    """
    normals = normals_of(surface)
    sharp = sharp_facets(surface, normals, math.radians(tuning.RIDGE_ANGLE["surface"]))
    edges = np.flatnonzero(sharp & (surface.facet_cell_counts == 2))
    one, other = normals.facet_cells[edges].T
    sine = np.linalg.norm(np.cross(normals.normals[one], normals.normals[other]), axis=1)
    cosine = np.einsum("ij,ij->i", normals.normals[one], normals.normals[other])
    a, b = 2.0 * normals.areas[[one, other]] / surface.edge_lengths[edges]
    across = np.sqrt(np.maximum(a**2 + b**2 + 2.0 * a * b * cosine, np.finfo(float).tiny))
    return np.asarray(a * b * sine / across)


class Smoothed(NamedTuple):
    """A surface with fewer sharp edges."""

    mesh: SimplexMesh
    nodes: IntArray
    """Its nodes in the given surface; some of them have moved."""
    share: float
    """The share of the tolerance that was meant for that; some points are twice as far away."""


def smoothed(surface: SimplexMesh, tolerance: float) -> Smoothed | None:
    """Return a surface with fewer sharp edges, None if facets cross within each share."""
    longest = tuning.LONGEST_OF_SMOOTHED * surface.diagonal
    for share in tuning.SMOOTHED_WITHIN:
        new, nodes = blunted(surface, share * tolerance, longest)
        if not len(crossing_facets(new).cells):
            return Smoothed(new, nodes, share)
    return None
