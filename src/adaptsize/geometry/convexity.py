"""Whether a flat domain is convex, from the angles by which its boundary turns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background.topology import unique_rows
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.typing import BoolArray, FloatArray, IntArray


def is_convex(points: FloatArray, boundary: FlatBoundary) -> bool:
    r"""Return whether the domain within a boundary is convex, to rounding.

    Folds, cracks, holes and several components are all detected: the domain can only end at a wall,
    and a closed boundary that never turns inwards and winds around once is that of a convex domain.

    The boundary may turn inwards by angles whose sum :math:`T` is at most 2e-7.  This changes no
    distance by more than 5e-15 of itself.  A shortest path bends only where the boundary turns
    inwards, at most once at each place, and by no more than the boundary turns.  So its total
    curvature is at most :math:`T`, and a curve of total curvature :math:`T < \pi` between two
    points is at most :math:`1 / \cos(T / 2) \approx 1 + T^2 / 8` times as long as the straight
    line (Schmidt, Sitzungsber. Preuss. Akad. Wiss. 1925).
    """
    if not boundary.is_simple or len(boundary.facets) == 0:
        return False
    in_plane = points.shape[1] == 2
    angles = (
        turns_in_plane(points, boundary.facets).angles
        if in_plane
        else turns_of(points, boundary).angles
    )
    # A convex boundary may turn inwards by this sum of angles (radians).
    if not -float(np.minimum(angles, 0.0).sum()) <= 2e-7:  # nan at irregular places
        return False
    if in_plane:
        return abs(float(angles.sum()) - 2.0 * np.pi) < 1e-3
    corners = points[boundary.facets]
    a, b, c = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    volume = np.einsum("ij,ij->i", a, _cross(b, c))
    la, lb, lc = map(_norm, (a, b, c))
    mixed = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    # Solid angles of the facets, seen from the middle (van Oosterom and Strackee).
    around = 2.0 * np.arctan2(volume, mixed)
    return bool((volume >= 0.0).all()) and abs(float(around.sum()) - 4.0 * np.pi) < 1e-3


def count_corners(points: FloatArray, boundary: FlatBoundary) -> int:
    """Return at how many nodes a plane domain has a reflex corner, without those of noise.

    These are the nodes at which the boundary turns inwards by more than 1e-4 radians, and those
    with several walls.
    """
    return int(np.count_nonzero(~(turns_in_plane(points, boundary.facets).angles >= -1e-4)))


class PlaneTurns(NamedTuple):
    """Turning angles of the boundary of a plane domain at its nodes.

    Parameters
    ----------
    nodes : int32[b]
    into, out : float64[b, 2]
        From the node before, and to the node behind.
    once : bool[b]
        Whether one wall enters and one leaves; else ``into`` and ``out`` are those of any.
    angles : float64[b]
        Positive where the domain is convex; nan at the end of a slit, and unless ``once``.
    """

    nodes: IntArray
    into: FloatArray
    out: FloatArray
    once: BoolArray
    angles: FloatArray


def turns_in_plane(points: FloatArray, facets: IntArray) -> PlaneTurns:
    """Return the angle by which the boundary turns at each of its nodes."""
    n = len(points)
    n_out, n_in = (np.bincount(ends, minlength=n) for ends in facets.T)
    nodes = np.flatnonzero(n_out + n_in).astype(np.int32)
    once = (n_out[nodes] == 1) & (n_in[nodes] == 1)
    before, after = np.zeros(n, np.int64), np.zeros(n, np.int64)
    after[facets[:, 0]] = facets[:, 1]
    before[facets[:, 1]] = facets[:, 0]
    into, out = points[nodes] - points[before[nodes]], points[after[nodes]] - points[nodes]
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    dot = np.einsum("ij,ij->i", into, out)
    angles = np.where(once & ((cross != 0.0) | (dot > 0.0)), np.arctan2(cross, dot), np.nan)
    return PlaneTurns(nodes, into, out, once, angles)


class Turns(NamedTuple):
    """Turning angles of the boundary of a solid at its edges.

    Parameters
    ----------
    ridges : int32[r, 2]
    angles : float64[r]
        Positive where the domain is convex, nan where not two facets meet.
    """

    ridges: IntArray
    angles: FloatArray


def turns_of(points: FloatArray, boundary: FlatBoundary) -> Turns:
    """Return the angle between the two facets at each edge of the boundary of a solid."""
    facets = boundary.facets
    corners = points[facets]
    normals = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = _norm(normals)
    n_facets = len(facets)
    ends = np.concatenate([facets[:, [v, (v + 1) % 3]] for v in range(3)])
    apex = np.concatenate([facets[:, (v + 2) % 3] for v in range(3)])
    owner = np.tile(np.arange(n_facets), 3)
    forward = ends[:, 0] < ends[:, 1]
    edges, number = unique_rows(ends, len(points))
    regular = (np.bincount(number) == 2) & (np.bincount(number, weights=forward) == 1.0)
    first = np.zeros(len(edges), np.int64)
    second = np.zeros(len(edges), np.int64)
    first[number[forward]] = np.flatnonzero(forward)
    second[number[~forward]] = np.flatnonzero(~forward)
    has_area = (areas > 0.0)[:, None]
    units = np.divide(normals, areas[:, None], out=np.zeros_like(normals), where=has_area)
    normal, other = units[owner[first]], units[owner[second]]
    rise = np.einsum("ij,ij->i", normal, points[apex[second]] - points[edges[:, 0]])
    sine = _norm(_cross(normal, other))
    cosine = np.einsum("ij,ij->i", normal, other)
    angles = np.arctan2(sine, cosine)
    angles = np.where(rise > 0.0, -angles, angles)
    # Coincident facets: the end of a crack, which turns inwards, or a cell without volume.
    # Facets that close up to less than this angle (radians) may lie on each other.
    bad = (
        ~regular
        | ((cosine < 0.0) & (sine < 1e-6))
        | (areas[owner[first]] == 0.0)
        | (areas[owner[second]] == 0.0)
    )
    return Turns(edges, np.where(bad, np.nan, angles))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return cross products of rows, in half the time of numpy's."""
    columns = [a[:, i - 2] * b[:, i - 1] - a[:, i - 1] * b[:, i - 2] for i in range(3)]
    return np.stack(columns, axis=1)


def _norm(vectors: FloatArray) -> FloatArray:
    """Return the lengths of rows."""
    lengths: FloatArray = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths
