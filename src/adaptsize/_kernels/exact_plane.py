"""The limited size in a plane domain that is not convex: the minimum over visible sources.

The shortest path between two points bends only at corners of the boundary where the domain fills
more than a half plane, so that

    h(x) = min over the sources and corners z that x sees of  U(z) + g |x - z|,

where U is the bound of a source or the size at a corner.  Every value belongs to a path in the
domain, so that no size is too small.

A shortest path that arrives at a corner in direction d continues towards the obstacle only,
between d and the edge of the obstacle on that side; otherwise it could be shortened.  This *wedge*
is the cone of the corner.  If the obstacle lies straight ahead, no shortest path continues from
the corner.  If several paths to a corner are equally short, any of them decides: what one of
them rules out is not shortest for the others, too, as both have the same length.

The tables of entries (see exact.py) have more columns: the cone in which the entry acts, its
row in the sectors if it is a boundary node, else -1, and 1 if it is a corner, else 0.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact import BLOCK, begin, fill_values, largest, least_allowed, least_leaf
from adaptsize._kernels.sight import (
    ANY,
    LEFT,
    N_RECENT,
    NARROW,
    RIGHT,
    WIDE,
    common_sides,
    cone_in,
    side_in_cone,
    turned,
    without_hidden,
)
from adaptsize._kernels.trees import items_of_leaf

#: Columns of a table.
CONE, KIND, ROW, CORNER, COLUMNS = 6, 10, 11, 12, 13


@lean
def _may_serve(table, k, axes, box, g, worst, slack, edges):
    """Return whether entry k may lower a size below ``worst`` in a box: near, and in its cone."""
    if least_allowed(table, k, axes, box, g, edges) >= worst:
        return False
    if table[k, KIND] != NARROW or table[k, 5] < math.inf:
        return True
    left, right = box[0] - table[k, 0], box[2] - table[k, 0]
    low, high = box[1] - table[k, 1], box[3] - table[k, 1]
    sx, sy, ex, ey = table[k, CONE], table[k, CONE + 1], table[k, CONE + 2], table[k, CONE + 3]
    # The largest of both cross products over the box.
    after_start = max(sx * low, sx * high) + max(-sy * left, -sy * right)
    before_end = max(ey * left, ey * right) + max(-ex * low, -ex * high)
    return min(after_start, before_end) >= -slack


@lean
def _try_entry(table, k, axes, count, worst, g, sight, edges, block, rays):
    """Lower the sizes h of the points of a block that see entry k; return the largest size."""
    x, h, values, which = block.x, block.h, block.values, rays.which
    origins, sides, rows = rays.origins, rays.sides, rays.rows
    fill_values(table, k, axes, x, count, g, values, block.share, edges, None)
    # A corner does not lower itself.
    least = table[k, 4] if table[k, CORNER] > 0.0 else -math.inf
    row, m = int(table[k, ROW]), np.int64(0)  # callees would be compiled for a literal, too
    cone = cone_in(table, k, CONE)
    for i in range(count):
        if not least < values[i] < h[i]:
            continue
        fx, fy = table[k, 0], table[k, 1]
        if edges is not None and table[k, 5] < math.inf:
            fx += block.share[i] * (table[k, 2] - fx)
            fy += block.share[i] * (table[k, 3] - fy)
        direction = (x[0, i] - fx, x[1, i] - fy)
        side = side_in_cone(cone, direction, sight.slack)
        if side == 0:
            continue
        if rows[i] >= 0:
            side = common_sides(sight, row, side, rows[i], direction)
            if side == 0:
                continue
        else:
            side = LEFT + RIGHT
        origins[0, i], origins[1, i], sides[i], which[m] = fx, fy, turned(side), i
        m += 1
    if m > 0:
        m = without_hidden(sight, x, rays, m)
    for a in range(m):
        i = which[a]
        h[i], block.by[i] = values[i], k
    return largest(h, count) if m > 0 else worst


@lean
def _is_recent(recent, k):
    found = False
    for r in range(N_RECENT):
        found |= recent[r] == k
    return found


@lean_kernel
def lower_seen(points, axes, order, span, tree, g, found, edges, on_wall, sight, block, rays):
    """Lower the sizes of points to the minimum that the visible entries allow.

    Parameters
    ----------
    points, axes, order, span, tree, g, found, edges, block
        As in `exact.lower_sizes`, in the plane.
    on_wall : int32[n]
        Row in the sectors for points that are boundary nodes, else -1.
    sight : Sight
    rays : Rays
    """
    (table, boxes), (sizes, source) = tree, found
    box, h, by, stack = block.box, block.h, block.by, block.stack
    recent, slack = rays.recent, sight.slack
    m = table.shape[0]
    for start in range(span[0], span[1], BLOCK):
        count = min(BLOCK, span[1] - start)
        worst = begin(points, axes, order[start : start + count], sizes, block)
        for i in range(count):
            rays.rows[i] = on_wall[order[start + i]]
        for r in range(N_RECENT):
            k = recent[r]
            if k >= 0 and _may_serve(table, k, axes, box, g, worst, slack, edges):
                worst = _try_entry(table, k, axes, count, worst, g, sight, edges, block, rays)
        stack.box[0], stack.bound[0], height = 1, -math.inf, np.int64(1)
        while height > 0:
            leaf, height = least_leaf(boxes, stack, height, worst, (axes, box, g))
            for k in range(*items_of_leaf(leaf, m)):
                if not _is_recent(recent, k) and _may_serve(
                    table, k, axes, box, g, worst, slack, edges
                ):
                    worst = _try_entry(table, k, axes, count, worst, g, sight, edges, block, rays)
        n_recent = 0
        for r in range(N_RECENT):
            recent[r] = -1
        for i in range(count):
            if by[i] >= 0:
                sizes[order[start + i]] = h[i]
                source[order[start + i]] = by[i]
                if n_recent < N_RECENT and not _is_recent(recent, by[i]):
                    recent[n_recent] = by[i]
                    n_recent += 1


@lean
def set_wedge(table, k, walls, dx, dy, slack):
    """Set the cone of corner k, at which a path arrives in direction (dx, dy), to its wedge.

    The corner hides what lies straight ahead from the start of the path, also what is up to
    ``slack`` off.  So the wedge begins earlier, by a few times the angle of ``slack`` at the
    distance of the nearest node, before or behind the corner, and a path that points into the
    obstacle by no more than this angle is along the wall.

    ``walls``: float64[c, 5], as in `solve_corners`.  Returns whether there is a wedge.
    """
    if table[k, KIND] == ANY:  # paths may leave in all sectors of the node
        return True
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return False
    dx, dy = dx / length, dy / length
    sx, sy, ex, ey = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
    nil = 4.0 * slack / min(length, walls[k, 4])
    after_start, before_end = sx * dy - sy * dx, dx * ey - dy * ex
    to_right = after_start >= -nil and before_end <= nil
    to_left = after_start <= nil and before_end >= -nil
    if not (to_right or to_left):
        return False  # the obstacle lies straight ahead
    if to_right and to_left:
        if sx * ex + sy * ey > 0.0:  # paths along a slit continue in the whole sector at its tip
            table[k, KIND] = WIDE
        else:  # along a wall that is nearly straight
            to_right = sx * dx + sy * dy > 0.0
            to_left = not to_right
    if not (to_right and to_left):
        table[k, KIND] = NARROW
        if to_right:
            dx, dy = dx - nil * dy, dy + nil * dx
            along = sx * dy - sy * dx < 0.0 and sx * dx + sy * dy > 0.0
            ex, ey = (sx, sy) if along else (dx, dy)
        else:
            dx, dy = dx + nil * dy, dy - nil * dx
            along = dx * ey - dy * ex < 0.0 and ex * dx + ey * dy > 0.0
            sx, sy = (ex, ey) if along else (dx, dy)
    table[k, CONE], table[k, CONE + 1], table[k, CONE + 2], table[k, CONE + 3] = sx, sy, ex, ey
    return True


@lean_kernel
def set_wedges(table, walls, arrivals, slack, serves):
    """Set the cones of all corners (Out: serves); the arguments are as in `solve_corners`."""
    for c in range(table.shape[0]):
        serves[c] = set_wedge(table, c, walls, arrivals[c, 0], arrivals[c, 1], slack)


@lean_kernel
def solve_corners(axes, corners, state, g, edges, sight, block, rays):
    """Propagate the sizes of corners to other corners, in order of size, as Dijkstra's algorithm.

    Parameters
    ----------
    axes : tuple of length 2
    corners : tuple
        ``places`` float64[c, 2] along a Morton curve; ``order`` int32[c], 0 to c - 1; ``table``
        float64[c, COLUMNS], In/Out: the corners as entries, of which those of the kind ANY are
        left in all sectors; ``walls`` float64[c, 5]: unit vectors along the two walls of each
        corner, and the length of the shortest edge there.  The sector extends counterclockwise
        from the first wall to the second.
    state : tuple
        In/Out: ``sizes`` float64[c]; ``arrivals`` float64[c, 2], the directions in which paths
        arrive; ``waiting`` bool[c], corners that have been lowered and not been propagated yet;
        ``serves`` bool[c], set for propagated corners: whether paths continue from there.
    g, edges, sight, block, rays
        As in `lower_seen`.
    """
    (places, order, table, walls), (sizes, arrivals, waiting, serves) = corners, state
    n = sizes.shape[0]
    while True:
        c, least = np.int64(-1), math.inf
        for i in range(n):
            if waiting[i] and sizes[i] < least:
                c, least = i, sizes[i]
        if c < 0:
            return
        waiting[c] = False
        table[c, 4] = least
        serves[c] = set_wedge(table, c, walls, arrivals[c, 0], arrivals[c, 1], sight.slack)
        if not serves[c]:
            continue
        for start in range(0, n, BLOCK):
            count = min(BLOCK, n - start)
            worst = begin(places, axes, order[start : start + count], sizes, block)
            for i in range(count):
                rays.rows[i] = int(table[start + i, ROW])
            if not _may_serve(table, c, axes, block.box, g, worst, sight.slack, edges):
                continue
            _try_entry(table, c, axes, count, worst, g, sight, edges, block, rays)
            for i in range(count):
                if block.by[i] >= 0:
                    to = start + i
                    sizes[to], waiting[to] = block.h[i], True
                    arrivals[to, 0] = table[to, 0] - table[c, 0]
                    arrivals[to, 1] = table[to, 1] - table[c, 1]
