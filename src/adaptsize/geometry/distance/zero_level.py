"""Closest points of the zero level of a function that need not be a distance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._progress import silent
from adaptsize.background import Octree, SimplexMesh
from adaptsize.geometry.distance.closest_points import Depths, FunctionBoundary, depths_of
from adaptsize.geometry.distance.implicit import crossings_of
from adaptsize.geometry.distance.projection import project
from adaptsize.geometry.implicit_surface import Implicit, gradient_of
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# A function is a distance if the length of its gradient differs from 1 by less, at this share of
# the points: all except those at the medial axis.
_SLOPE_ERROR = 1e-3
_LEAST_SMOOTH = 0.9
# From these, steps along the gradient end at the zero level, up to this share of the step, at this
# share of the points.
_FOOT_SHARE = 1e-3
_LEAST_FEET = 0.998


class ZeroLevelBoundary:
    """The zero level of a function with a gradient there.

    Parameters
    ----------
    function : callable
        Negative inside.
    background : Octree
        The zero level is searched for along the edges of its mesh.
    """

    vertices = np.empty((0, 3))

    def __init__(self, function: Implicit, background: Octree, values: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self._function = function
        self._samples, self._spacings = crossings_of(background, function, values)
        # Step of the gradient at samples, in their spacings.
        gradient = gradient_of(function, self._samples, 1e-3 * self._spacings)[1]
        steep = np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
        self._normals = gradient / steep[:, None]
        self._tree = cKDTree(self._samples)

    def from_nodes(self, background: SimplexMesh | Octree, report: ProgressCallback) -> Depths:
        """Return what the nodes see."""
        return self._seen(background.points, report)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return distances without sign."""
        rows = points.reshape(-1, points.shape[-1])
        found = np.linalg.norm(self._feet(rows, silent) - rows, axis=1)
        return np.asarray(found.reshape(points.shape[:-1]))

    def seen_from(self, points: FloatArray, is_inside: BoolArray | None = None) -> Depths:
        """Return what points see."""
        return self._seen(points, silent)

    def _seen(self, points: FloatArray, report: ProgressCallback) -> Depths:
        feet = self._feet(points, report)
        distance = np.linalg.norm(feet - points, axis=1)
        return depths_of(points, feet, distance, self._function(points) <= 0.0)

    def _feet(self, points: FloatArray, report: ProgressCallback) -> FloatArray:
        nearest = self._starts(points)
        spacings = self._spacings[nearest]
        return project(self._function, points, self._samples[nearest], spacings, report)

    def _starts(self, points: FloatArray) -> npt.NDArray[np.intp]:
        """Return for each point the sample whose tangent plane is nearest, among near samples.

        At corners, the nearest sample may lie on another piece than the closest point.
        """
        # Number of samples around a point whose tangent planes are compared.
        count = min(8, len(self._samples))
        near = self._tree.query(points, k=count)[1].reshape(len(points), count)
        away = points[:, None, :] - self._samples[near]
        height = np.abs(np.einsum("nkd,nkd->nk", away, self._normals[near]))
        distance = np.linalg.norm(away, axis=2)
        beside = distance**2 - height**2 <= self._spacings[near] ** 2
        best = np.where(beside, height, distance).argmin(axis=1)
        return np.asarray(near[np.arange(len(points)), best])


def is_distance(function: Implicit, points: FloatArray, extent: float) -> bool:
    """Return whether a function is a signed distance, judging from its values around points.

    Parameters
    ----------
    function : callable
    points : float64[n, dim]
        Inside, n > 0.
    extent : float
        Length of the part.
    """
    # Step of the gradient for the test of a distance, as a share of the extent.
    step = 1e-6 * extent
    values, gradient = gradient_of(function, points, step)
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1.0) < _SLOPE_ERROR
    if smooth.mean() < _LEAST_SMOOTH:
        return False
    values, gradient = values[smooth], gradient[smooth]
    left = np.abs(function(points[smooth] - values[:, None] * gradient))
    good = left <= _FOOT_SHARE * np.abs(values) + step
    return bool(good.mean() >= _LEAST_FEET)


def boundary_of(
    function: Implicit, background: Octree, values: FloatArray, distance: bool
) -> FunctionBoundary | ZeroLevelBoundary:
    """Return the zero level of a function as a boundary.

    Parameters
    ----------
    function : callable
    background : Octree
    values : float64[n_points]
        Values of the function at the nodes.
    distance : bool
        Whether the function is a signed distance.
    """
    if distance:
        return FunctionBoundary(function, background.diagonal)
    return ZeroLevelBoundary(function, background, values)
