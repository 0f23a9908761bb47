"""A triangle or tetrahedron cut by the sides of another one, and integrals over what is left.

Corners of what is left are given by their barycentric coordinates in the cell that cuts, so that a
side of that cell is where one coordinate is zero.  In the plane what is left is a convex polygon.
In space it is a convex polyhedron of which three edges meet at each corner; it is kept as a graph
of its corners, which is cut by the signs of one coordinate alone [1]_.  Corners that coincide by
degeneracy do no harm then.

Edge e of corner p of a polyhedron has the number 4 p + e.  The same edge has another number at its
other end, which is its *twin*.

References
----------
.. [1] D. Powell, T. Abel, "An exact general remeshing scheme applied to physically conservative
   voxelization", J. Comput. Phys. 297 (2015) 340-356.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inlined, lean
from adaptsize._kernels.trees import DEPTH
from adaptsize._kernels.vectors import cross, dot, minus, triple

# A tetrahedron cut by four planes has at most 8 faces, so 12 corners and 18 edges.  Corners that
# coincide may be on different sides of a plane by rounding, which adds corners between them: 14
# were seen.  On each edge a corner may be added before others are removed.  A triangle cut three
# times has at most 6.
MAX_CORNERS = 80

# Twins of the edges of a tetrahedron.
_TETRAHEDRON = (6, 14, 8, 0, 10, 12, 0, 0, 2, 13, 4, 0, 5, 9, 1, 0)


class Clipping(NamedTuple):
    """Scratch for the intersection of two cells.

    Parameters
    ----------
    start : float64[3]
        First corner of the new cell, from which coordinates are taken.
    cut : float64[4, 3]
        Corners of the new cell.
    corners : float64[4, 3]
        Corners of the old cell.
    gradients, old_gradients : float64[4, 3]
        Gradients of the barycentric coordinates of the two cells, from the second one on.
    mixed : float64[4, 4]
        Coordinates in the new cell (rows) of the corners of the old one (columns).
    back : float64[4, 4]
        Coordinates in the old cell (columns) of the corners of the new one (rows).
    place, other : float64[MAX_CORNERS, 4]
        Barycentric coordinates of the corners of what is left, in the cell that cuts.
    twins : int64[4 * MAX_CORNERS]
        The other number of each edge; edges in the same sense around each corner.
    seen : bool[4 * MAX_CORNERS]
        Edges of the faces that were visited.
    first : float64[3]
        Integrals of coordinates relative to a corner of what is left.
    second : float64[3, 3]
        Integrals of their products.
    products : float64[4, 4]
        Integrals of the products of these coordinates.
    local : float64[4, 4]
        Integrals of the products of coordinates in the new cell (rows) and in the old one.
    stack : int64[DEPTH]
    """

    start: np.ndarray
    cut: np.ndarray
    corners: np.ndarray
    gradients: np.ndarray
    old_gradients: np.ndarray
    mixed: np.ndarray
    back: np.ndarray
    place: np.ndarray
    other: np.ndarray
    twins: np.ndarray
    seen: np.ndarray
    first: np.ndarray
    second: np.ndarray
    products: np.ndarray
    local: np.ndarray
    stack: np.ndarray


def new_clipping() -> Clipping:
    """Return scratch for one thread."""
    return Clipping(
        np.empty(3), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)),
        np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((MAX_CORNERS, 4)), np.zeros((MAX_CORNERS, 4)),
        np.zeros(4 * MAX_CORNERS, np.int64), np.zeros(4 * MAX_CORNERS, np.bool_),
        np.zeros(3), np.zeros((3, 3)), np.zeros((4, 4)), np.zeros((4, 4)),
        np.empty(DEPTH, np.int64),
    )  # fmt: skip


@lean
def set_corners(points, cells, c, start, axes, corners):
    """Set the corners of a cell, relative to a point."""
    for v in range(len(axes) + 1):
        for d in range(len(axes)):
            corners[v, d] = points[cells[c, v], d] - start[d]


@lean
def set_gradients(x, axes, gradients):
    """Set the gradients of the barycentric coordinates; return the measure, 0 of a flat cell."""
    corner = triple(x, 0, 0)
    e, f = minus(triple(x, 1, 0), corner), minus(triple(x, 2, 0), corner)
    if len(axes) == 2:
        twice = e[0] * f[1] - e[1] * f[0]
        if twice == 0.0:
            return 0.0
        gradients[1, 0], gradients[1, 1] = f[1] / twice, -f[0] / twice
        gradients[2, 0], gradients[2, 1] = -e[1] / twice, e[0] / twice
        return 0.5 * abs(twice)
    g = minus(triple(x, 3, 0), corner)
    rows = (cross(f, g), cross(g, e), cross(e, f))
    six = dot(e, rows[0])
    if six == 0.0:
        return 0.0
    for v in range(3):
        for d in range(3):
            gradients[v + 1, d] = 1.0 / six * rows[v][d]
    return abs(six) / 6.0


@lean
def set_coordinates(gradients, corners, x, axes, result):
    """Set the barycentric coordinates of points in a cell, ``result[i, v]`` coordinate v of i."""
    k = len(axes) + 1
    for i in range(k):
        r = minus(triple(x, i, 0), triple(corners, 0, 0))
        rest = 1.0
        for v in range(1, k):
            value = dot(triple(gradients, v, 0), r)
            result[i, v] = value
            rest -= value
        result[i, 0] = rest


@inlined
def _clip_polygon(work, v, n):
    """Cut a polygon of n corners where coordinate v is negative; return how many are left."""
    place, other = work.place, work.other
    left = 0
    p = n - 1
    before = place[p, v]
    for q in range(n):
        after = place[q, v]
        if (before >= 0.0) != (after >= 0.0):
            t = before / (before - after)
            for a in range(3):
                other[left, a] = place[p, a] + t * (place[q, a] - place[p, a])
            left += 1
        if after >= 0.0:
            for a in range(3):
                other[left, a] = place[q, a]
            left += 1
        p, before = q, after
    for q in range(left):
        for a in range(3):
            place[q, a] = other[q, a]
    return left


@lean
def next_at_corner(h):
    """Return the edge of a corner that follows edge h, in the sense of rotation."""
    return h + 1 if h & 3 < 2 else h - 2


@inlined
def begin_faces(work, n):
    """Begin to visit the faces of a polyhedron of n corners: those at corner 0 count as seen."""
    twins, seen = work.twins, work.seen
    for h in range(4 * n):
        seen[h] = h & 3 == 3
    for e in range(3):
        h = np.int64(e)
        while not seen[h]:
            seen[h] = True
            h = next_at_corner(twins[h])


@inlined
def _clip_polyhedron(work, v, n):
    """Cut a polyhedron of n corners where coordinate v is negative; return how many are left."""
    place, twins = work.place, work.twins
    if 5 * n > 2 * MAX_CORNERS:  # no room: not convex, which rounding of flat cells might cause
        return n
    # A corner on each edge that crosses the plane.
    total = n
    for p in range(n):
        inside = place[p, v]
        if inside < 0.0:
            continue
        for e in range(3):
            q = twins[4 * p + e] >> 2
            outside = place[q, v]
            if outside >= 0.0:
                continue
            t = inside / (inside - outside)
            for a in range(4):
                place[total, a] = place[p, a] + t * (place[q, a] - place[p, a])
            twins[4 * total] = 4 * p + e
            twins[4 * p + e] = 4 * total
            total += 1
    # The edges between them: along what is left of each face that was cut, to the next one.
    for new in range(n, total):
        h = twins[4 * new]
        while h < 4 * n:
            h = twins[next_at_corner(h)]
        twins[4 * new + 2] = h + 1
        twins[h + 1] = 4 * new + 2
    # The last corners take the places of those that are cut off.
    for p in range(n):
        if p >= total or place[p, v] >= 0.0:
            continue
        total -= 1
        while total > p and total < n and place[total, v] < 0.0:
            total -= 1
        if total == p:
            break
        for a in range(4):
            place[p, a] = place[total, a]
        for e in range(3):
            h = twins[4 * total + e]
            twins[4 * p + e] = h
            twins[h] = 4 * p + e
    return total


@inlined
def clip(work, axes):
    """Cut the cell in ``place`` by all sides of the other one; return how many corners are left."""
    place, n_corners = work.place, len(axes) + 1
    n = n_corners
    if len(axes) == 3:
        for h in range(16):
            work.twins[h] = _TETRAHEDRON[h]
    for v in range(n_corners):
        lowest = np.inf
        for i in range(n):
            lowest = min(lowest, place[i, v])
        if lowest >= 0.0:
            continue
        n = _clip_polygon(work, v, n) if len(axes) == 2 else _clip_polyhedron(work, v, n)
        if n < n_corners:
            return 0
    return n


@inlined
def _polygon_integrals(work, n, whole):
    """Return the area of a polygon, that of the cutting cell being 1; set the integrals."""
    place = work.place
    o1, o2 = place[0, 1], place[0, 2]
    area = f1 = f2 = s11 = s12 = s22 = 0.0
    x1, x2 = place[1, 1] - o1, place[1, 2] - o2
    for q in range(2, n):
        y1, y2 = place[q, 1] - o1, place[q, 2] - o2
        twice = x1 * y2 - x2 * y1
        area += twice
        if whole:
            t1, t2 = x1 + y1, x2 + y2
            f1 += twice * t1
            f2 += twice * t2
            s11 += twice * (x1 * x1 + y1 * y1 + t1 * t1)
            s12 += twice * (x1 * x2 + y1 * y2 + t1 * t2)
            s22 += twice * (x2 * x2 + y2 * y2 + t2 * t2)
        x1, x2 = y1, y2
    sign = 1.0 if area > 0.0 else -1.0
    work.first[0], work.first[1] = sign * f1 / 3.0, sign * f2 / 3.0
    work.second[0, 0], work.second[1, 1] = sign * s11 / 12.0, sign * s22 / 12.0
    work.second[0, 1] = work.second[1, 0] = sign * s12 / 12.0
    return abs(area)


@inlined
def _polyhedron_integrals(work, n, whole):
    """Return the volume of a polyhedron, that of the cutting cell being 1; set the integrals."""
    place, twins, seen = work.place, work.twins, work.seen
    o1, o2, o3 = place[0, 1], place[0, 2], place[0, 3]
    volume = f1 = f2 = f3 = s11 = s12 = s13 = s22 = s23 = s33 = 0.0
    # Faces at corner 0, from which coordinates are taken, count nothing.
    begin_faces(work, n)
    for first in range(4, 4 * n):
        if seen[first]:
            continue
        # A fan of triangles from the first corner of the face.
        start, h = first >> 2, twins[first]
        a1, a2, a3 = place[start, 1] - o1, place[start, 2] - o2, place[start, 3] - o3
        p = h >> 2
        x1, x2, x3 = place[p, 1] - o1, place[p, 2] - o2, place[p, 3] - o3
        while True:
            h = next_at_corner(h)
            seen[h] = True
            h = twins[h]
            p = h >> 2
            if p == start:
                break
            y1, y2, y3 = place[p, 1] - o1, place[p, 2] - o2, place[p, 3] - o3
            six = a1 * (x2 * y3 - x3 * y2) + a2 * (x3 * y1 - x1 * y3) + a3 * (x1 * y2 - x2 * y1)
            volume += six
            if whole:
                t1, t2, t3 = a1 + x1 + y1, a2 + x2 + y2, a3 + x3 + y3
                f1 += six * t1
                f2 += six * t2
                f3 += six * t3
                s11 += six * (a1 * a1 + x1 * x1 + y1 * y1 + t1 * t1)
                s12 += six * (a1 * a2 + x1 * x2 + y1 * y2 + t1 * t2)
                s13 += six * (a1 * a3 + x1 * x3 + y1 * y3 + t1 * t3)
                s22 += six * (a2 * a2 + x2 * x2 + y2 * y2 + t2 * t2)
                s23 += six * (a2 * a3 + x2 * x3 + y2 * y3 + t2 * t3)
                s33 += six * (a3 * a3 + x3 * x3 + y3 * y3 + t3 * t3)
            x1, x2, x3 = y1, y2, y3
    sign = 1.0 if volume > 0.0 else -1.0
    work.first[0], work.first[1], work.first[2] = sign * f1 / 4, sign * f2 / 4, sign * f3 / 4
    second = work.second
    second[0, 0], second[1, 1], second[2, 2] = sign * s11 / 20, sign * s22 / 20, sign * s33 / 20
    second[0, 1] = second[1, 0] = sign * s12 / 20
    second[0, 2] = second[2, 0] = sign * s13 / 20
    second[1, 2] = second[2, 1] = sign * s23 / 20
    return abs(volume)


@inlined
def _set_products(work, axes, measure, share):
    """Set the integrals of the products of coordinates in the cell that cuts, of a given measure.

    Those over what is left, the given share of the cell, follow from the integrals of coordinates
    relative to corner 0 of what is left, and from the sum of all coordinates, which is 1.
    """
    products, place, k = work.products, work.place, len(axes) + 1
    for a in range(1, k):
        for b in range(1, k):
            products[a, b] = measure * (
                work.second[a - 1, b - 1]
                + place[0, a] * work.first[b - 1]
                + place[0, b] * (work.first[a - 1] + share * place[0, a])
            )
    products[0, 0] = measure * share
    for a in range(1, k):
        rest = measure * (work.first[a - 1] + share * place[0, a])
        products[0, 0] -= rest
        for b in range(1, k):
            rest -= products[a, b]
        products[0, a] = products[a, 0] = rest
        products[0, 0] -= rest


@inlined
def integrate(work, n, measure, whole, axes):
    """Return the measure of what is left; if ``whole``, set the integrals of products.

    ``n``: the number of its corners; ``measure``: that of the cell that cuts.
    """
    share = (
        _polygon_integrals(work, n, whole)
        if len(axes) == 2
        else _polyhedron_integrals(work, n, whole)
    )
    if whole:
        _set_products(work, axes, measure, share)
    return measure * share
