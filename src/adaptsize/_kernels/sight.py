"""Visibility in a plane domain: walls, sectors and shafts.

*Walls* are the segments of the boundary.  Two points of the domain are visible from each other
unless

* the line between them leaves the domain at one of its ends: at a node of the boundary the
  domain fills one or more *sectors*, and the direction must lie in one of these; or
* a wall separates them: they lie strictly on either side of its line, and it meets
  theirs, possibly at an end of the wall: the path that bends there has the same length.

A point on the line of a wall, so each of its ends, is not hidden by it.  "Strictly" is by more
than ``slack``, a length: 1e-11 of the diagonal of the domain.

A *cone* contains the directions in which an entry acts.  It is given by float64[4], two unit
vectors s and e, counterclockwise, and by its kind: `ANY`, `NARROW` (up to pi) or `WIDE`.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner
from adaptsize._kernels.trees import LEAF

#: Kinds of cones.
ANY, NARROW, WIDE = 0, 1, 2

#: Sides of a line on which the domain lies.
LEFT, RIGHT = 1, 2

#: Largest number of walls in a shaft; if there are more, walls are searched point by point.
MANY = 192

# Half planes of a shaft: four of its box, up to four along tangents.
_PLANES = 8


class Walls(NamedTuple):
    """The boundary of a plane domain, with a tree over it (see trees.py)."""

    ends: np.ndarray
    """float64[w, 4]: start and end of each wall."""
    boxes: np.ndarray
    """float64[2 * n_leaves, 5]"""
    n_leaves: int
    slack: float


class Sectors(NamedTuple):
    """Sectors of the domain at nodes of the boundary."""

    first: np.ndarray
    """int32[b + 1]: the sectors of the b-th boundary node are ``first[b]`` to
    ``first[b + 1] - 1``."""
    cones: np.ndarray
    """float64[k, 4]"""
    kinds: np.ndarray
    """int8[k]"""


@inner
def is_in_cone(cones, kinds, k, dx, dy, slack):
    """Return whether the vector (dx, dy) ends in cone k, or beside it by less than ``slack``."""
    if kinds[k] == ANY:
        return True
    after_start = cones[k, 0] * dy - cones[k, 1] * dx >= -slack
    before_end = dx * cones[k, 3] - dy * cones[k, 2] >= -slack
    if kinds[k] == NARROW:
        return after_start and before_end
    return after_start or before_end


@inner
def side_in_cone(cones, kinds, k, dx, dy, slack):
    """Return how the vector (dx, dy) begins in cone k, as a sum of bits.

    0: outside by more than ``slack``; `LEFT` (`RIGHT`): along a side of the cone, which is to the
    left (right); both: inside.
    """
    if kinds[k] == ANY:
        return LEFT + RIGHT
    if not is_in_cone(cones, kinds, k, dx, dy, slack):
        return 0
    sx, sy, ex, ey = cones[k, 0], cones[k, 1], cones[k, 2], cones[k, 3]
    after_start, before_end = sx * dy - sy * dx, dx * ey - dy * ex
    inside = min(after_start, before_end) > slack
    if kinds[k] == WIDE:
        inside = max(after_start, before_end) > slack
    code = 0
    if abs(after_start) <= slack and sx * dx + sy * dy > 0.0:
        code += LEFT
    if abs(before_end) <= slack and ex * dx + ey * dy > 0.0:
        code += RIGHT
    return LEFT + RIGHT if inside or code == 0 else code


@inner
def in_sectors(sectors, i, dx, dy, slack):
    """Return how the vector (dx, dy) from node i begins in the domain, as `side_in_cone`.

    ``i`` is a row of the sectors, -1 inside.
    """
    if i < 0:
        return LEFT + RIGHT
    code = 0
    for k in range(sectors.first[i], sectors.first[i + 1]):
        code |= side_in_cone(sectors.cones, sectors.kinds, k, dx, dy, slack)
    return code


@inner
def common_side(sectors, i, code, j, dx, dy, slack):
    """Return the sides on which a line that begins at node i as in ``code`` ends at j; 0: none.

    A line along a slit is in the domain on both of its sides, but these are no neighbours.
    """
    if i >= 0 and j >= 0 and dx * dx + dy * dy <= slack * slack:
        return LEFT + RIGHT if i == j else 0
    end = in_sectors(sectors, j, -dx, -dy, slack)
    turned = (LEFT if end & RIGHT else 0) + (RIGHT if end & LEFT else 0)
    return code & turned


@inner
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


@inner
def fill_shaft(source, target, slack, planes):
    """Fill the half planes around the hull of two boxes, float64[4] each; return their number.

    ``planes`` float64[8, 3]: x is inside where ``p0 x + p1 y <= p2``.
    """
    for d in range(2):
        low, high = min(source[d], target[d]), max(source[2 + d], target[2 + d])
        planes[2 * d, d], planes[2 * d, 1 - d], planes[2 * d, 2] = 1.0, 0.0, high + slack
        planes[2 * d + 1, d], planes[2 * d + 1, 1 - d] = -1.0, 0.0
        planes[2 * d + 1, 2] = slack - low
    count = 4
    # The line through the same corner of both boxes, if its normal points to that corner.
    for corner in range(4):
        ix, iy = 2 * (corner % 2), 2 * (corner // 2)
        px, py = source[ix], source[1 + iy]
        dx, dy = target[ix] - px, target[1 + iy] - py
        nx, ny = -dy, dx
        right, up = ix > 0, iy > 0
        if (nx > 0.0) != right:
            nx, ny = -nx, -ny
        if nx == 0.0 or ny == 0.0 or (nx > 0.0) != right or (ny > 0.0) != up:
            continue
        length = math.sqrt(nx * nx + ny * ny)
        planes[count, 0], planes[count, 1] = nx / length, ny / length
        planes[count, 2] = (nx * px + ny * py) / length + slack
        count += 1
    return count


@inner
def _range_over(box, nx, ny):
    """Return the least and the largest n.x over a box float64[4]."""
    low = (nx * box[0] if nx > 0.0 else nx * box[2]) + (ny * box[1] if ny > 0.0 else ny * box[3])
    high = (nx * box[2] if nx > 0.0 else nx * box[0]) + (ny * box[3] if ny > 0.0 else ny * box[1])
    return low, high


@inner
def _wall_in_shaft(ends, w, source, target, planes, n_planes, slack):
    """Return 0 if wall w hides nothing in the shaft, 2 if it cuts it through, else 1."""
    px, py, qx, qy = ends[w, 0], ends[w, 1], ends[w, 2], ends[w, 3]
    beyond_p = beyond_q = False
    for k in range(n_planes):
        nx, ny, c = planes[k, 0], planes[k, 1], planes[k, 2]
        at_p, at_q = nx * px + ny * py, nx * qx + ny * qy
        if at_p > c and at_q > c:
            return 0
        beyond_p = beyond_p or at_p > c
        beyond_q = beyond_q or at_q > c
    nx, ny = py - qy, qx - px
    at = nx * px + ny * py
    margin = slack * math.sqrt(nx * nx + ny * ny)
    low_s, high_s = _range_over(source, nx, ny)
    low_t, high_t = _range_over(target, nx, ny)
    if max(high_s, high_t) <= at + margin or min(low_s, low_t) >= at - margin:
        return 0
    between = (high_s < at - margin and low_t > at + margin) or (
        high_t < at - margin and low_s > at + margin
    )
    # Each end is beyond a plane towards which the wall runs; the other end is not.
    return 2 if between and beyond_p and beyond_q else 1


@inner
def find_walls(walls, source, target, planes, stack, found):
    """List the walls that may hide a point of one box from a point of another.

    Parameters
    ----------
    walls : Walls
    source, target : float64[4]
        Boxes.
    planes, stack : float64[8, 3], int64[DEPTH]
        Scratch.
    found : int32[MANY]
        Out.

    Returns
    -------
    int
        Their number; -1 if one wall hides all points from each other; MANY + 1 if there are more.
    """
    n_planes = fill_shaft(source, target, walls.slack, planes)
    boxes = walls.boxes
    m = walls.ends.shape[0]
    stack[0], size, count = 1, 1, 0
    while size > 0:
        size -= 1
        b = stack[size]
        inside = True
        for k in range(n_planes):
            nx, ny = planes[k, 0], planes[k, 1]
            low = (nx * boxes[b, 0] if nx > 0.0 else nx * boxes[b, 2]) if nx != 0.0 else 0.0
            if ny != 0.0:
                low += ny * boxes[b, 1] if ny > 0.0 else ny * boxes[b, 3]
            if low > planes[k, 2]:
                inside = False
                break
        if not inside:
            continue
        if b < walls.n_leaves:
            stack[size], stack[size + 1] = 2 * b, 2 * b + 1
            size += 2
            continue
        leaf = b - walls.n_leaves
        for w in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
            kind = _wall_in_shaft(walls.ends, w, source, target, planes, n_planes, walls.slack)
            if kind == 2:
                return -1
            if kind == 1:
                if count == found.shape[0]:
                    return count + 1
                found[count] = w
                count += 1
    return count


@inner
def is_hidden(walls, ax, ay, bx, by, side, stack):
    """Return whether any wall is between the points a and b; ``stack`` int64[DEPTH] is scratch."""
    slack = walls.slack
    low_x, high_x = min(ax, bx) - slack, max(ax, bx) + slack
    low_y, high_y = min(ay, by) - slack, max(ay, by) + slack
    nx, ny = ay - by, bx - ax
    at = nx * ax + ny * ay
    margin = slack * math.sqrt(nx * nx + ny * ny)
    boxes = walls.boxes
    m = walls.ends.shape[0]
    stack[0], size = 1, 1
    while size > 0:
        size -= 1
        b = stack[size]
        if boxes[b, 0] > high_x or boxes[b, 2] < low_x:
            continue
        if boxes[b, 1] > high_y or boxes[b, 3] < low_y:
            continue
        low, high = _range_over(boxes[b], nx, ny)
        if low > at + margin or high < at - margin:
            continue
        if b < walls.n_leaves:
            stack[size], stack[size + 1] = 2 * b, 2 * b + 1
            size += 2
            continue
        leaf = b - walls.n_leaves
        for w in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
            if hides(walls.ends, w, ax, ay, bx, by, side, slack):
                return True
    return False
