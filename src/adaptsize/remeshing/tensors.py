"""Metrics in the form that generators need: a function of points that returns matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.typing import FloatArray

#: Takes float64[n, dim] points, returns float64[n, dim, dim] matrices.
Tensor: TypeAlias = Callable[[FloatArray], FloatArray]


def upper_triangles(matrices: FloatArray) -> FloatArray:
    """Return the rows of the upper triangles, float64[n, dim (dim + 1) / 2]."""
    i, j = np.triu_indices(matrices.shape[-1])
    return np.ascontiguousarray(matrices[:, i, j])


def lengths_of(
    points: FloatArray, edges: npt.NDArray[Any], matrices: FloatArray
) -> FloatArray:
    """placeholder."""
    along = points[edges[:, 1]] - points[edges[:, 0]]
    a, b = (np.sqrt(np.einsum("ni,nij,nj->n", along, matrices[e], along)) for e in edges.T)
    near = np.abs(a - b) < 1e-6 * a
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(near, 0.5 * (a + b), (a - b) / np.log(a / b))


def as_tensor(size, mesh):
    if hasattr(size, "matrices"):
        from adaptsize.remeshing.logtemp import field
        return field(mesh, size.matrices)
    if callable(size):
        there = size(mesh.points[:1])
        if hasattr(there, "matrices"):
            return lambda x: size(x).matrices
        if np.ndim(there) == 3:
            return size
    return None


def mean_size(tensor):
    def size(points):
        m = tensor(points)
        return np.linalg.det(m) ** (-0.5 / m.shape[-1])
    return size
