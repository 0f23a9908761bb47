"""Signed distance to a boundary on any background, negative inside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, describe, one_of, refuse_where
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry._image_distance import GridSpline, smooth_mask
from adaptsize.geometry._implicit_distance import Implicit, implicit_distance
from adaptsize.geometry._surface_distance import inside_surface, surface_distance
from adaptsize.typing import FloatArray, ProgressCallback

METHODS = ("projection", "reinitialization")
_Background: TypeAlias = SimplexMesh | CartesianGrid | Octree
_Boundary: TypeAlias = SimplexMesh | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike


def signed_distance(
    background: _Background,
    boundary: _Boundary | None = None,
    *,
    band: float = 3.0,
    method: str = "projection",
    smoothing: float = 2.0,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    """Return the distance of each node to a boundary, negative inside."""
    _check_background(background)
    band = as_number("band", band, lower=1.0, allow_inf=True)
    one_of("method", method, METHODS)
    with reporting(progress) as report:
        if boundary is None:
            return _to_own_boundary(background, report)
        if isinstance(boundary, SimplexMesh):
            return _to_surface(background, boundary, band, report)
        function, values = _as_implicit(background, boundary, smoothing)
        return implicit_distance(background, function, values, band, report)


def _check_background(background: object) -> None:
    if not isinstance(background, (SimplexMesh, CartesianGrid, Octree)):
        raise ValueError(
            f"background must be a SimplexMesh, CartesianGrid or Octree, got {describe(background)}"
        )
    if isinstance(background, SimplexMesh) and background.cell_dim < background.dim:
        raise ValueError(
            "background must have cells of full dimension, triangles in the plane or "
            f"tetrahedra, got {background!r}"
        )


def _to_own_boundary(background: _Background, report: ProgressCallback) -> FloatArray:
    if not isinstance(background, SimplexMesh):
        raise ValueError(
            f"boundary may be left out for a SimplexMesh only, got {background!r} as background"
        )
    boundary = background.boundary()
    distance = -surface_distance(background, boundary.mesh, np.inf, report)
    distance[boundary.nodes] = 0.0
    return distance


def _to_surface(
    background: _Background, surface: SimplexMesh, band: float, report: ProgressCallback
) -> FloatArray:
    if surface.dim != background.dim or surface.cell_dim != surface.dim - 1:
        wanted = "triangles in space" if background.dim == 3 else "segments in the plane"
        raise ValueError(f"boundary must be a mesh of {wanted}, got {surface!r}")
    distance = surface_distance(background, surface, band, report)
    inside = inside_surface(background, surface, distance, report)
    return np.where(inside, -distance, distance)


def _as_implicit(
    background: _Background, boundary: Any, smoothing: float
) -> tuple[Implicit, FloatArray]:
    """Return a function whose zero level is the boundary, and its values at the nodes."""
    if callable(boundary):

        def function(points: FloatArray) -> FloatArray:
            values = as_float_array("boundary(points)", boundary(points), (len(points),))
            refuse_where("boundary(points)", ~np.isfinite(values), values, "must be finite")
            return values

        if isinstance(background, CartesianGrid):
            return function, background.sample(function)
        return function, function(background.points)
    image = np.asarray(boundary)
    if not isinstance(background, CartesianGrid) or image.shape != background.shape:
        raise ValueError(
            "boundary must be a SimplexMesh, a callable or, on a CartesianGrid, an array of the "
            f"shape of the grid, got {describe(boundary)} for {background!r}"
        )
    if image.dtype == np.bool_:
        values = smooth_mask(image, as_number("smoothing", smoothing, lower=0.0))
    else:
        values = as_float_array("boundary", image)
        refuse_where("boundary", ~np.isfinite(values), values, "must be finite")
    return GridSpline(background, values), values
