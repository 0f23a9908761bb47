"""Visibility in a solid: triangles of the boundary, shafts, and cells at boundary nodes.

A triangle of the boundary hides two points from each other if they lie strictly, by more
than rounding, on either side of it and the line between them meets it, its border
included.  At nodes of the boundary, the direction must also lie in a cell, and at reflex edges on
the inner side of one of the two faces.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inlined, lean, lean_kernel
from adaptsize._kernels.local_updates import SPACE
from adaptsize._kernels.trees import items_of_leaf, leaf_in_shaft, set_shaft
from adaptsize._kernels.vectors import between, cross, dot

# Tolerance for directions outside, as an angle.
AHEAD = 1e-10


# Number of recently blocking triangles, which are tested first.
CACHED = 8


class Walls(NamedTuple):
    """The triangles of the boundary of a solid.

    Parameters
    ----------
    triangles : float64[f, 14]
        A vertex, the unit normal, the gradients of two barycentric coordinates, the
        tolerance for distances, and the tolerance for coordinates.
    boxes : float64[2 * n_leaves, 7]
        The tree over them (see trees.py).
    slack : float
        Tolerance: smaller distances are zero.
    """

    triangles: np.ndarray
    boxes: np.ndarray
    slack: float


class Stars(NamedTuple):
    """The cells at nodes of the boundary.

    Parameters
    ----------
    points : float64[n, 3]
        The nodes of the mesh.
    rows : int32[n]
        Row of a node of the boundary, -1 inside.
    first : int32[rows + 1]
    star : int32[s, 3]
        ``star[first[row]:first[row + 1]]`` are the other nodes of the cells at a node, so
        that their directions are a right-handed triple.
    """

    points: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    star: np.ndarray


@lean_kernel
def fill_stars(points, cells, rows, least, first, star):
    """Fill the cells with a volume at nodes of the boundary, as in `Stars`.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 4]
    rows : int32[n]
    least : float64
        Cells with a smaller ratio of volume to the cube of the longest edge have no volume.
    first : int32[n_rows + 1]
        Out.
    star : int32[s, 3]
        Out: room for all cells.
    """
    first[:] = 0
    for step in range(2):  # count, then fill: first[row] is where the next cell of row - 1 goes
        for t in range(cells.shape[0]):
            a, b, c, d = cells[t, 0], cells[t, 1], cells[t, 2], cells[t, 3]
            if max(rows[a], rows[b], rows[c], rows[d]) < 0:
                continue
            p, q, r = between(points, a, b), between(points, a, c), between(points, a, d)
            volume, longest = dot(p, cross(q, r)), 0.0
            for k in range(3):
                longest = max(longest, abs(p[k]), abs(q[k]), abs(r[k]))
            if abs(volume) <= least * longest**3:
                continue
            if volume < 0.0:
                c, d = d, c
            # Even permutations: seen from the first node, the three others are right-handed.
            for node, i, j, k in ((a, b, c, d), (b, a, d, c), (c, a, b, d), (d, a, c, b)):
                row = rows[node]
                if row < 0:
                    continue
                if step == 0:
                    if row + 2 < first.shape[0]:
                        first[row + 2] += 1
                    continue
                place = first[row + 1]
                first[row + 1] += 1
                star[place, 0], star[place, 1], star[place, 2] = i, j, k
        if step == 0:
            for row in range(2, first.shape[0]):
                first[row] += first[row - 1]


class Sight(NamedTuple):
    """Data for visibility in a solid."""

    walls: Walls
    stars: Stars


@lean
def _enters(stars, nodes, direction):
    """Return whether a direction at a point inside node a, edge ab or face abc enters the domain.

    b and c are -1 for fewer nodes.
    """
    (a, b, c), points, star = nodes, stars.points, stars.star
    limit = AHEAD * AHEAD * dot(direction, direction)
    if limit == 0.0:
        return True
    wanted = (1 if b >= 0 else 0) + (1 if c >= 0 else 0)
    for k in range(stars.first[stars.rows[a]], stars.first[stars.rows[a] + 1]):
        found = 0
        outside = False
        for v in range(3):
            o = star[k, v]
            if o in (b, c):  # the face opposite to it does not hold the point
                found += 1
                continue
            p, q = (
                between(points, a, star[k, (v + 1) % 3]),
                between(points, a, star[k, (v + 2) % 3]),
            )
            normal = cross(p, q)
            inwards = dot(normal, direction)
            if inwards < 0.0 and inwards * inwards > limit * dot(normal, normal):
                outside = True
                break
        if not outside and found == wanted:
            return True
    return False


@lean
def without_leaving(stars, nodes, piece, active, m):
    """Remove points from ``active`` whose piece from bends[level] to bends[other] starts outside.

    ``nodes``: int64[3, BLOCK], those of the node, edge or face on which bends[level] lies.
    Returns how many are left.
    """
    (bends, level, other), left = piece, 0
    for k in range(m):
        i = active[k]
        a, b, c = nodes[0, i], nodes[1, i], nodes[2, i]
        dx = bends[other, 0, i] - bends[level, 0, i]
        dy = bends[other, 1, i] - bends[level, 1, i]
        dz = bends[other, 2, i] - bends[level, 2, i]
        inside = a < 0 or stars.rows[a] < 0 or (b >= 0 and stars.rows[b] < 0)
        inside = inside or (c >= 0 and stars.rows[c] < 0)
        if not inside:
            inside = _enters(stars, (a, b, c), (dx, dy, dz))
        if inside:
            active[left] = i
            left += 1
    return left


@lean
def _crosses(triangles, t, a, b, i):
    """Return whether triangle t separates a[:, i] from b[:, i]."""
    at_a = at_b = 0.0
    for d in range(3):
        at_a += triangles[t, 3 + d] * (a[d, i] - triangles[t, d])
        at_b += triangles[t, 3 + d] * (b[d, i] - triangles[t, d])
    slack = triangles[t, 12]
    if not ((at_a > slack and at_b < -slack) or (at_a < -slack and at_b > slack)):
        return False
    share = at_a / (at_a - at_b)
    u = v = 0.0
    for d in range(3):
        p = a[d, i] + share * (b[d, i] - a[d, i]) - triangles[t, d]
        u += triangles[t, 6 + d] * p
        v += triangles[t, 9 + d] * p
    nil = triangles[t, 13]
    return u >= -nil and v >= -nil and u + v <= 1.0 + nil


@inlined
def _separates(triangles, t, shaft):
    """Return whether the two ends of a shaft have points strictly on either side of a triangle."""
    middle_a = middle_b = reach_a = reach_b = 0.0
    for d in range(3):
        n, o = triangles[t, 3 + d], triangles[t, d]
        low, high = shaft[d], shaft[3 + d]
        middle_a += n * (0.5 * (low + high) - o)
        reach_a += abs(n) * 0.5 * (high - low)
        low, high = low + shaft[6 + d], high + shaft[9 + d]
        middle_b += n * (0.5 * (low + high) - o)
        reach_b += abs(n) * 0.5 * (high - low)
    slack = triangles[t, 12]
    return (middle_a + reach_a > slack and middle_b - reach_b < -slack) or (
        middle_a - reach_a < -slack and middle_b + reach_b > slack
    )


@lean
def _without_crossing(triangles, t, ends, active, m):
    """Remove points from ``active`` where triangle t hides a from b; return the number left."""
    (a, b), left = ends, 0
    for k in range(m):
        i = active[k]
        if not _crosses(triangles, t, a, b, i):
            active[left] = i
            left += 1
    return left


@lean
def without_hidden(walls, a, b, m, block):
    """Remove points from ``active`` where a is hidden from b; return the number left.

    ``block``: ``active``, ``cached``, and as scratch ``shaft`` and ``stack``.
    """
    active, cached, shaft, stack = block.active, block.cached, block.shaft, block.stack[1]
    left = m
    for c in range(CACHED):
        t = cached[c]
        if t < 0 or left == 0:
            break
        if c == 0:
            set_shaft(a, b, active, m, SPACE, walls.slack, shaft)
        if _separates(walls.triangles, t, shaft):
            before, left = left, _without_crossing(walls.triangles, t, (a, b), active, left)
            if left < before:
                _put_first(cached, c, t)
    if left == 0:
        return 0
    if left < m or cached[0] < 0:
        set_shaft(a, b, active, left, SPACE, walls.slack, shaft)
    m, stack[0], height = left, 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_in_shaft(walls.boxes, stack, height, (shaft, SPACE))
        for t in range(*items_of_leaf(leaf, walls.triangles.shape[0])):
            if not _separates(walls.triangles, t, shaft):
                continue
            left = _without_crossing(walls.triangles, t, (a, b), active, m)
            if left < m:
                _put_first(cached, CACHED - 1, t)
                m = left
                if m == 0:
                    return 0
    return m


@lean
def _put_first(cached, c, t):
    """Put triangle t before the first c entries of ``cached``."""
    for back in range(c, 0, -1):
        cached[back] = cached[back - 1]
    cached[0] = t
