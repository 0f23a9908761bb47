"""Depths of points inside the zero level of a function, and directions to it."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._progress import silent
from adaptsize.background import Octree
from adaptsize.geometry import tuning
from adaptsize.geometry.distance.implicit import crossings_of
from adaptsize.geometry.implicit_surface import Implicit, gradient_of, project
from adaptsize.typing import FloatArray, ProgressCallback

#: Takes points, float64[n, dim]; returns the signed distance of each.
DistanceFunction: TypeAlias = Callable[[FloatArray], npt.ArrayLike]

# The gradient is then evaluated at this offset, in steps; few kinks have this direction.
_BESIDE = np.array([2.6, 3.7, 5.1])


class Depths(NamedTuple):
    """Depths of points and directions to the boundary.

    Parameters
    ----------
    depth : FloatArray
        Distance from the boundary, negative outside, float64[n].
    outward : FloatArray
        Gradient of the signed distance, float64[n, dim]; inside, it points to the closest
        point.
    """

    depth: FloatArray
    outward: FloatArray

    def closest_points(self, points: FloatArray) -> FloatArray:
        """Return the closest points of the boundary, float64[n, dim]."""
        return np.asarray(points + self.depth[:, None] * self.outward)


class FunctionBoundary:
    """The zero level of a signed distance function.

    Parameters
    ----------
    function : callable
        Takes points, float64[n, dim]; returns exact distances, negative inside.
    extent : float
        Length of the part.
    """

    def __init__(self, function: Implicit, extent: float) -> None:
        self._values = function
        # Step of finite differences, as a share of the extent.  The error of rounding is 1e-16 /
        # 1e-7. Steps must be much shorter than the smallest part of an edge on which a kink is
        # located.
        self._step = 1e-7 * extent

    def distance(self, points: FloatArray) -> FloatArray:
        """Return unsigned distances, for points of any shape [..., dim]."""
        return np.abs(self._values(points.reshape(-1, points.shape[-1]))).reshape(points.shape[:-1])

    def seen_from(self, points: FloatArray, report: ProgressCallback = silent) -> Depths:
        """Return the depths of points."""
        report("distance", 0.0)
        values, gradient, _ = gradient_of(self._values, points, self._step)
        # A gradient is a unit vector.  Differences across a kink, where two parts of the boundary
        # are equally near, mix the directions to both and are shorter.  They are taken again beside
        # the kink, on one side or the other, and farther off if another kink is there.
        for offset in (1.0, -1.0, 2.5, -2.5):
            mixed = np.flatnonzero(np.abs(np.linalg.norm(gradient, axis=1) - 1.0) > tuning.NOT_UNIT)
            if len(mixed) == 0:
                break
            beside = offset * self._step * _BESIDE[: points.shape[1]]
            gradient[mixed] = gradient_of(self._values, points[mixed] + beside, self._step)[1]
        length = np.linalg.norm(gradient, axis=1)
        outward = gradient / np.where(length > 0.0, length, 1.0)[:, None]
        return Depths(-values, outward)


class ZeroLevelBoundary:
    """The zero level of a function with a gradient there.

    Parameters
    ----------
    function : callable
        Negative inside.
    background : Octree
        The zero level is searched for along the edges of its mesh.
    """

    def __init__(self, function: Implicit, background: Octree, values: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self._function = function
        self._samples, self._spacings = crossings_of(background, function, values)
        self._tree = cKDTree(self._samples)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return unsigned distances, for points of any shape [..., dim]."""
        rows = points.reshape(-1, points.shape[-1])
        found = np.linalg.norm(self._closest_points(rows, silent) - rows, axis=1)
        return np.asarray(found.reshape(points.shape[:-1]))

    def seen_from(self, points: FloatArray, report: ProgressCallback = silent) -> Depths:
        """Return the depths of points."""
        outward = self._closest_points(points, report) - points
        distance = np.linalg.norm(outward, axis=1)
        depth = np.where(self._function(points) <= 0.0, distance, -distance)
        outward /= np.where(distance > 0.0, depth, 1.0)[:, None]
        return Depths(depth, outward)

    def _closest_points(self, points: FloatArray, report: ProgressCallback) -> FloatArray:
        nearest = self._tree.query(points)[1]
        spacings = self._spacings[nearest]
        return project(self._function, points, self._samples[nearest], spacings, report)


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
    values, gradient = gradient_of(function, points, step)[:2]
    # A distance has a gradient of length 1 at almost all points: not at the medial axis.
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1.0) < tuning.NOT_UNIT
    if smooth.mean() < tuning.SMOOTH:
        return False
    values, gradient = values[smooth], gradient[smooth]
    left = np.abs(function(points[smooth] - values[:, None] * gradient))
    good = left <= tuning.MISS * np.abs(values) + step
    return bool(good.mean() >= tuning.ARRIVING)


#: A boundary that provides the closest point for every point.
Boundary: TypeAlias = FunctionBoundary | ZeroLevelBoundary
