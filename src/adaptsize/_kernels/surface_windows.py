"""Shortest paths on triangles in space, by windows (continuous Dijkstra algorithm).

A *window* is an interval of an edge through which straight paths from one *root* enter a triangle.
The root, with the size there, lies at S behind the edge, in the plane of the triangle: everything
on the way is unfolded (Mitchell, Mount and Papadimitriou, The discrete geodesic problem, 1987).  A
root is a point, or an edge on which the size is linear: all paths from this have one direction d,
and S = -d.  So in the frame of the edge, the size at a point p is

    U + |p - S|  (root: a point)    or    U - S . p  (root: an edge),

where lengths are multiplied by g.  Windows are processed in the order of their smallest size.  One
that enters a triangle offers a size to the opposite node, along a straight line if this passes
through the window, else around the end of the window, which is a path, too.  It leaves through the
two other edges, into all triangles beyond these.  At saddles and at reflex nodes of the boundary,
shortest paths bend: such a node becomes a root, with windows only in directions that differ by
at least 180 degrees from that of its path, measured either way around the node.

A window ends where a node of its edge allows less, by a path along the edge (Xin and Wang,
Improving Chen and Han's algorithm, 2009).

Behind a node without curvature that has divided a window, both parts have the same S again.  Where
they touch on an edge, they become one window if neither has been processed.

Beyond a number of windows, *narrow* ones are dropped, after they have offered a size.  Then every
node becomes a root when it gets its size.  So sizes are still those of paths, which now may bend
at any node, and those up to the least size in a dropped window are exact.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.surface_fans import (
    COMPLEX,
    FLAT,
    SADDLE,
    cross,
    others_of,
    place_in,
)

#: Places in ``Front.tally``.
QUEUED, USED, FREE, DONE = range(4)

#: What `propagate` returns: all is done, the arrays are full, the number of windows is reached.
FINISHED, FULL, SPENT = range(3)

#: Width of a window, relative to its edge, that is rounding.
_NOTHING = 1e-14

#: Distance of roots, relative to their distance from the edge, below which they are the same.
_SAME = 1e-13

#: The side of a window that has been joined to another one, or processed.
_GONE = np.int32(-(2**31))

#: Factor of lengths from the end of a window, so that roots go first that lie there.
_LATER = 1.0 + 1e-14

#: Angle (radians) below which a direction is that of an edge.
_GRAZING = 1e-9


class Front(NamedTuple):
    """Sizes, and what is propagated.

    Parameters
    ----------
    h : float64[n]
        Sizes.
    root : int32[n]
        The last root of the path to each node: -1 if it keeps its bound, a node, from n on a point
        between the nodes, and from ``Mode.first_wave`` on a side.
    corner, turn : int32[n], float64[n]
        For nodes at which paths bend: the corner through which the path arrives, and the angle of
        its direction from the edge to the smaller other node of the triangle.
    sent : float64[n]
        The size with which each node has been a root; inf if it has not.
    rows : float64[w, 5]
        Windows: the interval on the edge, S, and U.
    where : int32[w, 2]
        The side by which each window enters a triangle, -1 - side if it is narrow and goes no
        further; and its root.
    free : int32[w]
        Rows that are no longer used.
    last : int32[3 * m]
        The window that was queued last for each side, -1 if there is none.
    key, item : float64[q], int32[q]
        A heap with four children per entry; window k is k, node i is -1 - i.
    tally : int64[4]
        Entries in the heap, rows used or free, free rows, windows processed.
    dropped : float64[1]
        Least size of the narrow windows that were dropped.
    """

    h: np.ndarray
    root: np.ndarray
    corner: np.ndarray
    turn: np.ndarray
    sent: np.ndarray
    rows: np.ndarray
    where: np.ndarray
    free: np.ndarray
    last: np.ndarray
    key: np.ndarray
    item: np.ndarray
    tally: np.ndarray
    dropped: np.ndarray


class Mode(NamedTuple):
    """What is done.

    Parameters
    ----------
    first_wave : int
        Roots from this number on are edges.
    steep : bool[m]
        Triangles into which their nodes act by their own bounds.
    narrow : float
        Windows that are narrower than this share of their edge are dropped; 0 if none are.
    """

    first_wave: int
    steep: np.ndarray
    narrow: float


@lean
def _queue(front, key, item):
    """Put an entry into the heap."""
    keys, items, here = front.key, front.item, front.tally[QUEUED]
    front.tally[QUEUED] += 1
    while here > 0:
        parent = (here - 1) >> 2
        if keys[parent] <= key:
            break
        keys[here], items[here] = keys[parent], items[parent]
        here = parent
    keys[here], items[here] = key, item


@lean
def _take(front):
    """Take the entry of smallest key out of the heap; return key and item."""
    keys, items = front.key, front.item
    least, first = keys[0], items[0]
    front.tally[QUEUED] -= 1
    n = front.tally[QUEUED]
    key, item, here = keys[n], items[n], 0
    while True:
        child = 4 * here + 1
        if child >= n:
            break
        best = child
        for other in range(child + 1, min(child + 4, n)):
            if keys[other] < keys[best]:
                best = other
        if keys[best] >= key:
            break
        keys[here], items[here] = keys[best], items[best]
        here = best
    keys[here], items[here] = key, item
    return least, first


@lean
def _size_at(source, is_wave, x, depth):
    """Return the size from a root (S, U) at (x, -depth), in front of the edge."""
    sx, sy, size = source
    if is_wave:
        return size - sx * x + sy * depth
    return size + math.sqrt((x - sx) ** 2 + (sy + depth) ** 2)


@lean
def _better_below(sx, sy, size, is_wave, value):
    """Return the x below which the node at 0, with a value, allows less on the edge than a root.

    With D the value less U, this holds where x + D < |S - x|, hence below (S^2 - D^2) / (2 (D +
    S_x)).
    """
    more = value - size
    if is_wave:
        if 1.0 + sx > 0.0:
            return -more / (1.0 + sx)
        return -1.0 if more >= 0.0 else math.inf
    square = sx * sx + sy * sy
    if square <= more * more:
        return -1.0 if more > 0.0 else math.inf
    rise = more + sx
    return 0.5 * (square - more * more) / rise if rise > 0.0 else math.inf


@lean
def _cut(surface, front, side, ends, source, is_wave):
    """Return the part of a window that no node of its edge undercuts."""
    t, length = side // 3, surface.length[side]
    low, high = others_of(side % 3)
    sx, sy, size = source
    first = _better_below(sx, sy, size, is_wave, front.h[surface.cells[t, low]])
    if is_wave:  # from the other end, with the size there
        size, mirrored = size - sx * length, -sx
    else:
        mirrored = length - sx
    last = length - _better_below(mirrored, sy, size, is_wave, front.h[surface.cells[t, high]])
    return max(ends[0], first), min(ends[1], last)


@lean
def _least_in(ends, source, is_wave):
    """Return the smallest size in a window."""
    if is_wave:
        x = ends[1] if source[0] > 0.0 else ends[0]
    else:
        x = min(max(source[0], ends[0]), ends[1])
    return _size_at(source, is_wave, x, 0.0)


@lean
def _store(front, side, ends, source, root, key):
    """Queue a window that enters a triangle by a side."""
    if front.tally[FREE] > 0:
        front.tally[FREE] -= 1
        slot = np.int64(front.free[front.tally[FREE]])
    else:
        slot = front.tally[USED]
        front.tally[USED] += 1
    rows = front.rows
    rows[slot, 0], rows[slot, 1] = ends
    rows[slot, 2], rows[slot, 3], rows[slot, 4] = source
    front.where[slot, 0], front.where[slot, 1] = side, root
    front.last[side if side >= 0 else -1 - side] = slot
    _queue(front, key, slot)


@lean
def _joined(front, side, ends, source, root, slack):
    """Return the window that was queued last for a side if it touches another one, else -1."""
    slot = np.int64(front.last[side])
    if slot < 0 or front.where[slot, 0] != side or front.where[slot, 1] != root:
        return -1
    rows = front.rows
    away = max(abs(rows[slot, 2] - source[0]), abs(rows[slot, 3] - source[1]))
    away = max(away, abs(rows[slot, 4] - source[2]))
    gap = max(rows[slot, 0] - ends[1], ends[0] - rows[slot, 1])
    return slot if max(away, gap) <= slack else -1


@lean
def _offer(surface, front, mode, corner, value, root, turn):
    """Lower the size at the node of a corner to a value, and queue it if it may be a root."""
    node = np.int64(surface.cells[corner // 3, corner % 3])
    if not value < front.h[node]:
        return
    front.h[node], front.root[node] = value, root
    front.corner[node], front.turn[node] = corner, turn
    if surface.kind[node] != FLAT or mode.narrow > 0.0:
        _queue(front, value, -1 - node)


@lean
def _reach(surface, front, mode, side, ends, source, root):
    """Offer a size to the node opposite to a window; return where the line to it meets the edge."""
    x, y, sx, sy = surface.apex[side, 0], surface.apex[side, 1], source[0], source[1]
    is_wave = root >= mode.first_wave
    at = x + sx * (y / sy) if is_wave else sx + (x - sx) * (sy / (sy + y))
    node = np.int64(surface.cells[side // 3, side % 3])
    value = _size_at(source, is_wave, x, y)
    if value < front.h[node]:
        through = min(max(at, ends[0]), ends[1])
        if through != at:  # around the end
            value = _size_at(source, is_wave, through, 0.0)
            value += _LATER * math.sqrt((x - through) ** 2 + y * y)
        if value < front.h[node]:
            turn = 0.0
            if surface.kind[node] != FLAT:
                turn = math.atan2(through * y, y * y - x * (through - x))
            _offer(surface, front, mode, side, value, root, turn)
    return at


@lean
def _leave(surface, front, mode, side, ends, source, root):
    """Queue a window that leaves a triangle by a side, in all triangles beyond."""
    other = surface.beyond[side]
    if other == side or not source[1] > 0.0:
        return
    is_wave = root >= mode.first_wave
    ends = _cut(surface, front, side, ends, source, is_wave)
    width = ends[1] - ends[0]
    if not width > _NOTHING * surface.length[side]:
        return
    key = _least_in(ends, source, is_wave)
    is_narrow = width <= mode.narrow * surface.length[side]
    if is_narrow:
        front.dropped[0] = min(front.dropped[0], key)
    slack = _SAME * (abs(source[0]) + source[1] + surface.length[side])
    while other != side:
        before = -1 if is_narrow else _joined(front, other, ends, source, root, slack)
        if before >= 0:
            first, last = front.rows[before, 0], front.rows[before, 1]
            ends = min(first, ends[0]), max(last, ends[1])
            if _least_in((first, last), source, is_wave) <= key:  # its place in the queue is right
                front.rows[before, 0], front.rows[before, 1] = ends
                other = surface.beyond[other]
                continue
            front.where[before, 0] = _GONE
        _store(front, -1 - other if is_narrow else other, ends, source, root, key)
        other = surface.beyond[other]


@lean
def _along(surface, front, mode, t, k, to, value):
    """Offer the size at one node of a triangle to another one, along their edge."""
    corner = 3 * t + to
    turn = 0.0 if others_of(to)[0] == k else surface.angle[corner]
    node = surface.cells[t, k]
    _offer(surface, front, mode, corner, value + surface.length[3 * t + 3 - k - to], node, turn)


@lean
def _foot(apex, length, from_low, turn):
    """Return where a ray from the apex of a triangle meets the edge.

    ``turn``: its angle from the edge to the smaller node, or to the other one.
    """
    x, y = apex
    dx, dy = (-x if from_low else length - x), -y
    c, s = math.cos(turn), math.sin(turn)
    if not from_low:
        s = -s
    dx, dy = dx * c - dy * s, dx * s + dy * c
    if not dy < 0.0:
        return length if from_low else 0.0
    return min(max(x - y * dx / dy, 0.0), length)


@lean
def _emit(surface, front, mode, t, k, from_low, angles, value):
    """Send paths from a node into a triangle, between two angles from one of its edges."""
    corner = 3 * t + k
    low, high = others_of(k)
    near, far = (low, high) if from_low else (high, low)
    begin, end = angles
    whole = surface.angle[corner]
    for way in range(2):
        touches = begin <= _GRAZING if way == 0 else end >= whole - _GRAZING
        if touches:
            _along(surface, front, mode, t, k, near if way == 0 else far, value)
    length = surface.length[corner]
    apex = (surface.apex[corner, 0], surface.apex[corner, 1])
    first, last = 0.0, length
    if begin > 0.0:
        at = _foot(apex, length, from_low, begin)
        first, last = (at, last) if from_low else (first, at)
    if end < whole:
        at = _foot(apex, length, from_low, end)
        first, last = (first, at) if from_low else (at, last)
    source, node = (apex[0], apex[1], value), surface.cells[t, k]
    _leave(surface, front, mode, corner, (first, last), source, node)


@lean
def _bend(surface, front, mode, node, value):
    """Send paths from a node of a single fan, at least 180 degrees from the one that arrives."""
    corner = front.corner[node]
    t, k = corner // 3, corner % 3
    low, high = others_of(k)
    last = math.inf
    if surface.kind[node] == SADDLE:
        last = surface.total[node] - math.pi
    for way in range(2):
        if way == 0:
            side, passed = 3 * t + high, front.turn[node]
        else:
            side, passed = 3 * t + low, surface.angle[corner] - front.turn[node]
        while passed < last + _GRAZING:
            side = cross(surface, side)
            if side < 0:
                break
            beside, far = side // 3, side % 3
            at = place_in(surface.cells, beside, node)
            whole, near = surface.angle[3 * beside + at], 3 - far - at
            if passed + whole >= math.pi - _GRAZING:
                angles = max(0.0, math.pi - passed), min(whole, last - passed)
                _emit(surface, front, mode, beside, at, near < far, angles, value)
            passed += whole
            side = 3 * beside + near
        if surface.kind[node] == SADDLE:
            break


@lean
def _spread(surface, front, mode, node, value):
    """Process a node: send paths from it if it is a root."""
    is_own = front.root[node] < 0
    everywhere = is_own or surface.kind[node] == COMPLEX or mode.narrow > 0.0
    if not value < front.sent[node]:
        return
    front.sent[node] = value
    if not everywhere:
        if surface.kind[node] != FLAT:
            _bend(surface, front, mode, node, value)
        return
    for r in range(surface.ring_ptr[node], surface.ring_ptr[node + 1]):
        t = np.int64(surface.ring[r])
        if mode.steep[t] or not is_own:
            k = place_in(surface.cells, t, node)
            angles = 0.0, surface.angle[3 * t + k]
            # From either edge; with a literal it would be compiled once more.
            _emit(surface, front, mode, t, k, everywhere, angles, value)


@lean
def _hit(x, source, is_wave, to_apex, length):
    """Return where the ray from a root by (x, 0) meets the line from one end to the apex.

    ``x`` and ``to_apex``, a vector divided by ``length``, are measured from this end, and so is S.
    """
    if not x > 0.0:
        return 0.0
    sx, sy, _ = source
    across = -sx if is_wave else x - sx
    rate = to_apex[0] * sy + to_apex[1] * across
    return min(x * sy / rate, length) if rate > 0.0 else length


@lean
def _go_out(surface, front, mode, side, end, ends, source, root):
    """Send the part of a window on that leaves by the edge from one end of its own to the apex.

    ``end`` is 0 or 1; ``ends``, seen from there, the nearer one first: distances on the edge, inf
    for the apex.  ``source`` is in the frame of the edge.
    """
    t, v = side // 3, side % 3
    low, high = others_of(v)
    here, out = (low, 3 * t + high) if end == 0 else (high, 3 * t + low)
    length, is_wave = surface.length[out], root >= mode.first_wave
    if surface.beyond[out] == out or not length > 0.0:
        return
    sx, sy, size = source
    x, y = surface.apex[side, 0], surface.apex[side, 1]
    if end == 1:  # mirrored, so that the end is at 0
        edge = surface.length[side]
        x = edge - x
        if is_wave:
            sx, size = -sx, size + -sx * edge
        else:
            sx = edge - sx
    to_apex = x / length, -y / length
    seen = (sx, sy, size)
    near = _hit(ends[0], seen, is_wave, to_apex, length)
    far = length if ends[1] == math.inf else _hit(ends[1], seen, is_wave, to_apex, length)
    if not far > near:
        return
    across = to_apex[0] * sy - to_apex[1] * sx
    along = to_apex[0] * sx + to_apex[1] * sy
    if here > v:  # seen from the apex
        near, far = length - far, length - near
        if is_wave:
            along, size = -along, size - along * length
        else:
            along = length - along
    _leave(surface, front, mode, out, (near, far), (along, across, size), root)


@lean
def _enter(surface, front, mode, slot):
    """Process a window: offer a size to the opposite node, and send its parts on."""
    side, root = np.int64(front.where[slot, 0]), front.where[slot, 1]
    front.where[slot, 0] = _GONE
    front.free[front.tally[FREE]] = slot
    front.tally[FREE] += 1
    if side == _GONE:
        return
    front.tally[DONE] += 1
    goes_on = side >= 0
    side = side if goes_on else -1 - side
    rows = front.rows
    ends, source = (rows[slot, 0], rows[slot, 1]), (rows[slot, 2], rows[slot, 3], rows[slot, 4])
    is_wave = root >= mode.first_wave
    begin, end = _cut(surface, front, side, ends, source, is_wave)
    length = surface.length[side]
    if not end - begin > _NOTHING * length:
        return
    at = _reach(surface, front, mode, side, (begin, end), source, root)
    for last in range(2 if goes_on else 0):
        if last == 1:  # seen from the other end
            begin, end, at = length - end, length - begin, length - at
        if begin < at:
            far = math.inf if at <= end else end
            _go_out(surface, front, mode, side, last, (begin, far), source, root)


@lean_kernel
def start_at_points(surface, front, mode, cells, weights, sizes, roots):
    """Offer sizes from points to the nodes around them, and queue windows (In/Out: front).

    Parameters
    ----------
    surface : Surface
    front : Front
    mode : Mode
    cells : int32[k]
        The triangle of each point.
    weights : float64[k, 3]
        Of its nodes.
    sizes : float64[k]
    roots : int32[k]
        Numbers of the points as roots.
    """
    for p in range(cells.shape[0]):
        t = np.int64(cells[p])
        for way in range(2):  # windows are cut by the sizes at the nodes
            for k in range(3):
                side = 3 * t + k
                high = others_of(k)[1]
                x, y = surface.apex[side, 0], surface.apex[side, 1]
                length = surface.length[side]
                px, py = weights[p, high] * length + weights[p, k] * x, weights[p, k] * y
                if way == 0:
                    value = sizes[p] + math.sqrt((x - px) ** 2 + (y - py) ** 2)
                    turn = math.atan2(abs(x * py - y * px), x * (x - px) + y * (y - py))
                    _offer(surface, front, mode, side, value, roots[p], turn)
                else:
                    source = (px, py, sizes[p])
                    _leave(surface, front, mode, side, (0.0, length), source, roots[p])


@lean_kernel
def propagate(surface, front, mode, room, most):
    """Process windows and roots in the order of their sizes (In/Out: front).

    Parameters
    ----------
    surface : Surface
    front : Front
    mode : Mode
    room : int
        So many windows and entries of the heap may be added at a time.
    most : int
        Number of windows, with those before, after which to stop.

    Returns
    -------
    int
        FINISHED, FULL or SPENT.
    """
    count = front.tally
    while count[QUEUED] > 0:
        n_rows = front.rows.shape[0] - count[USED] + count[FREE]
        if min(n_rows, front.key.shape[0] - count[QUEUED]) < room:
            return FULL
        if count[DONE] >= most:
            return SPENT
        key, item = _take(front)
        if item >= 0:
            _enter(surface, front, mode, np.int64(item))
        elif key <= front.h[-1 - item]:
            _spread(surface, front, mode, np.int64(-1 - item), key)
    return FINISHED
