"""The limited size in a plane domain with very many corners, by triangular expansion.

Sources and corners are processed in order of size, as in Dijkstra's algorithm.  Each of them, the
*root*, floods the triangles that it sees: a *window* is a cone of rays from the root that enters a
triangle through one of its edges.  The opposite node gets a size if it lies in the window, and
divides the window in two, which go on through the other two edges until they meet a wall
(Bungiu et al., Efficient computation of visibility polygons, 2014).

A window with root r and size U ends early where the node v of the edge through which it passes is
better: let B be the point of the window on the edge that is farthest from v.  If

    U + g |r - B| > h(v) + g |v - B|,

this holds at all points of the window on the edge, because |r - y| - |v - y| does not rise if y
moves away from v (Xin and Wang, Improving Chen and Han's algorithm, 2009).  So no shortest path
goes through the window.

Behind the node that divides it, a window becomes one again.  A triangle of which two edges face the
root sends all windows out through the third.  So a window that extends to the common node of
the two waits there for the one from the other side, and both leave as one.  If nothing else is
left, the windows that have waited longest go on alone.  In a Delaunay mesh without obstacles, each
edge is crossed by one window of each root.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact_plane import CONE, set_wedge
from adaptsize._kernels.heap import Heap, pop, push_or_decrease
from adaptsize._kernels.sight import NARROW, cone_in, side_in_cone


class Triangles(NamedTuple):
    """A mesh of triangles, and sources between its nodes, numbered after these.

    Parameters
    ----------
    points : float64[n + k, 2]
    cells : int32[m, 3]
        Counterclockwise.
    beyond : int32[3 * m]
        Edge 3 t + v of triangle t is opposite to its node v.  On its other side, it has this
        number, -1 at walls.
    ring_ptr, ring : int32[n + k + 1], int32[...]
        Triangles around each node, as from `topology.fill_rings`, and around each source: all that
        hold it.
    """

    points: np.ndarray
    cells: np.ndarray
    beyond: np.ndarray
    ring_ptr: np.ndarray
    ring: np.ndarray


class Front(NamedTuple):
    """Sizes, and what is known of the roots.

    Parameters
    ----------
    h : float64[n + k]
        Sizes.
    root : int32[n + k]
        The root that lowered each size, -1 for none.
    corner : int32[n + k]
        Number of each node that is a corner, else -1.
    table, walls : float64[c, COLUMNS], float64[c, 5]
        The corners, as in `exact_plane.solve_corners`.
    arrivals : float64[c, 2]
        Directions in which paths arrive at the corners.
    heap : Heap
        Roots that have not been processed.
    edges : int32[w]
        Scratch: the edge of the next triangle through which each window goes.  A node divides as
        many windows of a root as triangles around it hold the way back, at most 1 + (sum of
        their angles) / (2 pi).  So w = n + m / 2 + (twice the most triangles around a root) is
        enough.
    rays : float64[w, 4]
        Scratch: its right and its left ray.
    waiting : int32[m]
        In/Out: as ``edges``, for the window that waits in each triangle; -1 if there is none.
    waiting_rays : float64[m, 4]
        Scratch: its rays.
    queue : int32[m + 1]
        Scratch: triangles in which a window waits or has waited, the first one first, as a ring.
    n_nodes : int
        Roots from this number on are sources between the nodes.
    """

    h: np.ndarray
    root: np.ndarray
    corner: np.ndarray
    table: np.ndarray
    walls: np.ndarray
    arrivals: np.ndarray
    heap: Heap
    edges: np.ndarray
    rays: np.ndarray
    waiting: np.ndarray
    waiting_rays: np.ndarray
    queue: np.ndarray
    n_nodes: int


@lean
def _turn(a, b):
    return a[0] * b[1] - a[1] * b[0]


@lean_kernel
def connect(triangles, first, after):
    """Turn triangles counterclockwise, and connect them (In/Out: triangles).

    Parameters
    ----------
    triangles : Triangles
    first, after : int32[n], int32[3 * m]
        Scratch: the first edge at each node that is its smaller one, and for each edge the next.

    Returns
    -------
    bool
        Whether each edge has at most one triangle on either side.
    """
    points, cells, beyond = triangles.points, triangles.cells, triangles.beyond
    first[:] = -1
    for t in range(cells.shape[0]):
        i, j, k = cells[t, 0], cells[t, 1], cells[t, 2]
        u = (points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
        v = (points[k, 0] - points[i, 0], points[k, 1] - points[i, 1])
        if _turn(u, v) < 0.0:
            cells[t, 1], cells[t, 2] = k, j
        for w in range(3):
            i, j = cells[t, (w + 1) % 3], cells[t, (w + 2) % 3]
            here, smaller = 3 * t + w, min(i, j)
            beyond[here] = -1
            e = first[smaller]
            while e >= 0:
                p, q = cells[e // 3, (e + 1) % 3], cells[e // 3, (e + 2) % 3]
                if p == j and q == i:
                    break
                if p == i and q == j:
                    return False
                e = after[e]
            if e < 0:
                after[here], first[smaller] = first[smaller], here
            elif beyond[e] >= 0:
                return False
            else:
                beyond[here], beyond[e] = e, here
    return True


@lean
def _offer(front, root, i, value, to_node):
    """Lower the size of node i to a value, and remember that it may be a root then."""
    if not value < front.h[i]:
        return
    front.h[i], front.root[i] = value, root
    k = front.corner[i]
    if k >= 0:
        front.arrivals[k, 0], front.arrivals[k, 1] = to_node
        push_or_decrease(front.heap, np.int64(i), value)


@lean
def _push(front, top, edge, right, left):
    """Put a window on the stack, unless it ends at a wall or has no width; return the height."""
    if edge < 0 or not _turn(right, left) > 0.0:
        return top
    front.edges[top] = edge
    front.rays[top, 0], front.rays[top, 1] = right
    front.rays[top, 2], front.rays[top, 3] = left
    return top + 1


@lean
def _start_in_cell(triangles, front, root, t, size, g, slack, top):
    """Do the same as `_start` in one cell that holds a source between the nodes."""
    points, cells = triangles.points, triangles.cells
    x, y = points[root, 0], points[root, 1]
    for v in range(3):
        i, j = np.int64(cells[t, (v + 1) % 3]), np.int64(cells[t, (v + 2) % 3])
        right = (points[i, 0] - x, points[i, 1] - y)
        left = (points[j, 0] - x, points[j, 1] - y)
        _offer(front, root, i, size + g * math.sqrt(right[0] ** 2 + right[1] ** 2), right)
        # What lies behind an edge with the source on it is seen from the cell there.
        length = math.sqrt((left[0] - right[0]) ** 2 + (left[1] - right[1]) ** 2)
        if _turn(right, left) > slack * length:
            top = _push(front, top, triangles.beyond[3 * t + v], right, left)
    return top


@lean
def _start(triangles, front, root, size, g, cone, slack):
    """Offer sizes to the neighbours of a root, and put its first windows on the stack."""
    points, cells = triangles.points, triangles.cells
    x, y = points[root, 0], points[root, 1]
    top = np.int64(0)
    start, end = (cone[0], cone[1]), (cone[2], cone[3])
    for r in range(triangles.ring_ptr[root], triangles.ring_ptr[root + 1]):
        t = triangles.ring[r]
        if root >= front.n_nodes:
            top = _start_in_cell(triangles, front, root, t, size, g, slack, top)
            continue
        v = 0
        while cells[t, v] != root:
            v += 1
        i, j = np.int64(cells[t, (v + 1) % 3]), np.int64(cells[t, (v + 2) % 3])
        right = (points[i, 0] - x, points[i, 1] - y)
        left = (points[j, 0] - x, points[j, 1] - y)
        if side_in_cone(cone, right, slack) > 0:
            length = math.sqrt(right[0] * right[0] + right[1] * right[1])
            _offer(front, root, i, size + g * length, right)
        if side_in_cone(cone, left, slack) > 0:
            length = math.sqrt(left[0] * left[0] + left[1] * left[1])
            _offer(front, root, j, size + g * length, left)
        if cone[4] == NARROW:  # of at most half a turn: both cones meet in one
            first, last = right, left
            if _turn(right, start) > 0.0 and _turn(start, left) > 0.0:
                first = start
            elif _turn(start, right) < 0.0 or _turn(right, end) < 0.0:
                continue
            if _turn(right, end) > 0.0 and _turn(end, left) > 0.0:
                last = end
            elif _turn(start, left) < 0.0 or _turn(left, end) < 0.0:
                continue
            right, left = first, last
        top = _push(front, top, triangles.beyond[3 * t + v], right, left)
    return top


@lean
def _is_better(h, v, to_node, end, size, g, margin):
    """Return whether a node allows less than the root at one end of a window.

    ``to_node``: from the root to node v; ``end``: from the root to the end.
    """
    from_node = math.sqrt((end[0] - to_node[0]) ** 2 + (end[1] - to_node[1]) ** 2)
    from_root = math.sqrt(end[0] * end[0] + end[1] * end[1])
    return size + g * from_root > h[v] + g * from_node + margin


@lean
def _flood(triangles, front, root, size, top, g, slack, margin):
    """Follow the windows of a root; return how many there were."""
    points, cells, beyond, h = triangles.points, triangles.cells, triangles.beyond, front.h
    edges, rays, waiting, queue = front.edges, front.rays, front.waiting, front.queue
    others = front.waiting_rays
    x, y = points[root, 0], points[root, 1]
    count = head = tail = np.int64(0)
    while top > 0 or head != tail:
        if top == 0:  # the window that has waited longest goes on
            t = queue[head]
            head = (head + 1) % queue.shape[0]
            right, left = (others[t, 0], others[t, 1]), (others[t, 2], others[t, 3])
            top = _push(front, top, waiting[t], right, left)
            waiting[t] = -1
            continue
        top -= 1
        count += 1
        t, v = edges[top] // 3, edges[top] % 3
        i, k, j = cells[t, (v + 2) % 3], np.int64(cells[t, v]), cells[t, (v + 1) % 3]
        right, left = (rays[top, 0], rays[top, 1]), (rays[top, 2], rays[top, 3])
        to_i = (points[i, 0] - x, points[i, 1] - y)
        to_j = (points[j, 0] - x, points[j, 1] - y)
        edge = (to_j[0] - to_i[0], to_j[1] - to_i[1])
        # The ends of the window on the edge; inf if the rays are along it.
        area = _turn(to_i, edge)
        far, near = area / _turn(left, edge), area / _turn(right, edge)
        if _is_better(h, i, to_i, (far * left[0], far * left[1]), size, g, margin):
            continue
        if _is_better(h, j, to_j, (near * right[0], near * right[1]), size, g, margin):
            continue
        to_node = (points[k, 0] - x, points[k, 1] - y)
        after, before = _turn(right, to_node), _turn(to_node, left)
        value = size + g * math.sqrt(to_node[0] * to_node[0] + to_node[1] * to_node[1])
        if value < h[k]:
            inside = min(after, before) >= 0.0
            if not inside:
                inside = after >= -slack * math.sqrt(
                    right[0] * right[0] + right[1] * right[1]
                ) and before >= -slack * math.sqrt(left[0] * left[0] + left[1] * left[1])
            if inside:
                _offer(front, root, k, value, to_node)
        behind_j, behind_i = beyond[3 * t + (v + 1) % 3], beyond[3 * t + (v + 2) % 3]
        if after > 0.0 and before > 0.0:
            top = _push(front, top, behind_j, right, to_node)
            top = _push(front, top, behind_i, to_node, left)
            continue
        # All of the window leaves through one edge, and another window may do so, too.
        to_right = after > 0.0
        if to_right:
            out, shares = behind_j, left == to_j and _turn(to_j, to_node) > 0.0
        else:
            out, shares = behind_i, right == to_i and _turn(to_node, to_i) > 0.0
        if shares and out >= 0:
            if waiting[t] < 0:
                waiting[t], queue[tail] = out, t
                others[t, 0], others[t, 1] = right
                others[t, 2], others[t, 3] = left
                tail = (tail + 1) % queue.shape[0]
                continue
            waiting[t] = -1
            if to_right:
                left = (others[t, 2], others[t, 3])
            else:
                right = (others[t, 0], others[t, 1])
        top = _push(front, top, out, right, left)
    return count


@lean_kernel
def expand(triangles, front, g, slack, margin, most):
    """Process roots in order of size, until there are none or so many windows were followed.

    Parameters
    ----------
    triangles : Triangles
    front : Front
        In/Out.
    g : float64
    slack : float64
        Distance from a line below which a point is on the line.
    margin : float64
        Sizes that differ by less do not end windows.
    most : int

    Returns
    -------
    bool
        Whether roots are left.
    """
    count = np.int64(0)
    while front.heap.size[0] > 0 and count < most:
        root = pop(front.heap)
        size, k = front.h[root], front.corner[root]
        cone = (0.0, 0.0, 0.0, 0.0, 0.0)
        if front.root[root] >= 0:  # not by its own bound
            if k < 0:
                continue
            front.table[k, 4] = size
            dx, dy = front.arrivals[k, 0], front.arrivals[k, 1]
            if not set_wedge(front.table, k, front.walls, dx, dy, slack):
                continue
            cone = cone_in(front.table, k, CONE)
        top = _start(triangles, front, root, size, g, cone, slack)
        count += 1 + _flood(triangles, front, root, size, top, g, slack, margin)
    return front.heap.size[0] > 0
