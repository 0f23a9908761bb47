"""The metric that a mesh has: the one in which its cells are regular."""

from __future__ import annotations

import numpy as np

from adaptsize._checks import refuse_where
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics.metric import Metric
from adaptsize.typing import FloatArray


def implied_metric(mesh: SimplexMesh) -> Metric:
    """Return for each cell the metric in which all its edges have the length 1.

    See `SimplexMesh.implied_metric`.
    """
    mesh = as_mesh("mesh", mesh)
    if mesh.cell_dim != mesh.dim or mesh.dim == 1:
        raise ValueError(f"mesh must be triangles in the plane or tetrahedra, got {mesh!r}")
    directions, sizes, _ = np.linalg.svd(from_regular(mesh))
    refuse_where("mesh.cells", ~(sizes[:, -1] > 0.0), sizes, "must not be flat")
    return Metric(sizes, directions)


def from_regular(mesh: SimplexMesh) -> FloatArray:
    """Return the linear maps from a regular simplex of edge 1 to the cells.

    Returns
    -------
    float64[n_cells, dim, cell_dim]
        Of either orientation.
    """
    corners = mesh.points[mesh.cells]
    edges = (corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    k = mesh.cell_dim
    # The edges from one corner of a regular simplex of edge 1, as columns.
    regular = np.linalg.cholesky(0.5 * (np.eye(k) + np.ones((k, k)))).T
    return np.asarray(edges @ np.linalg.inv(regular))
