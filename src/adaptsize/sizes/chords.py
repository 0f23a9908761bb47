"""Sizes at curved boundaries of meshes, and those that leave a mesh within a tolerance of them."""

from __future__ import annotations

import numpy as np

from adaptsize._defaults import CREASE_ANGLE
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import interfaces
from adaptsize.sizes.curvature import size_from_curvature
from adaptsize.typing import FloatArray, IntArray


def radius_at_curves(mesh: SimplexMesh, crease_angle: float = CREASE_ANGLE) -> FloatArray:
    """Return the radius 1 / kappa of the boundary of a mesh, and of interfaces inside.

    Mesh generators keep both within their tolerance.

    Parameters
    ----------
    mesh : SimplexMesh
        Or a surface, which is a boundary itself.
    crease_angle
        As in `size_from_curvature`.

    Returns
    -------
    float64[n_points]
        inf off the curves, and on lines in 1-D.
    """
    if mesh.dim == 1:
        return np.full(mesh.n_points, np.inf)
    parts: list[tuple[SimplexMesh, IntArray]] = []
    if mesh.cell_dim == mesh.dim:
        parts = [mesh.boundary()[:2]] if not mesh.is_closed else []
        inner = interfaces(mesh)
        parts += [inner] if inner is not None else []
    else:
        parts = [(mesh, np.arange(mesh.n_points, dtype=np.int32))]
    radius = np.full(mesh.n_points, np.inf)
    for facets, nodes in parts:
        found = size_from_curvature(facets, elements_per_radian=1.0, crease_angle=crease_angle)
        radius[nodes] = np.minimum(radius[nodes], found)
    return radius


def size_of_chords(radius: FloatArray, tolerance: float) -> FloatArray:
    """Return the sizes that leave a mesh within a distance of curves of given radii.

    An edge of length l on a curve of radius r leaves the distance l^2 / (8 r).  Edges may be
    longer than the size by sqrt 2, so the size is at most 2 sqrt(tolerance r).
    """
    return np.asarray(2.0 * np.sqrt(tolerance * radius))
