"""The limited size in a plane domain that is not convex: the minimum over visible sources.

The shortest path between two points bends only at corners of the boundary where the domain fills
more than a half plane, so that

    h(x) = min over the sources and corners z that x sees of  U(z) + g |x - z|,

where U is the bound of a source or the size at a corner.  Every value belongs to a path in the
domain, so that no size is too small.

Corners act only on the points in their *wedges* (see exact_corners.py).
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.exact import BLOCK, Entries, gather_block, least_allowed, push_children
from adaptsize._kernels.exact_items import allowed, set_vertices
from adaptsize._kernels.sight import (
    LEFT,
    MANY,
    NARROW,
    RIGHT,
    Sectors,
    Walls,
    common_side,
    find_walls,
    hides,
    in_sectors,
    is_hidden,
    is_in_cone,
    side_in_cone,
)
from adaptsize._kernels.trees import DEPTH, LEAF

#: Two paths to a corner are equally short if they differ by less than this share.
TIE = 1e-12


# Number of walls that hide dominating entries before a node is accepted as a survivor.
_PATIENCE = 12

# Number of entries that lowered sizes in one block and are tested first in the next.
_RECENT = 8


class Sight(NamedTuple):
    """Data for visibility in a plane domain."""

    walls: Walls
    sectors: Sectors


class Seen(NamedTuple):
    """Entries with the cones in which they act."""

    entries: Entries
    cones: np.ndarray
    """float64[m, 4]"""
    kinds: np.ndarray
    """int8[m]"""
    rows: np.ndarray
    """int32[m]: row of a boundary node in the sectors, -1 for others."""
    is_corner: np.ndarray
    """bool[m]: whether the entry is a bend of paths; it is then no source for the corner itself."""


@inner
def foot_of(entries, k, axes, work, g):
    """Return the size that entry k allows at work[0], and the minimising point.

    The size is inf if that point is an end of an edge: the node is a separate entry, or dominated.
    """
    value, t, _ = allowed(entries, k, axes, work, g, None)
    fx, fy = work[1, 0], work[1, 1]
    if entries.counts[k] == 2:
        if not 0.0 < t < 1.0:
            value = math.inf
        fx += t * (work[2, 0] - fx)
        fy += t * (work[2, 1] - fy)
    return value, fx, fy


@inner
def _sides(seen, k, dx, dy, row, sight):
    """Return on which sides of a line the domain is; 0: none.

    The line is from entry k by (dx, dy) to the node of the boundary of that row in the sectors.
    """
    slack = sight.walls.slack
    if seen.rows[k] >= 0:
        code = in_sectors(sight.sectors, seen.rows[k], dx, dy, slack)
    else:
        code = side_in_cone(seen.cones, seen.kinds, k, dx, dy, slack)
    return common_side(sight.sectors, seen.rows[k], code, row, dx, dy, slack)


@inner
def _may_serve(seen, k, box, g, worst, slack):
    """Return whether entry k may lower a size below ``worst`` in a box: near, and in its cone."""
    entries = seen.entries
    if least_allowed(entries, k, (0, 0), box, g) >= worst:
        return False
    if seen.kinds[k] != NARROW or entries.counts[k] > 1:
        return True
    left, right = box[0] - entries.places[k, 0, 0], box[2] - entries.places[k, 0, 0]
    low, high = box[1] - entries.places[k, 0, 1], box[3] - entries.places[k, 0, 1]
    sx, sy, ex, ey = seen.cones[k, 0], seen.cones[k, 1], seen.cones[k, 2], seen.cones[k, 3]
    # The largest of both cross products over the box.
    after_start = (sx * high if sx > 0.0 else sx * low) - (sy * left if sy > 0.0 else sy * right)
    before_end = (ey * right if ey > 0.0 else ey * left) - (ex * low if ex > 0.0 else ex * high)
    return after_start >= -slack and before_end >= -slack


@inner
def _fill_values(x, count, work, size, g, h, values):
    """Fill the sizes a node at work[1] allows in a block; return whether any is below h."""
    sx, sy = work[1, 0], work[1, 1]
    lowers = False
    for i in range(count):
        dx, dy = x[0, i] - sx, x[1, i] - sy
        values[i] = size + g * math.sqrt(dx * dx + dy * dy)
        lowers |= values[i] < h[i]
    return lowers


@inner
def _try_entry(seen, k, x, node, count, axes, g, sight, h, by, room):
    """Lower the sizes h of the points of a block from which entry k is visible.

    ``room``: scratch (values, feet, wanted, sides, boxes, planes, stack, found, work).
    """
    values, feet, wanted, sides, boxes, planes, stack, found, work = room
    entries, slack = seen.entries, sight.walls.slack
    cones, kinds = seen.cones, seen.kinds  # passing the tuple would count all of its references
    set_vertices(entries, k, axes, work)
    is_point = entries.counts[k] == 1
    if is_point and not _fill_values(x, count, work, entries.sizes[k, 0], g, h, values):
        return False
    n_wanted = 0
    for i in range(count):
        fx, fy, value = work[1, 0], work[1, 1], values[i]
        if not is_point:
            work[0, 0], work[0, 1] = x[0, i], x[1, i]
            value, fx, fy = foot_of(entries, k, axes, work, g)
        if not value < h[i] or (seen.is_corner[k] and value == entries.sizes[k, 0]):
            continue
        dx, dy = x[0, i] - fx, x[1, i] - fy
        if not is_in_cone(cones, kinds, k, dx, dy, slack):
            continue
        side = LEFT + RIGHT
        if node[i] >= 0:
            side = _sides(seen, k, dx, dy, node[i], sight)
            if side == 0:
                continue
            side = (LEFT + RIGHT) - side if side != LEFT + RIGHT else side  # seen from the node
        sides[n_wanted] = side
        values[n_wanted], feet[n_wanted, 0], feet[n_wanted, 1] = value, fx, fy
        wanted[n_wanted] = i
        n_wanted += 1
    if n_wanted == 0:
        return False
    source, target = boxes[0], boxes[1]
    for d in range(2):
        source[d] = source[2 + d] = feet[0, d]
        target[d] = target[2 + d] = x[d, wanted[0]]
        for a in range(1, n_wanted):
            source[d], source[2 + d] = min(source[d], feet[a, d]), max(source[2 + d], feet[a, d])
            at = x[d, wanted[a]]
            target[d], target[2 + d] = min(target[d], at), max(target[2 + d], at)
    n_walls = find_walls(sight.walls, source, target, planes, stack, found)
    if n_walls < 0:
        return False
    lowered = False
    for a in range(n_wanted):
        i, side = wanted[a], sides[a]
        px, py, fx, fy = x[0, i], x[1, i], feet[a, 0], feet[a, 1]
        hidden = False
        if n_walls > MANY:
            hidden = is_hidden(sight.walls, px, py, fx, fy, side, stack)
        else:
            for f in range(n_walls):
                w = found[f]
                if hides(sight.walls.ends, w, px, py, fx, fy, side, slack):
                    hidden = True
                    found[f], found[0] = found[0], w  # likely to hide the next point, too
                    break
        if not hidden:
            h[i], by[i] = values[a], k
            lowered = True
    return lowered


@inner
def _largest(h, count):
    """Return the largest of the first sizes."""
    worst = -math.inf
    for i in range(count):
        worst = max(worst, h[i])
    return worst


@inner
def _is_among(numbers, count, k):
    """Return whether k is one of the first numbers."""
    found = False
    for i in range(count):
        found |= numbers[i] == k
    return found


@kernel
def lower_seen(points, axes, order, first, last, seen, sight, g, sizes, source, on_wall):
    """Lower the sizes of points to the minimum that the visible entries allow.

    Parameters
    ----------
    points : float64[n, 2]
    axes : tuple of length 2
    order : int32[n]
        The points along a Morton curve.
    first, last : int
        The part of ``order`` to process; ``first`` a multiple of BLOCK.
    seen : Seen
        Nodes and edges.
    sight : Sight
    g : float64
    sizes : float64[n]
        In/Out.
    source : int32[n]
        In/Out: the entry where a size was lowered.
    on_wall : int32[n]
        Row in the sectors for points that are boundary nodes, else -1.
    """
    entries = seen.entries
    m = entries.counts.shape[0]
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    box, x, h = np.empty(4), np.empty((2, BLOCK)), np.empty(BLOCK)
    by, node = np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int32)
    room = (
        np.empty(BLOCK),
        np.empty((BLOCK, 2)),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK, np.int64),
        np.empty((2, 4)),
        np.empty((8, 3)),
        np.empty(DEPTH, np.int64),
        np.empty(MANY, np.int32),
        np.empty((4, 2)),
    )
    recent = np.empty(_RECENT, np.int64)  # as all numbers of entries: each type is compiled anew
    n_recent = 0
    slack = sight.walls.slack
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        count = stop - start
        gather_block(points, axes, order, start, stop, x, box)
        for i in range(count):
            h[i], by[i] = sizes[order[start + i]], -1
            node[i] = on_wall[order[start + i]]
        worst = _largest(h, count)
        for r in range(n_recent):
            if _may_serve(seen, recent[r], box, g, worst, slack) and _try_entry(
                seen, recent[r], x, node, count, axes, g, sight, h, by, room
            ):
                worst = _largest(h, count)
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0:
            size -= 1
            b = stack[size]
            if bound[size] >= worst:
                continue
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, worst, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                if _is_among(recent, n_recent, k) or not _may_serve(seen, k, box, g, worst, slack):
                    continue
                if _try_entry(seen, k, x, node, count, axes, g, sight, h, by, room):
                    worst = _largest(h, count)
        n_recent = 0
        for i in range(count):
            if by[i] < 0:
                continue
            sizes[order[start + i]] = h[i]
            source[order[start + i]] = by[i]
            if n_recent < _RECENT and not _is_among(recent, n_recent, by[i]):
                recent[n_recent] = by[i]
                n_recent += 1


@inner
def sees(seen, k, fx, fy, px, py, row, sight, stack):
    """Return whether a point, of a row of sectors or -1, sees the point (fx, fy) of entry k."""
    dx, dy = px - fx, py - fy
    if not is_in_cone(seen.cones, seen.kinds, k, dx, dy, sight.walls.slack):
        return False
    side = LEFT + RIGHT if row < 0 else _sides(seen, k, dx, dy, row, sight)
    return side != 0 and not is_hidden(sight.walls, fx, fy, px, py, side, stack)


@kernel
def find_seen_survivors(points, axes, order, first, last, seen, sight, g, sizes, on_wall, survives):
    """Find the nodes that keep their bound: no visible entry allows less there.

    If many entries are hidden from a node, it is kept without further tests, which costs time only.

    Parameters
    ----------
    points, axes, order, first, last, seen, sight, g, on_wall
        As in `lower_seen`; the entries are nodes.
    sizes : float64[n]
        Bounds of ``points``.
    survives : bool[n]
        Out, for the points in ``order``.
    """
    entries = seen.entries
    m = entries.counts.shape[0]
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    other, box = np.empty(DEPTH, np.int64), np.empty(4)
    for p in range(first, last):
        i = order[p]
        px, py, size_here = points[i, 0], points[i, 1], sizes[i]
        box[0], box[1], box[2], box[3] = px, py, px, py
        survives[i] = True
        hidden = 0
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0 and survives[i] and hidden < _PATIENCE:
            size -= 1
            b = stack[size]
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, size_here, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                fx, fy = entries.places[k, 0, 0], entries.places[k, 0, 1]
                away = math.sqrt((px - fx) ** 2 + (py - fy) ** 2)
                if entries.sizes[k, 0] + g * away < size_here:
                    if sees(seen, k, fx, fy, px, py, on_wall[i], sight, other):
                        survives[i] = False
                        break
                    hidden += 1
