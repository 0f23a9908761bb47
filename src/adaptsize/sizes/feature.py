"""Sizes from the local feature size: how wide the domain is."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, describe
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry.inscribed_spheres import SphereFinder
from adaptsize.sizes.combine import minimum
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Where sharp edges end in nothing, sizes must not ask for more than 10^6 elements along the part.
_SMALLEST_SHARE = 1e-6
# Meshes made to an envelope, as by fTetWild, keep their boundary within this share of the diagonal.
_TOLERANCE_SHARE = 1e-3


def size_from_feature(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh | npt.ArrayLike | None = None,
    *,
    elements_across: float = 4.0,
    crease_angle: float = 40.0,
    corner_angle: float = 30.0,
    tolerance: float | None = None,
    hmin: float | None = None,
    hmax: float | None = None,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    """Return the size that puts so many elements across narrow places."""
    across = as_number("elements_across", elements_across, lower=0.0, strict=True)
    with reporting(progress) as report:
        if boundary is not None and not isinstance(boundary, SimplexMesh):
            lfs, smallest = _from_distance(background, boundary, report), 0.0
        else:
            options = {"crease_angle": crease_angle, "corner_angle": corner_angle}
            if boundary is None:
                lfs, source = _at_own_nodes(background, options, report)
            else:
                source = boundary
                lfs = _near_boundary(background, boundary, tolerance, options, report)
            smallest = _SMALLEST_SHARE * source.diagonal
    h0 = np.maximum(2.0 * lfs / across, smallest)
    return minimum(h0.reshape(background.nodal_shape), hmin=hmin, hmax=hmax)


def _at_own_nodes(
    background: SimplexMesh | CartesianGrid | Octree,
    options: dict[str, float],
    report: ProgressCallback,
) -> tuple[FloatArray, SimplexMesh]:
    """Return the radius of the sphere at each node of a mesh, and the boundary of the mesh."""
    if not isinstance(background, SimplexMesh):
        raise ValueError(f"boundary must be given, as there is none in {background!r}")
    if background.dim == 1 or background.cell_dim < background.dim - 1:
        raise ValueError(
            "background must be a volume, or the boundary of one, in 2-D or 3-D, "
            f"got {background!r}"
        )
    if background.cell_dim < background.dim:
        return SphereFinder(background, **options).at_nodes(report).smallest(), background
    boundary = background.boundary()
    finder = SphereFinder(boundary.mesh, **options)
    lfs = np.full(background.n_points, np.inf)
    lfs[background.cells] = 0.0
    lfs[boundary.nodes] = np.inf
    inner = np.flatnonzero(lfs == 0.0)
    lfs[inner] = finder.near(background.points[inner], report).smallest()
    lfs[boundary.nodes] = finder.at_nodes(report).smallest()
    return lfs, boundary.mesh


def _near_boundary(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh,
    tolerance: float | None,
    options: dict[str, float],
    report: ProgressCallback,
) -> FloatArray:
    """Return the radius of the sphere closest to each node that is not outside, else inf."""
    points = background.points
    wanted = _not_outside(background, boundary, points, tolerance, report)
    if not wanted.any():
        raise ValueError("boundary must have nodes of the background in it or near it, got none")
    lfs = np.full(background.n_points, np.inf)
    lfs[wanted] = SphereFinder(boundary, **options).near(points[wanted], report).smallest()
    return lfs


def _not_outside(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh,
    points: FloatArray,
    tolerance: float | None,
    report: ProgressCallback,
) -> BoolArray:
    """Tell which nodes lie in the domain or no farther from it than a tolerance."""
    from adaptsize.geometry.distance import signed_distance

    if boundary.dim != background.dim or boundary.cell_dim != background.dim - 1:
        kind = "segments" if background.dim == 2 else "triangles"
        raise ValueError(f"boundary must consist of {kind} in {background.dim}-D, got {boundary!r}")
    if tolerance is not None:
        tolerance = as_number("tolerance", tolerance, lower=0.0)
    if isinstance(background, SimplexMesh) and background.cell_dim < background.dim:
        within = _TOLERANCE_SHARE * boundary.diagonal if tolerance is None else tolerance
        return np.asarray(boundary.locator.nearest(points)[2] <= within)
    phi = signed_distance(background, boundary, progress=report).ravel()
    wanted = phi <= (_reach(background, boundary) if tolerance is None else tolerance)
    if isinstance(background, CartesianGrid) and background.active is not None:
        wanted &= background.active.ravel()
    return np.asarray(wanted)


def _reach(
    background: SimplexMesh | CartesianGrid | Octree, boundary: SimplexMesh
) -> float | FloatArray:
    """Return how far outside a node of a cell that the boundary passes may lie."""
    if isinstance(background, CartesianGrid):
        return float(np.linalg.norm(background.spacing))
    if isinstance(background, SimplexMesh):
        return _TOLERANCE_SHARE * boundary.diagonal
    reach = np.zeros(background.n_points)
    diagonals = np.linalg.norm(background.leaf_sizes, axis=1)
    np.maximum.at(reach, background.leaf_corners, diagonals[:, None])
    return reach


def _from_distance(
    background: SimplexMesh | CartesianGrid | Octree,
    phi: npt.ArrayLike,
    report: ProgressCallback,
) -> FloatArray:
    """Return the local feature size from distances at the nodes of a grid."""
    from adaptsize.geometry.feature_size import feature_size

    if not isinstance(background, CartesianGrid):
        raise ValueError(
            f"boundary must be a SimplexMesh, or distances on a CartesianGrid, "
            f"got {describe(phi)} on {background!r}"
        )
    return feature_size(background, phi, progress=report)
