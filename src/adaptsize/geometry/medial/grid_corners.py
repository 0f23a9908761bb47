"""Fronts that meet, and the test whether they come from two sides of a boundary corner."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.background import CartesianGrid
from adaptsize.typing import BoolArray, FloatArray

# Largest radius of a rounded corner, as a share of the distance from it, ...
_ROUNDED = 0.25
# ... and if the pieces of the boundary are known to meet.
_ROUNDED_PATCHES = 0.5
# Tolerance for the interpolation of the distance, in spacings.
_INTERPOLATED = 0.5

# Positions between the corner (0) and a closest point (1) at which the boundary is tested.
_ALONG = (0.25, 0.5)

# How far the point where a front comes from may be from the boundary, in spacings and as a share
# of the path: farther if the gradient mixes several fronts.
_FOOT_SPACINGS = 0.5
_FOOT_SHARE = 0.05

# Closer to the boundary, in spacings, the midpoint is not clear of corners and crossings.
RESOLVED = 3.0

# Nodes up to this distance from the boundary, in spacings, determine which pieces meet.
_NEAR = 1.5

# Number of evaluations of the direction of a front half way to the boundary.
_LOOKS = 2


#: Takes points, float64[..., dim]; returns their distance from the boundary, with or without sign.
Distance: TypeAlias = Callable[[FloatArray], FloatArray]


class Fronts(NamedTuple):
    """Two fronts at each of n points inside the domain.

    Parameters
    ----------
    points : float64[n, dim]
        Where they meet.
    radii : float64[n]
        Distance from the boundary, > 0.
    directions : float64[n, 2, dim]
        Unit vectors to the closest points of the boundary.
    """

    points: FloatArray
    radii: FloatArray
    directions: FloatArray

    def taken(self, which: BoolArray) -> Fronts:
        """Return some of the points."""
        return Fronts(*(array[which] for array in self))

    @property
    def cosine(self) -> FloatArray:
        """Of the angle between the directions, float64[n]."""
        return np.asarray((self.directions[:, 0] * self.directions[:, 1]).sum(axis=1))

    def feet(self, share: float = 1.0) -> FloatArray:
        """Return the closest points of the boundary, or points on the way, float64[n, 2, dim]."""
        way = share * self.radii[:, None, None] * self.directions
        return np.asarray(self.points[:, None, :] + way)


def look_half_way(grid: CartesianGrid, phi: FloatArray, fronts: Fronts) -> Fronts:
    """Return fronts with directions found half way to the boundary.

    Where three fronts are close to each other, differences next to a crossing mix them.  The
    gradient of a distance is constant along the segment to the boundary, and at its midpoint it is
    clear of the crossing.  Repeated evaluation there converges, since the curvature of the level
    sets there is less than twice the reciprocal of the length.

    Parameters
    ----------
    grid : CartesianGrid
    phi : float64[shape]
    fronts : Fronts
    """
    directions = fronts.directions
    for _ in range(_LOOKS):
        half_way = fronts._replace(directions=directions).feet(0.5)
        found = _gradients(grid, phi, half_way)
        length = np.linalg.norm(found, axis=2)
        # If the segment is short, or there is another kink at its midpoint, keep the direction.
        clear = (length > 0.9) & (fronts.radii >= RESOLVED * grid.spacing.max())[:, None]
        found /= np.where(clear, length, 1.0)[:, :, None]
        directions = np.where(clear[:, :, None], found, directions)
    return fronts._replace(directions=directions)


def come_from_boundary(grid: CartesianGrid, phi: FloatArray, fronts: Fronts) -> BoolArray:
    """Return at which points both directions lead to the boundary at the right distance.

    Directions that lead out of the grid are accepted.

    Parameters
    ----------
    grid : CartesianGrid
    phi : float64[shape]
    fronts : Fronts
    """
    allowed = _FOOT_SPACINGS * float(grid.spacing.max()) + _FOOT_SHARE * fronts.radii
    off = np.abs(_interpolated(grid, phi, fronts.feet()))
    return np.asarray(((off <= allowed[:, None]) | np.isinf(off)).all(axis=1))


def distance_on_grid(grid: CartesianGrid, phi: FloatArray) -> Distance:
    """Return the distance between the nodes of a grid, inf outside of it."""
    return lambda points: _interpolated(grid, phi, points)


def meet_at_corner(
    distance: Distance,
    spacing: float,
    fronts: Fronts,
    corner_angle: float,
    rounded: FloatArray | None = None,
) -> tuple[BoolArray, FloatArray]:
    """Return which points belong to two pieces of the boundary that meet at a corner.

    Parameters
    ----------
    distance : callable
    spacing : float
        Of the nodes between which the distance is interpolated; 0 if it is exact.
    fronts : Fronts
    corner_angle : float
        Least angle of a corner inside the domain, in degrees.
    rounded : float64[n], optional
        Largest radius of a corner over the distance from it; NaN for points that are at none.

    Returns
    -------
    at_corner : bool[n]
    apex : float64[n, dim]
        Where the tangent planes of the two pieces meet closest to the point; the point itself
        if their angle is below that of a corner.

    Notes
    -----
    From a point at distance r of two pieces, in the directions u and v, the tangent planes
    at their closest points meet at ``r (u + v) / (1 + u.v)``, the apex.  The pieces meet at a
    corner if the boundary follows the tangents up to the apex: the distance is zero at the apex,
    and at a half and a quarter of the segments to either side.  Points within a few spacings
    of the boundary are not resolved; all of them are treated as at a corner.
    """
    cosine = fronts.cosine
    # Between the pieces the angle is 180 degrees less that between the directions to them.
    share = np.full(cosine.shape, _ROUNDED) if rounded is None else rounded
    wide = (cosine > -np.cos(np.radians(corner_angle))) & ~np.isnan(share)
    apex = fronts.points.copy()
    together = fronts.directions.sum(axis=1)[wide] / (1.0 + cosine[wide])[:, None]
    apex[wide] += fronts.radii[wide, None] * together
    # By how much the apex lies beyond a rounding off of radius 1.
    excess = np.sqrt(2.0 / (1.0 + cosine[wide])) - 1.0
    allowed = _INTERPOLATED * spacing + (share * fronts.radii)[wide] * excess
    there, feet = apex[wide][:, None, :], fronts.feet()[wide]
    along = np.concatenate([there, *(there + s * (feet - there) for s in _ALONG)], axis=1)
    follows = (np.abs(distance(along)) <= allowed[:, None]).all(axis=1)
    at_corner = wide.copy()
    at_corner[wide] = follows | (fronts.radii[wide] < RESOLVED * spacing)
    return at_corner, apex


def rounding_of_patches(
    grid: CartesianGrid,
    phi: FloatArray,
    patches: npt.NDArray[np.int64],
    first: npt.NDArray[np.int64],
    second: npt.NDArray[np.int64],
) -> FloatArray:
    """Return the argument ``rounded`` of `meet_at_corner` for crossings between two nodes.

    Parameters
    ----------
    grid : CartesianGrid
    phi : float64[shape]
    patches : int64[shape]
        Piece of the boundary next to each node.  Two of them meet if neighbouring nodes close
        to the boundary have them.
    first, second : int64[n]
        Numbers of nodes on both sides of each crossing.

    Returns
    -------
    float64[n]
        NaN between pieces that do not meet.
    """
    names, flat = np.unique(patches, return_inverse=True)
    number = flat.reshape(grid.shape)
    near = np.abs(phi) <= _NEAR * float(grid.spacing.max())
    meeting = []
    for axis in range(grid.dim):
        a, b = (np.moveaxis(number, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        both = np.moveaxis(near, axis, 0)
        at = both[:-1] & both[1:] & (a != b)
        meeting.append(_pair(a[at], b[at], len(names)))
    a, b = number.reshape(-1)[first], number.reshape(-1)[second]
    meets = np.isin(_pair(a, b, len(names)), np.concatenate(meeting))
    return np.where(a == b, _ROUNDED, np.where(meets, _ROUNDED_PATCHES, np.nan))


def _pair(a: npt.NDArray[np.int64], b: npt.NDArray[np.int64], n: int) -> npt.NDArray[np.int64]:
    """Return a number for each unordered pair."""
    return np.asarray(np.minimum(a, b) * n + np.maximum(a, b))


def _gradients(grid: CartesianGrid, phi: FloatArray, points: FloatArray) -> FloatArray:
    """Return central differences over one spacing of the interpolated distance."""
    found = np.empty(points.shape)
    for axis in range(grid.dim):
        step = np.zeros(grid.dim)
        step[axis] = 0.5 * grid.spacing[axis]
        # Outside of the grid nothing is known: held at its border both values are the same.
        low, high = (np.clip(points + s, grid.lower, grid.upper) for s in (-step, step))
        rise = _interpolated(grid, phi, high) - _interpolated(grid, phi, low)
        found[..., axis] = rise / grid.spacing[axis]
    return found


def _interpolated(grid: CartesianGrid, values: FloatArray, points: FloatArray) -> FloatArray:
    """Return multilinear interpolation at points[..., dim]; inf outside, where no boundary is."""
    from scipy.ndimage import map_coordinates

    places = ((points - grid.origin) / grid.spacing).reshape(-1, grid.dim)
    beyond = np.maximum(-places, places - (np.array(grid.shape) - 1)).max(axis=1, initial=0.0)
    found = map_coordinates(values, places.T, order=1, mode="nearest")
    found[beyond > _INTERPOLATED] = np.inf
    return np.asarray(found.reshape(points.shape[:-1]))
