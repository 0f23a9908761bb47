"""Fronts that meet at points of the medial axis, and corners of the boundary they come from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._pickling import ReadOnlyState
from adaptsize.typing import BoolArray, FloatArray, LongArray

#: Closer to the boundary, in spacings, corners and directions are not resolved.
RESOLVED = 3.0

#: Takes points, float64[..., dim]; returns their distance from the boundary, with or without sign.
Distance: TypeAlias = Callable[[FloatArray], FloatArray]

_T = TypeVar("_T", bound="Rows")


@dataclass(frozen=True)
class Rows:
    """Arrays of equal length, with one row for each of n items."""

    def taken(self: _T, which: npt.NDArray[Any]) -> _T:
        """Return some of the items."""
        return type(self)(**{name: array[which] for name, array in vars(self).items()})

    @classmethod
    def joined(cls: type[_T], parts: Sequence[_T]) -> _T:
        """Return the items of several parts, of which there is at least one."""
        names = vars(parts[0])
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


@dataclass(frozen=True)
class Fronts(Rows):
    """Two fronts that meet, for each of n points inside the domain.

    Parameters
    ----------
    points : float64[n, dim]
        Where they meet.
    radii : float64[n]
        Distance from the boundary, > 0.
    directions : float64[n, 2, dim]
        Unit vectors to the closest points of the boundary.
    ends : int64[n, 2]
        Nodes of the edge from which each point was found.
    """

    points: FloatArray
    radii: FloatArray
    directions: FloatArray
    ends: LongArray

    @property
    def cosine(self) -> FloatArray:
        """Of the angle between the directions, float64[n]."""
        return np.asarray((self.directions[:, 0] * self.directions[:, 1]).sum(axis=1))

    @property
    def normals(self) -> FloatArray:
        """Unit normals of the medial axis, of either sign, float64[n, dim]."""
        across = self.directions[:, 0] - self.directions[:, 1]
        return np.asarray(across / np.linalg.norm(across, axis=1)[:, None])

    def closest_points(self, share: float = 1.0) -> FloatArray:
        """Return the closest points of the boundary, or points before them, float64[n, 2, dim]."""
        offsets = share * self.radii[:, None, None] * self.directions
        return np.asarray(self.points[:, None, :] + offsets)


def meet_at_corner(
    distance: Distance, spacing: float, fronts: Fronts, corner_angle: float
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
    wide = cosine > -np.cos(np.radians(corner_angle))
    apex = fronts.points.copy()
    together = fronts.directions.sum(axis=1)[wide] / (1.0 + cosine[wide])[:, None]
    apex[wide] += fronts.radii[wide, None] * together
    # By how much the apex lies beyond a rounding off of radius 1.
    excess = np.sqrt(2.0 / (1.0 + cosine[wide])) - 1.0
    # Largest radius of a rounded corner, as a share of the distance from it.
    # Tolerance for the interpolation of the distance, in spacings.
    allowed = 0.5 * spacing + 0.25 * fronts.radii[wide] * excess
    there, ends = apex[wide][:, None, :], fronts.closest_points()[wide]
    # Positions between the corner (0) and a closest point (1) at which the boundary is tested.
    along = np.concatenate([there, *(there + s * (ends - there) for s in (0.25, 0.5))], axis=1)
    follows = (np.abs(distance(along)) <= allowed[:, None]).all(axis=1)
    at_corner = wide.copy()
    at_corner[wide] = follows | (fronts.radii[wide] < RESOLVED * spacing)
    return at_corner, apex


@dataclass(frozen=True, eq=False, repr=False)
class MedialAxis(ReadOnlyState):
    """Points of a medial axis, found on the edges of a grid.

    Parameters
    ----------
    points : float64[n, dim]
        Points where two fronts meet.  They lie on edges of the grid.
    normals : float64[n, dim]
        Unit normals of the medial axis at these points, of either sign.  Where the axis is a curve
        in space (or a point in the plane), one of the directions across it.
    radii : float64[n]
        Distance of each point from the boundary.
    angles : float64[n]
        Angle in degrees between the directions to the two nearest points of the boundary; 180
        between parallel walls.
    distances : float64 of the nodal shape
        Distance from the medial axis at the ends of these edges, inf at all other nodes.
    corners : float64[m, dim]
        Corners of the boundary, one for each crossing close to the boundary that they cause.  One
        corner may appear many times.  In space these are points of sharp edges.
    """

    points: FloatArray
    normals: FloatArray
    radii: FloatArray
    angles: FloatArray
    distances: FloatArray
    corners: FloatArray

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name).flags.writeable = False

    def __repr__(self) -> str:
        """Return the number of points."""
        return f"MedialAxis({len(self.points)} points)"
