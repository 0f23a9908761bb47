"""Visibility in a plane domain: walls, sectors and shafts.

*Walls* are the segments of the boundary.  Two points of the domain are visible from each other
unless

* the line between them leaves the domain at one of its ends: at a node of the boundary the
  domain fills one or more *sectors*, and the direction must lie in one of these; or
* a wall separates them: they lie strictly on either side of its line, and it meets
  theirs, possibly at an end of the wall: the path that bends there has the same length.

A point on the line of a wall, so each of its ends, is not hidden by it.  "Strictly" is by more
than ``slack``, a length: some roundings of the coordinates (see `plane_boundary`).

A *cone* contains the directions in which an entry acts.  It is given by five numbers: two unit
vectors s and e, counterclockwise, and its kind, `ANY`, `NARROW` (up to pi) or `WIDE`.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.local_updates import PLANE
from adaptsize._kernels.trees import DEPTH, items_of_leaf, leaf_in_shaft, set_shaft

#: Kinds of cones.
ANY, NARROW, WIDE = 0, 1, 2

#: Sides of a line on which the domain lies.
LEFT, RIGHT = 1, 2

#: Number of recently blocking walls, which are tested first.
CACHED = 4

#: Number of entries that lowered sizes in one block and are tested first in the next.
N_RECENT = 8


class Sight(NamedTuple):
    """Data for visibility in a plane domain.

    Parameters
    ----------
    ends : float64[w, 4]
        Start and end of each wall.
    boxes : float64[2 * n_leaves, 5]
        The tree over the walls (see trees.py).
    first : int32[b + 1]
        The sectors of the b-th boundary node are ``first[b]`` to ``first[b + 1] - 1``.
    sectors : float64[k, 5]
        Cones.
    slack : float
    """

    ends: np.ndarray
    boxes: np.ndarray
    first: np.ndarray
    sectors: np.ndarray
    slack: float


class Rays(NamedTuple):
    """Scratch for lines of sight.

    Parameters
    ----------
    origins : float64[2, BLOCK]
        From where each point is to be seen.
    rows : int64[BLOCK]
        Rows of the points in the sectors, -1 inside.
    sides : int64[BLOCK]
        Sides of the lines on which the domain is.
    which : int64[BLOCK]
        Numbers of points.
    stack : int64[DEPTH]
    shaft : float64[12]
    cached : int64[CACHED]
        Walls that hid points recently.
    recent : int64[N_RECENT]
        Entries that lowered sizes in the last block, -1 for none.
    """

    origins: np.ndarray
    rows: np.ndarray
    sides: np.ndarray
    which: np.ndarray
    stack: np.ndarray
    shaft: np.ndarray
    cached: np.ndarray
    recent: np.ndarray


def new_rays() -> Rays:
    """Return scratch for one thread."""
    return Rays(
        np.empty((2, BLOCK)),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK, np.int64),
        np.empty(DEPTH, np.int64),
        np.empty(12),
        np.full(CACHED, -1, np.int64),
        np.full(N_RECENT, -1, np.int64),
    )


@lean
def side_in_cone(cone, direction, slack):
    """Return how a vector begins in a cone: a sum of bits.

    0: outside by more than ``slack``; `LEFT` (`RIGHT`): along a side of the cone, which is to the
    left (right); both: inside.
    """
    (sx, sy, ex, ey, kind), (dx, dy) = cone, direction
    if kind == ANY:
        return LEFT + RIGHT
    after_start, before_end = sx * dy - sy * dx, dx * ey - dy * ex
    depth = min(after_start, before_end) if kind == NARROW else max(after_start, before_end)
    if depth < -slack:
        return 0
    if depth > slack:
        return LEFT + RIGHT
    code = LEFT if abs(after_start) <= slack and sx * dx + sy * dy > 0.0 else 0
    if abs(before_end) <= slack and ex * dx + ey * dy > 0.0:
        code += RIGHT
    return code if code > 0 else LEFT + RIGHT


@lean
def cone_in(rows, k, column):
    """Return the cone in row k, from a column on."""
    return (
        rows[k, column], rows[k, column + 1], rows[k, column + 2], rows[k, column + 3],
        rows[k, column + 4],
    )  # fmt: skip


@lean
def in_sectors(sight, row, direction):
    """Return how a vector begins in the sectors of a boundary node."""
    code = 0
    for k in range(sight.first[row], sight.first[row + 1]):
        code |= side_in_cone(cone_in(sight.sectors, k, 0), direction, sight.slack)
    return code


@lean
def turned(code):
    """Return the same sides, as seen from the other end of the line."""
    return (code >> 1) | ((code & 1) << 1)


@lean
def common_sides(sight, row, code, end_row, direction):
    """Return the sides on which a line that begins as in ``code`` ends at a boundary node; 0: none.

    ``row``: that of the boundary node at which the line begins, -1 if it is none.  A line along a
    slit is in the domain on both of its sides, but these are no neighbours.
    """
    if row >= 0:
        if direction[0] * direction[0] + direction[1] * direction[1] <= sight.slack * sight.slack:
            return LEFT + RIGHT if row == end_row else 0
        code = in_sectors(sight, row, direction)
    return code & turned(in_sectors(sight, end_row, (-direction[0], -direction[1])))


@lean
def hides(wall, a, b, side, slack):
    """Return whether a wall, a row of ``ends``, is between the points a and b.

    Where the line ab runs along a wall, with the domain on one ``side`` of it, another wall hides
    nothing if it only touches the line from the other side.
    """
    px, py, qx, qy = wall[0], wall[1], wall[2], wall[3]
    (ax, ay), (bx, by) = a, b
    wx, wy = qx - px, qy - py
    at_a = wx * (ay - py) - wy * (ax - px)
    at_b = wx * (by - py) - wy * (bx - px)
    if (at_a > 0.0) == (at_b > 0.0):
        return False
    if min(abs(at_a), abs(at_b)) <= slack * math.sqrt(wx * wx + wy * wy):
        return False
    lx, ly = bx - ax, by - ay
    at_p = lx * (py - ay) - ly * (px - ax)
    at_q = lx * (qy - ay) - ly * (qx - ax)
    margin = slack * math.sqrt(lx * lx + ly * ly)
    if (at_p > 0.0) == (at_q > 0.0) and min(abs(at_p), abs(at_q)) > margin:
        return False
    if side == LEFT:
        return max(at_p, at_q) > margin
    if side == RIGHT:
        return min(at_p, at_q) < -margin
    return True


@lean
def _is_on_both_sides(ends, w, shaft, slack):
    """Return whether a shaft has points strictly on either side of the line of wall w."""
    nx, ny = ends[w, 1] - ends[w, 3], ends[w, 2] - ends[w, 0]
    at = nx * ends[w, 0] + ny * ends[w, 1]
    low, high = math.inf, -math.inf
    for time in (0.0, 1.0):
        left, right = nx * (shaft[0] + time * shaft[4]), nx * (shaft[2] + time * shaft[6])
        under, over = ny * (shaft[1] + time * shaft[5]), ny * (shaft[3] + time * shaft[7])
        low = min(low, min(left, right) + min(under, over))
        high = max(high, max(left, right) + max(under, over))
    margin = 1.5 * slack * (abs(nx) + abs(ny))  # the shaft has some slack around, too
    return low < at - margin and high > at + margin


@lean
def _without_crossing(sight, w, x, rays, m):
    """Remove points from ``which`` that wall w hides from their origins; return the number left."""
    origins, which, left = rays.origins, rays.which, 0
    for a in range(m):
        i = which[a]
        at, origin = (x[0, i], x[1, i]), (origins[0, i], origins[1, i])
        if not hides(sight.ends[w], at, origin, rays.sides[i], sight.slack):
            which[left] = i
            left += 1
    return left


@lean
def without_hidden(sight, x, rays, m):
    """Remove points from ``which`` that are hidden from their origins; return the number left.

    Parameters
    ----------
    sight : Sight
    x : float64[2, n]
    rays : Rays
        In/Out.
    m : int
    """
    cached = rays.cached
    for c in range(CACHED):
        if cached[c] >= 0 and m > 0:
            m = _without_crossing(sight, cached[c], x, rays, m)
    if m == 0:
        return m
    set_shaft(x, rays.origins, rays.which, m, PLANE, sight.slack, rays.shaft)
    rays.stack[0], height = 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_in_shaft(sight.boxes, rays.stack, height, (rays.shaft, PLANE))
        for w in range(*items_of_leaf(leaf, sight.ends.shape[0])):
            if not _is_on_both_sides(sight.ends, w, rays.shaft, sight.slack):
                continue
            left = _without_crossing(sight, w, x, rays, m)
            if left < m:
                cached[w % CACHED] = w
                m = left
                if m == 0:
                    return m
    return m


# Lines of sight between the nodes of a mesh


class View(NamedTuple):
    """A plane domain, and scratch for one thread.

    Parameters
    ----------
    sight : Sight
    rows : int32[n]
        Rows of the nodes in the sectors, -1 inside.
    end : float64[2, 1]
        Where the line ends.
    rays : Rays
    """

    sight: Sight
    rows: np.ndarray
    end: np.ndarray
    rays: Rays


def new_view(sight: Sight, rows: np.ndarray) -> View:
    """Return a domain with scratch for one thread."""
    return View(sight, rows, np.empty((2, 1)), new_rays())


@lean
def sees(view, begin, end):
    """Return whether the line between two points is in the domain.

    The points are nodes of the mesh, each given by an array of points, its row, and its number as a
    node.
    """
    (x, i, from_node), (y, j, to_node) = begin, end
    direction = (y[j, 0] - x[i, 0], y[j, 1] - x[i, 1])
    sight, row, end_row = view.sight, view.rows[from_node], view.rows[to_node]
    side = LEFT + RIGHT
    if end_row >= 0:
        side = common_sides(sight, row, side, end_row, direction)
        if side == 0:
            return False
    elif row >= 0 and in_sectors(sight, row, direction) == 0:
        return False
    rays = view.rays
    for d in range(2):
        rays.origins[d, 0], view.end[d, 0] = x[i, d], y[j, d]
    # As without_hidden expects them: sides of the lines from points to origins.
    rays.sides[0], rays.which[0] = turned(side), 0
    return without_hidden(sight, view.end, rays, np.int64(1)) == 1


@lean_kernel
def fill_seen(x, nodes, view, seen):
    """Fill whether nodes see each other (Out: seen, bool[c, c]); x: float64[n, 2]."""
    for k in range(nodes.shape[0]):
        for m in range(k):
            is_seen = sees(view, (x, nodes[k], nodes[k]), (x, nodes[m], nodes[m]))
            seen[k, m], seen[m, k] = is_seen, is_seen
        seen[k, k] = True
