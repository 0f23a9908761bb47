"""Sizes at the corners of a plane domain, and the wedges in which paths continue from there.

A shortest path that arrives at a corner in direction d continues towards the obstacle only,
between d and the edge of the obstacle on that side; otherwise it could be shortened.  This *wedge*
is the cone of the corner.  If the obstacle lies straight ahead, no shortest path continues from
the corner.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.exact import push_children
from adaptsize._kernels.exact_items import set_vertices
from adaptsize._kernels.exact_plane import TIE, foot_of, sees
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.sight import common_side, in_sectors, is_hidden
from adaptsize._kernels.trees import DEPTH, LEAF

# Directions within this angle of a wall are along the wall.
_AHEAD = 1e-9


class Corners(NamedTuple):
    """Corners, where paths may bend, with their sizes and wedges."""

    rows: np.ndarray
    """int32[c]: rows in the sectors."""
    places: np.ndarray
    """float64[c, 2]"""
    edges: np.ndarray
    """float64[c, 4]: unit vectors along the two walls; the sector extends counterclockwise from
    the first to the second."""
    free: np.ndarray
    """bool[c]: paths may leave in all sectors of the node."""
    sizes: np.ndarray
    """float64[c]: Out."""
    turns: np.ndarray
    """bool[c, 2]: Out: whether paths continue to the right, to the left."""
    arrivals: np.ndarray
    """float64[c, 2, 2]: Out: the direction in which these paths arrive."""


@inner
def _offer(corners, c, value, dx, dy):
    """Update corner c with the size of a path that arrives in direction (dx, dy).

    Returns whether this changes the sizes that the corner allows elsewhere.
    """
    best = corners.sizes[c]
    if not value <= best * (1.0 + TIE):
        return False
    changed = value < best * (1.0 - TIE)
    if changed:
        corners.turns[c, 0] = corners.turns[c, 1] = False
    corners.sizes[c] = min(value, best)
    length = math.sqrt(dx * dx + dy * dy)
    if corners.free[c] or length == 0.0:
        return changed
    dx, dy = dx / length, dy / length
    edges = corners.edges[c]
    after_start, before_end = edges[0] * dy - edges[1] * dx, dx * edges[3] - dy * edges[2]
    # Neither where the obstacle lies straight ahead; both at the tip of a slit.
    if after_start >= -_AHEAD and before_end <= _AHEAD:
        along = after_start < 0.0 and edges[0] * dx + edges[1] * dy > 0.0
        x, y = (edges[0], edges[1]) if along else (dx, dy)
        changed = _turn(corners, c, 0, x, y) or changed
    if after_start <= _AHEAD and before_end >= -_AHEAD:
        along = before_end < 0.0 and edges[2] * dx + edges[3] * dy > 0.0
        x, y = (edges[2], edges[3]) if along else (dx, dy)
        changed = _turn(corners, c, 1, x, y) or changed
    return changed


@inner
def _turn(corners, c, side, dx, dy):
    """Let paths arriving in direction (dx, dy) continue to a side; return whether that is new."""
    arrival = corners.arrivals[c, side]
    turn = arrival[0] * dy - arrival[1] * dx
    if corners.turns[c, side] and not (turn > TIE if side == 0 else turn < -TIE):
        return False
    corners.turns[c, side] = True
    arrival[0], arrival[1] = dx, dy
    return True


@inner
def _in_wedge(corners, c, dx, dy, slack):
    """Return whether the direction (dx, dy) is in a wedge of corner c."""
    if corners.free[c]:
        return True
    for side in range(2):
        if not corners.turns[c, side]:
            continue
        ax, ay = corners.arrivals[c, side, 0], corners.arrivals[c, side, 1]
        if side == 0:
            sx, sy, ex, ey = corners.edges[c, 0], corners.edges[c, 1], ax, ay
        else:
            sx, sy, ex, ey = ax, ay, corners.edges[c, 2], corners.edges[c, 3]
        if sx * dy - sy * dx >= -slack and dx * ey - dy * ex >= -slack:
            return True
    return False


@kernel
def solve_corners(corners, seen, sight, g, axes):
    """Lower the sizes at corners and find their wedges (In/Out: corners).

    First, each corner is updated from all sources visible from it.  Then, as in Dijkstra's
    algorithm, each lowered corner updates the corners visible in its wedge, in order of size.

    Parameters
    ----------
    corners : Corners
    seen : Seen
        Sources.
    sight : Sight
    g : float64
    axes : tuple of length 2
    """
    entries = seen.entries
    m, n = entries.counts.shape[0], corners.rows.shape[0]
    slack = sight.walls.slack
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    other, box, work = np.empty(DEPTH, np.int64), np.empty(4), np.empty((4, 2))
    key, node = np.empty(n), np.empty(n, np.int32)
    place, heap_size = np.full(n, -1, np.int32), np.zeros(1, np.int64)
    done = np.zeros(n, np.bool_)
    for c in range(n):
        px, py = corners.places[c, 0], corners.places[c, 1]
        box[0], box[1], box[2], box[3] = px, py, px, py
        taken = False
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0:
            size -= 1
            b = stack[size]
            limit = corners.sizes[c] * (1.0 + 2.0 * TIE)
            if bound[size] >= limit:
                continue
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, limit, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                set_vertices(entries, k, axes, work)
                work[0, 0], work[0, 1] = px, py
                value, fx, fy = foot_of(entries, k, axes, work, g)
                if value <= corners.sizes[c] * (1.0 + TIE) and sees(
                    seen, k, fx, fy, px, py, corners.rows[c], sight, other
                ):
                    taken = _offer(corners, c, value, px - fx, py - fy) or taken
        if taken:
            push_or_decrease(key, node, place, heap_size, c, corners.sizes[c])
    while heap_size[0] > 0:
        c = pop(key, node, place, heap_size)
        done[c] = True
        if not (corners.free[c] or corners.turns[c, 0] or corners.turns[c, 1]):
            continue
        for to in range(n):
            if done[to]:
                continue
            dx = corners.places[to, 0] - corners.places[c, 0]
            dy = corners.places[to, 1] - corners.places[c, 1]
            value = corners.sizes[c] + g * math.sqrt(dx * dx + dy * dy)
            if not value <= corners.sizes[to] * (1.0 + TIE):
                continue
            if not _in_wedge(corners, c, dx, dy, slack):
                continue
            code = in_sectors(sight.sectors, corners.rows[c], dx, dy, slack)
            row, end = corners.rows[c], corners.rows[to]
            side = common_side(sight.sectors, row, code, end, dx, dy, slack)
            px, py = corners.places[c]
            if side == 0 or is_hidden(sight.walls, px, py, px + dx, py + dy, side, other):
                continue
            if _offer(corners, to, value, dx, dy):
                push_or_decrease(key, node, place, heap_size, to, value)
