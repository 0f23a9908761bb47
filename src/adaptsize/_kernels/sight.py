"""Visibility in a plane domain: walls, sectors and shafts.

*Walls* are the segments of the boundary.  Two points of the domain are visible from each other
unless

* the line between them leaves the domain at one of its ends: at a node of the boundary the
  domain fills one or more *sectors*, and the direction must lie in one of these; or
* a wall separates them: they lie strictly on either side of its line, and it meets
  theirs, possibly at an end of the wall: the path that bends there has the same length.

A point on the line of a wall, so each of its ends, is not hidden by it.  "Strictly" is by more
than ``slack``, a length: 1e-11 of the diagonal of the domain.

A *cone* contains the directions in which an entry acts.  It is given by five numbers: two unit
vectors s and e, counterclockwise, and its kind, `ANY`, `NARROW` (up to pi) or `WIDE`.

The *shaft* of two boxes is their hull: the union of the boxes between them, whose corners move from
those of one to those of the other.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.trees import LEAF

#: Kinds of cones.
ANY, NARROW, WIDE = 0, 1, 2

#: Sides of a line on which the domain lies.
LEFT, RIGHT = 1, 2

#: Number of recently blocking walls, which are tested first.
CACHED = 4


class Sight(NamedTuple):
    """Data for visibility in a plane domain."""

    ends: np.ndarray
    """float64[w, 4]: start and end of each wall."""
    boxes: np.ndarray
    """float64[2 * n_leaves, 5]: the tree over the walls (see trees.py)."""
    first: np.ndarray
    """int32[b + 1]: the sectors of the b-th boundary node are ``first[b]`` to
    ``first[b + 1] - 1``."""
    sectors: np.ndarray
    """float64[k, 5]: cones."""
    slack: float


@lean
def side_in_cone(sx, sy, ex, ey, kind, dx, dy, slack):
    """Return how the vector (dx, dy) begins in a cone: a sum of bits.

    0: outside by more than ``slack``; `LEFT` (`RIGHT`): along a side of the cone, which is to the
    left (right); both: inside.
    """
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
def in_sectors(sight, row, dx, dy):
    """Return how the vector (dx, dy) begins in the sectors of a boundary node."""
    code = 0
    cones = sight.sectors
    for k in range(sight.first[row], sight.first[row + 1]):
        sx, sy, ex, ey, kind = cones[k, 0], cones[k, 1], cones[k, 2], cones[k, 3], cones[k, 4]
        code |= side_in_cone(sx, sy, ex, ey, kind, dx, dy, sight.slack)
    return code


@lean
def turned(code):
    """Return the same sides, as seen from the other end of the line."""
    return (code >> 1) | ((code & 1) << 1)


@lean
def common_sides(sight, row, code, end_row, dx, dy):
    """Return the sides on which a line that begins as in ``code`` ends at a boundary node; 0: none.

    ``row``: that of the boundary node at which the line begins, -1 if it is none.  A line along a
    slit is in the domain on both of its sides, but these are no neighbours.
    """
    if row >= 0:
        if dx * dx + dy * dy <= sight.slack * sight.slack:
            return LEFT + RIGHT if row == end_row else 0
        code = in_sectors(sight, row, dx, dy)
    return code & turned(in_sectors(sight, end_row, -dx, -dy))


@lean
def hides(ends, w, ax, ay, bx, by, side, slack):
    """Return whether wall w is between the points a and b.

    Where the line ab runs along a wall, with the domain on one ``side`` of it, another wall hides
    nothing if it only touches the line from the other side.
    """
    px, py, qx, qy = ends[w, 0], ends[w, 1], ends[w, 2], ends[w, 3]
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
def _set_shaft(x, feet, which, m, slack, shaft):
    """Fill the box around the points ``which``, and its change on the way to the box of their feet.

    ``shaft``: float64[8], lower and upper corner, with ``slack`` around, and their changes.
    """
    for d in range(2):
        low = foot_low = math.inf
        high = foot_high = -math.inf
        for a in range(m):
            at, foot = x[d, which[a]], feet[d, which[a]]
            low, high = min(low, at), max(high, at)
            foot_low, foot_high = min(foot_low, foot), max(foot_high, foot)
        shaft[d], shaft[2 + d] = low - slack, high + slack
        shaft[4 + d], shaft[6 + d] = foot_low - low, foot_high - high


@lean
def _meets_shaft(boxes, b, shaft):
    """Return whether box b meets a shaft: one of the boxes at the times 0 to 1."""
    begin, end = 0.0, 1.0
    for side in range(4):
        d = side % 2
        # The lower side must be below the upper side of the box, and the other way round.
        sign = 1.0 if side < 2 else -1.0
        room = sign * (boxes[b, 2 + d if side < 2 else d] - shaft[side])
        change = sign * shaft[4 + side]
        if change > 0.0:
            end = min(end, room / change)
        elif change < 0.0:
            begin = max(begin, room / change)
        elif room < 0.0:
            return False
    return begin <= end


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
def _without_crossing(sight, w, x, feet, sides, which, m):
    """Remove points from ``which`` that wall w hides from their feet; return the number left."""
    left = 0
    for a in range(m):
        i = which[a]
        if not hides(
            sight.ends, w, x[0, i], x[1, i], feet[0, i], feet[1, i], sides[i], sight.slack
        ):
            which[left] = i
            left += 1
    return left


@lean
def without_hidden(sight, x, feet, sides, which, m, stack, shaft, cached):
    """Remove points from ``which`` that are hidden from their feet; return the number left.

    Parameters
    ----------
    sight : Sight
    x, feet : float64[2, n]
    sides : int64[n]
        Sides of the lines from the points to their feet on which the domain is.
    which : int64[n]
        In/Out: the numbers of m points.
    m : int
    stack, shaft : int64[DEPTH], float64[8]
        Scratch.
    cached : int64[CACHED]
        In/Out: walls that hid points most recently, padded with -1.
    """
    for c in range(CACHED):
        if cached[c] >= 0 and m > 0:
            m = _without_crossing(sight, cached[c], x, feet, sides, which, m)
    if m == 0:
        return m
    _set_shaft(x, feet, which, m, sight.slack, shaft)
    n_walls, n_leaves = sight.ends.shape[0], sight.boxes.shape[0] // 2
    stack[0], size = 1, 1
    while size > 0:
        size -= 1
        b = stack[size]
        if not _meets_shaft(sight.boxes, b, shaft):
            continue
        if b < n_leaves:
            stack[size], stack[size + 1] = 2 * b, 2 * b + 1
            size += 2
            continue
        for w in range((b - n_leaves) * LEAF, min(n_walls, (b - n_leaves + 1) * LEAF)):
            if not _is_on_both_sides(sight.ends, w, shaft, sight.slack):
                continue
            left = _without_crossing(sight, w, x, feet, sides, which, m)
            if left < m:
                cached[w % CACHED] = w
                m = left
                if m == 0:
                    return m
    return m
