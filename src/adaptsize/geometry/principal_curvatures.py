"""Principal curvatures and directions of triangulated surfaces."""

from __future__ import annotations

import numpy as np

from adaptsize._defaults import CREASE_ANGLE
from adaptsize.background import SimplexMesh
from adaptsize.geometry.curvature import FLAT, tensors_of
from adaptsize.typing import FloatArray, IntArray


def sector_curvatures(
    surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE, smoothing: int = 0
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return the principal curvatures and directions of the smooth parts at each node.

    A sector consists of the triangles at a node between two feature edges.

    Parameters
    ----------
    surface, crease_angle, smoothing
        As for `surface_curvature`.

    Returns
    -------
    nodes : int32[n_sectors]
        The node of each sector.
    normals : float64[n_sectors, 3]
        Unit vectors.
    curvatures : float64[n_sectors, 2]
        In the order of size, with signs; 0 where there is no normal, as at the tip of a cone.
    directions : float64[n_sectors, 3, 2]
        Unit tangents, in columns.
    """
    sectors, normals, tensors = tensors_of(surface, crease_angle, smoothing)
    nodes = np.empty(len(normals), np.int32)
    nodes[sectors.sector] = surface.cells.ravel()
    known = np.linalg.norm(normals, axis=1) > 0.5
    unit = np.where(known[:, None], normals, [0.0, 0.0, 1.0])
    least = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
    u = np.cross(unit, least)
    u /= np.linalg.norm(u, axis=1)[:, None]
    frame = np.dstack([u, np.cross(unit, u)])
    xx, yy, zz, yz, xz, xy = tensors.T
    full = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    curvatures, along = np.linalg.eigh(frame.swapaxes(1, 2) @ full @ frame)
    curvatures[~known | (np.abs(curvatures).max(axis=1) * surface.diagonal < FLAT)] = 0.0
    return nodes, unit, curvatures, np.asarray(frame @ along)
