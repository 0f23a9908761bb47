"""Implicit functions from images: masks, and samples of a function on a grid."""

from __future__ import annotations

import numpy as np

from adaptsize.background import CartesianGrid
from adaptsize.typing import BoolArray, FloatArray

# Number of smoothing passes; after each, every pixel centre is moved back to its side,
_ROUNDS = 4
# by this distance from the zero level, in pixels.
_ASIDE = 1e-3
# The initial value is restored if a centre moved farther than this to the other side, as at
# corners,
_LOST = 0.25
# and, where the object or the gap is at most two pixels wide, if it comes nearer than this.
_THIN = 0.25


def smooth_mask(mask: BoolArray, smoothing: float) -> FloatArray:
    """Return a smooth function that is negative at the pixels of a mask, positive at others.

    Parameters
    ----------
    mask : bool[shape]
    smoothing : float
        Standard deviation of the filter in pixels, >= 0.

    Notes
    -----
    The initial value is the distance to the nearest pixel of the other kind, in pixels, minus one
    half.  The filter is ``2 G - G G`` with a Gaussian G.  Its second moments are zero, whereas a
    Gaussian of deviation s moves the boundary of a disc of radius r inwards by s^2 / (2 r).
    """
    from scipy import ndimage

    to_outside, to_inside = (ndimage.distance_transform_edt(part) for part in (mask, ~mask))
    start: FloatArray = np.where(mask, 0.5 - to_outside, to_inside - 0.5)
    if smoothing == 0.0:
        return start
    thin = _thin_parts(mask) | _thin_parts(~mask)
    level = start
    for _ in range(_ROUNDS):
        once = ndimage.gaussian_filter(level, smoothing, mode="nearest")
        level = 2.0 * once - ndimage.gaussian_filter(once, smoothing, mode="nearest")
        astray = np.where(mask, level, -level)
        level = np.where(mask, np.minimum(level, -_ASIDE), np.maximum(level, _ASIDE))
        level = np.where((astray > _LOST) | (thin & (astray > -_THIN)), start, level)
    return level


def _thin_parts(mask: BoolArray) -> BoolArray:
    """Return the pixels that lie in no box of three pixels along each axis within the mask.

    Small groups of such pixels are omitted: where a round object is flat in the direction of an
    axis, a row of one or two pixels protrudes from it.
    """
    from scipy import ndimage

    box = np.ones((3,) * mask.ndim, np.bool_)
    padded = np.pad(mask, 3, mode="edge")
    opened = ndimage.binary_opening(padded, box)[(slice(3, -3),) * mask.ndim]
    group, _ = ndimage.label(mask & ~opened, box)
    is_large = np.bincount(group.ravel()) >= box.size
    is_large[0] = False
    return np.asarray(is_large[group])


class GridSpline:
    """Cubic spline through nodal values of a grid, callable at points.

    Beyond the grid the values are mirrored.
    """

    def __init__(self, grid: CartesianGrid, values: FloatArray) -> None:
        from scipy import ndimage

        self._grid = grid
        self._coefficients = ndimage.spline_filter(values, order=3, mode="mirror")

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the spline at points, float64[n]."""
        from scipy import ndimage

        along = ((points - self._grid.origin) / self._grid.spacing).T
        return np.asarray(
            ndimage.map_coordinates(
                self._coefficients, along, order=3, mode="mirror", prefilter=False
            )
        )
