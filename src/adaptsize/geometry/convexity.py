"""Whether a flat domain is convex, from the angles by which its boundary turns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._workers import in_all_threads
from adaptsize.background.topology import unique_rows
from adaptsize.geometry.boundary import FlatBoundary, turns_in_plane
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

# Facets or edges per chunk of a thread, a millisecond.
_AT_ONCE = 1 << 13


def is_convex(points: FloatArray, boundary: FlatBoundary, ridges: Ridges | None = None) -> bool:
    r"""Return whether the domain within a boundary is convex, to rounding.

    Folds, cracks, holes and several components are all detected: the domain can only end at a wall,
    and a closed boundary that never turns inwards and winds around once is that of a convex domain.

    The boundary may turn inwards by angles whose sum :math:`T` is at most 2e-7.  This changes no
    distance by more than 5e-15 of itself.  A shortest path bends only where the boundary turns
    inwards, at most once at each place, and by no more than the boundary turns.  So its total
    curvature is at most :math:`T`, and a curve of total curvature :math:`T < \pi` between two
    points is at most :math:`1 / \cos(T / 2) \approx 1 + T^2 / 8` times as long as the straight
    line (Schmidt, Sitzungsber. Preuss. Akad. Wiss. 1925).

    ``ridges``: those of the boundary of a solid, if they are known.
    """
    if not boundary.is_simple or len(boundary.facets) == 0:
        return False
    in_plane = points.shape[1] == 2
    if in_plane:
        angles = turns_in_plane(points, boundary.facets).angles
    else:
        ridges = ridges_of(boundary.facets, len(points)) if ridges is None else ridges
        angles = turns_of(points, boundary.facets, ridges)
    if inward_turns(angles) > MOST_INWARD:
        return False
    if in_plane:
        return abs(float(angles.sum()) - 2.0 * np.pi) < 1e-3
    corners = points[boundary.facets]
    return surrounds_once(solid_angle(corners, corners.mean(axis=(0, 1))))


# Sums of angles in units of 2^-52 do not depend on the order, and so not on the parts of a mesh.
_UNIT = 2.0**-52
#: A convex boundary may turn inwards by this sum of angles (2e-7 radians), in these units.
MOST_INWARD = int(2e-7 / _UNIT)


def inward_turns(angles: FloatArray) -> int:
    """Return the sum of the angles by which a boundary turns inwards, as compared to `MOST_INWARD`.

    Angles that are nan, at irregular places, are too large.
    """
    limit = 2.0 * MOST_INWARD
    inward = np.fmin(np.where(np.isnan(angles), limit, np.rint(-angles / _UNIT)), limit)
    return int(np.maximum(inward, 0.0).astype(np.int64).sum())


def surrounds_once(angle: float) -> bool:
    """Return whether the solid angle of a closed boundary is that of a sphere."""
    return abs(angle - 4.0 * np.pi) < 1e-3


def solid_angle(corners: FloatArray, middle: FloatArray) -> float:
    """Return the solid angle of facets, float64[f, 3, 3], seen from a point; nan behind any."""
    angles, in_front = np.empty(len(corners)), np.empty(len(corners), np.bool_)

    def find(first: int, last: int) -> None:
        a, b, c = np.moveaxis(corners[first:last] - middle, 1, 0)
        volume = np.einsum("ij,ij->i", a, cross(b, c))
        la, lb, lc = map(norms, (a, b, c))
        mixed = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        angles[first:last] = np.arctan2(volume, mixed)  # Van Oosterom and Strackee
        in_front[first:last] = volume >= 0.0

    in_all_threads(find, len(corners), _AT_ONCE)
    return float(2.0 * angles.sum()) if in_front.all() else np.nan


def count_corners(points: FloatArray, boundary: FlatBoundary) -> int:
    """Return at how many nodes a plane domain has a reflex corner, without those of noise.

    These are the nodes at which the boundary turns inwards by more than 1e-4 radians, and those
    with several walls.
    """
    return int(np.count_nonzero(~(turns_in_plane(points, boundary.facets).angles >= -1e-4)))


class Ridges(NamedTuple):
    """The edges of the boundary of a solid, with the facets on both sides.

    Parameters
    ----------
    ends : int32[r, 2]
    facets : int64[r, 2]
        The facet that passes the edge from its first to its second node, and the opposite one.
    apex : int32[r, 2]
        The other nodes of these.
    regular : bool[r]
        Whether there are two such facets; else some of their numbers are arbitrary.
    """

    ends: IntArray
    facets: LongArray
    apex: IntArray
    regular: BoolArray

    def only(self, which: BoolArray) -> Ridges:
        """Return some of the edges."""
        return Ridges(self.ends[which], self.facets[which], self.apex[which], self.regular[which])


def ridges_of(facets: IntArray, n_points: int) -> Ridges:
    """Return the edges of a boundary of triangles."""
    ends = np.concatenate([facets[:, [v, (v + 1) % 3]] for v in range(3)])
    apex = np.concatenate([facets[:, (v + 2) % 3] for v in range(3)])
    edges, sides, regular = paired(ends, n_points)
    return Ridges(edges, sides % len(facets), apex[sides], regular)


def paired(ends: IntArray, n_points: int) -> tuple[IntArray, LongArray, BoolArray]:
    """Return the different edges, given in both directions.

    Returns
    -------
    edges : int32[r, 2]
        From the smaller to the larger number.
    sides : int64[r, 2]
        The row of each in this direction, and in the other.
    regular : bool[r]
        Whether there are just these two.
    """
    forward = ends[:, 0] < ends[:, 1]
    edges, number = unique_rows(ends, n_points)
    regular = (np.bincount(number) == 2) & (np.bincount(number, weights=forward) == 1.0)
    sides = np.zeros((len(edges), 2), np.int64)
    sides[number[forward], 0] = np.flatnonzero(forward)
    sides[number[~forward], 1] = np.flatnonzero(~forward)
    return edges, sides, regular


def turns_of(points: FloatArray, facets: IntArray, ridges: Ridges) -> FloatArray:
    """Return the angle between the two facets at each edge of the boundary of a solid.

    Positive where the domain is convex, nan where not two facets meet.
    """
    units, angles = np.empty((len(facets), 3)), np.empty(len(ridges.ends))

    def turn(first: int, last: int) -> None:
        units[first:last] = units_of(points[facets[first:last]])

    def find(first: int, last: int) -> None:
        own = slice(first, last)
        rise = points[ridges.apex[own, 1]] - points[ridges.ends[own, 0]]
        angles[own] = angles_between(units[ridges.facets[own]], rise, ridges.regular[own])

    in_all_threads(turn, len(facets), _AT_ONCE)
    in_all_threads(find, len(angles), _AT_ONCE)
    return angles


def units_of(corners: FloatArray) -> FloatArray:
    """Return the unit normals of facets, float64[f, 3]; 0 without area."""
    normals = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = norms(normals)
    has_area = (areas > 0.0)[:, None]
    return np.divide(normals, areas[:, None], out=np.zeros_like(normals), where=has_area)


def angles_between(units: FloatArray, rise: FloatArray, regular: BoolArray) -> FloatArray:
    """Return the angles between pairs of facets, as `turns_of` does.

    Parameters
    ----------
    units : float64[r, 2, 3]
        The unit normals of both facets.
    rise : float64[r, 3]
        From a node of the edge to the other node of the second facet.
    regular : bool[r]
    """
    normal, other = np.moveaxis(units, 1, 0)
    sine = norms(cross(normal, other))
    cosine = np.einsum("ij,ij->i", normal, other)
    angles = np.arctan2(sine, cosine)
    angles = np.where(np.einsum("ij,ij->i", normal, rise) > 0.0, -angles, angles)
    # Coincident facets: the end of a crack, which turns inwards, or a cell without volume.
    # Facets that close up to less than this angle (radians) may lie on each other.
    bad = ~regular | ((cosine < 0.0) & (sine < 1e-6))
    bad |= (units == 0.0).all(axis=2).any(axis=1)
    return np.where(bad, np.nan, angles)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return cross products of rows, in half the time of numpy's."""
    columns = [a[:, i - 2] * b[:, i - 1] - a[:, i - 1] * b[:, i - 2] for i in range(3)]
    return np.stack(columns, axis=1)


def norms(vectors: FloatArray) -> FloatArray:
    """Return the lengths of rows."""
    lengths: FloatArray = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths
