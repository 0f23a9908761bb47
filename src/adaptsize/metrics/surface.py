"""Tangents and second derivatives on triangulated surfaces."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_values
from adaptsize.background import SimplexMesh
from adaptsize.sizes.recovery import second_derivatives_of_fits
from adaptsize.typing import FloatArray


def tangents(surface: SimplexMesh) -> FloatArray:
    """Return two orthonormal tangents at the nodes, in any orientation of the triangles.

    The normal is the direction with the largest sum of squared cosines to the normals around the
    node, weighted by area.

    Returns
    -------
    float64[n_points, 3, 2]
    """
    a, b, c = (surface.points[v] for v in surface.cells.T)
    twice = np.cross(b - a, c - a)
    area = np.linalg.norm(twice, axis=1)
    unit = twice / np.where(area > 0.0, area, 1.0)[:, None]
    outer = (area[:, None, None] * unit[:, :, None] * unit[:, None, :]).reshape(-1, 9)
    total = np.zeros((surface.n_points, 9))
    for nodes in surface.cells.T:
        for k in range(9):
            total[:, k] += np.bincount(nodes, outer[:, k], surface.n_points)
    return np.asarray(np.linalg.eigh(total.reshape(-1, 3, 3))[1][:, :, :2])


def surface_hessian(surface: SimplexMesh, values: npt.ArrayLike, frames: FloatArray) -> FloatArray:
    """Return the second derivatives of a nodal field along a surface, in given tangents.

    A quadratic is fitted in the tangent plane of each node, as in `recovered_hessian`.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    values : array_like of float, shape (n_points,)
    frames : float64[n_points, 3, 2]

    Returns
    -------
    float64[n_points, 2, 2]
    """
    nodal = as_values("values", values, (surface.n_points,))
    return second_derivatives_of_fits(surface, nodal, frames)


def in_frames(matrices: FloatArray, frames: FloatArray) -> FloatArray:
    """Return the symmetric part of matrices in the tangent planes, float64[n, 2, 2]."""
    inside = frames.swapaxes(1, 2) @ matrices @ frames
    return np.asarray(0.5 * (inside + inside.swapaxes(1, 2)))
