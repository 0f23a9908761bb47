"""Parts of facets that are in the shadow of others.

Facet c throws its shadow along the normal of another facet.  Facets of a mesh that are side by side
have shadows side by side.  So a large facet above many small ones is divided into one polygon for
each of these, and few more.  The distance from c is convex: in a polygon it is largest at a corner.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.distance import closest_on_facet
from adaptsize._kernels.vectors import between, cross, dot, minus, norm, triple, unit

#: Largest numbers of polygons that wait, and of corners.
_POLYGONS, _CORNERS = 160, 16


class Polygons(NamedTuple):
    """Convex polygons in the plane of one facet that wait.

    Parameters
    ----------
    at : float64[_POLYGONS, 3 * _CORNERS]
        Their corners, one after the other.
    n_corners : int64[_POLYGONS]
    height : float64[_CORNERS]
        Scratch.
    """

    at: np.ndarray
    n_corners: np.ndarray
    height: np.ndarray


def new_polygons() -> Polygons:
    """Return scratch for one thread."""
    return Polygons(
        np.empty((_POLYGONS, 3 * _CORNERS)), np.zeros(_POLYGONS, np.int64), np.empty(_CORNERS)
    )


@lean
def put_corner(polygons, h, v, x):
    """Set a corner of a polygon."""
    polygons.at[h, 3 * v], polygons.at[h, 3 * v + 1], polygons.at[h, 3 * v + 2] = x


@lean
def centre_of(polygons, h):
    """Return the mean of the corners of a polygon."""
    x, n = triple(polygons.at, h, 0), polygons.n_corners[h]
    for v in range(1, n):
        y = minus(triple(polygons.at, h, 3 * v), x)
        share = 1.0 / (v + 1.0)
        x = x[0] + share * y[0], x[1] + share * y[1], x[2] + share * y[2]
    return x


@lean
def normal_of(polygons, h):
    """Return the unit normal of a triangle; zero if it has no area."""
    x = triple(polygons.at, h, 0)
    sides = minus(triple(polygons.at, h, 3), x), minus(triple(polygons.at, h, 6), x)
    return unit(cross(sides[0], sides[1]))


@lean
def _side_of_shadow(tree, c, v, normal):
    """Return a point and the inward normal of a side of the shadow of facet c, not of length 1."""
    a, b, opposite = tree.cells[c, v], tree.cells[c, (v + 1) % 3], tree.cells[c, (v + 2) % 3]
    inward = cross(normal, between(tree.points, a, b))
    if dot(inward, between(tree.points, a, opposite)) < 0.0:
        inward = -inward[0], -inward[1], -inward[2]
    return triple(tree.points, a, 0), inward


@lean
def is_in_shadow(tree, c, x, normal, wider):
    """Return whether x is in the shadow of facet c, which is wider by a length."""
    for v in range(3):
        at, inward = _side_of_shadow(tree, c, v, normal)
        if not dot(inward, minus(x, at)) + wider * norm(inward) > 0.0:
            return False
    return True


@lean
def _halve(polygons, h, at, inward, wider):
    """Divide a polygon by a line; what is behind stays, and the rest is the next one.

    Returns the row of the rest: h if nothing is behind, or there is no room.
    """
    n, behind, shift = polygons.n_corners[h], 0, wider * norm(inward)
    for v in range(n):
        polygons.height[v] = dot(inward, minus(triple(polygons.at, h, 3 * v), at)) + shift
        behind += polygons.height[v] < 0.0
    if behind in (0, n) or n > _CORNERS - 2 or h > _POLYGONS - 3:
        return h
    there = here = 0
    for v in range(n):
        w = v + 1 if v + 1 < n else 0
        x, y = triple(polygons.at, h, 3 * v), triple(polygons.at, h, 3 * w)
        at_x, at_y = polygons.height[v], polygons.height[w]
        if at_x < 0.0:
            put_corner(polygons, _POLYGONS - 1, there, x)
            there += 1
        else:
            put_corner(polygons, h + 1, here, x)
            here += 1
        if (at_x < 0.0) != (at_y < 0.0):
            t, way = at_x / (at_x - at_y), minus(y, x)
            z = x[0] + t * way[0], x[1] + t * way[1], x[2] + t * way[2]
            put_corner(polygons, _POLYGONS - 1, there, z)
            put_corner(polygons, h + 1, here, z)
            there, here = there + 1, here + 1
    for v in range(there):
        put_corner(polygons, h, v, triple(polygons.at, _POLYGONS - 1, 3 * v))
    polygons.n_corners[h], polygons.n_corners[h + 1] = there, here
    return h + 1


@lean
def divide_by_shadow(tree, polygons, h, c, normal, wider):
    """Divide a polygon by the sides of the shadow of facet c, which is wider by a length.

    Returns the row of the part in the shadow, the other parts being in the rows from h on.  Without
    room it is larger.
    """
    for v in range(3):
        at, inward = _side_of_shadow(tree, c, v, normal)
        h = _halve(polygons, h, at, inward, wider)
    return h


@lean
def largest_gap(tree, polygons, h, c):
    """Return the largest distance of the points of a polygon from facet c."""
    square = 0.0
    for v in range(polygons.n_corners[h]):
        x = triple(polygons.at, h, 3 * v)
        square = max(square, closest_on_facet(tree.points, tree.cells, c, x)[0])
    return math.sqrt(square)
