"""Lines of sight inside a solid, and sizes carried along its surface where sight ends.

Walls are the facets of its surface, as in rays.py.  A line leaves the solid where it passes through
a facet from inside.  Ends on the surface are moved inside a little by the caller, so that a line
that starts to the outside leaves at once.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel, lean
from adaptsize._kernels.exact import FLAT, least_in_box
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local_updates import SPACE
from adaptsize._kernels.rays import ALONG, hit, inverse, leaf_on_segment
from adaptsize._kernels.trees import DEPTH, Stack, cells_of_leaf, descent_by_bound, items_of_leaf
from adaptsize._kernels.unseen import KEPT, Unseen, hide_behind, is_unseen
from adaptsize._kernels.vectors import cross, dot, minus, norm, triple

#: A size is lowered only by more than this share.
_LESS = 1.0 - 1e-9


@inner
def _hiding(walls, two_sided, x, y, least, stack):
    """Return a facet that hides x from y: one whose normal has a larger cosine to the line, or -1.

    ``least``: 0 if lines must not leave the solid, -inf if they must not enter it either.
    """
    step = minus(y, x)
    length = norm(step)
    slack = walls.slack
    if length <= 2.0 * slack:
        return np.int64(-1)
    way = (step[0] / length, step[1] / length, step[2] / length)
    segment = ((x, inverse(way), slack), length)
    stack[0], height = 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_on_segment(walls.boxes, stack, height, segment)
        for t in range(*cells_of_leaf(leaf, walls.boxes, walls.facets.shape[0])):
            along, cosine = hit(walls.facets, t, x, way)
            if not slack < along < length - slack:
                continue
            # Ends are not moved off sheets, along which lines may run.
            if abs(cosine) > ALONG if two_sided[t] else cosine > least:
                return np.int64(t)
    return np.int64(-1)


@kernel
def find_hidden(walls, two_sided, ends, strict, hidden, begin, end):
    """Find which lines leave the solid.

    Parameters
    ----------
    walls : FacetTree
    two_sided : bool[m]
        Facets that hide from both sides.
    ends : tuple of float64[n, 3], float64[n, 3]
    strict : bool
        Whether facets through which lines enter hide, too.
    hidden : bool[n]
        Out.
    begin, end : int
        Only these lines are tested.
    """
    (starts, targets), least = ends, -math.inf if strict else 0.0
    stack = np.empty(DEPTH, np.int64)
    for i in range(begin, end):
        x, y = triple(starts, i, 0), triple(targets, i, 0)
        hidden[i] = _hiding(walls, two_sided, x, y, least, stack) >= 0


@kernel
def carry(walls, two_sided, g, places, inner_places, rings, is_hidden, sizes, aims, heap):
    """Lower the sizes of nodes that do not see what lowers them, along the surface.

    Each node has an *aim*: the last point at which the path from its source bends, or the source.
    A node tries the aims of its neighbours, and takes the path along the edge from a neighbour if
    it does not see the aim.  The neighbour is its aim then.

    Parameters
    ----------
    walls, two_sided
        As in `find_hidden`.
    g : float64
    places, inner_places : float64[m, 3]
        Nodes first, then other sources; and the same moved inside.
    rings : tuple of int32[n + 1], int32[k]
        Neighbours of each node.
    is_hidden : bool[n]
        Nodes whose sizes may be lowered.
    sizes : float64[m]
        In/Out: at the nodes, and of other sources.
    aims : int32[n]
        In/Out: rows of ``places``.
    heap : Heap
        Empty.
    """
    first, ring = rings
    stack = np.empty(DEPTH, np.int64)
    for x in range(len(is_hidden)):
        is_near = is_hidden[x]
        for k in range(first[x], first[x + 1]):
            is_near = is_near or is_hidden[ring[k]]
        if is_near and sizes[x] < math.inf:
            push_or_decrease(heap, np.int64(x), sizes[x])
    while heap.size[0] > 0:
        j = pop(heap)
        a = aims[j]
        for k in range(first[j], first[j + 1]):
            x = np.int64(ring[k])
            if not is_hidden[x]:
                continue
            place = triple(places, x, 0)
            straight = sizes[a] + g * norm(minus(place, triple(places, a, 0)))
            if not straight < sizes[x] * _LESS:
                continue
            inside, bend = triple(inner_places, x, 0), triple(inner_places, a, 0)
            if _hiding(walls, two_sided, inside, bend, 0.0, stack) < 0:
                sizes[x], aims[x] = straight, a
                push_or_decrease(heap, x, straight)
                continue
            along = sizes[j] + g * norm(minus(place, triple(places, j, 0)))
            if along < sizes[x] * _LESS:
                sizes[x], aims[x] = along, j
                push_or_decrease(heap, x, along)


@inner
def _weights_of(table, k, x, g):
    """Return the weights of the vertices of entry k where the size that it allows at x is least."""
    if not table[k, 10] < math.inf:
        return 1.0, 0.0, 0.0
    corner = triple(table, k, 0)
    e1, w = minus(triple(table, k, 3), corner), minus(x, corner)
    r1, a11, w1 = table[k, 10] - table[k, 9], dot(e1, e1), dot(e1, w)
    if not table[k, 11] < math.inf:
        foot = w1 / a11 if a11 > 0.0 else 0.0
        height2 = max(dot(w, w) - foot * w1, 0.0)
        scale2 = a11 * (g * g * a11 - r1 * r1)
        t = foot - r1 * math.sqrt(height2 / scale2) if scale2 > 0.0 else foot
        t = min(max(t, 0.0), 1.0)
        return 1.0 - t, t, 0.0
    e2 = minus(triple(table, k, 6), corner)
    r2, a12, a22, w2 = table[k, 11] - table[k, 9], dot(e1, e2), dot(e2, e2), dot(e2, w)
    normal = cross(e1, e2)
    det = dot(normal, normal)
    if not det > FLAT * a11 * a22:
        return 1.0, 0.0, 0.0
    q1, q2 = (a22 * r1 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det
    slack2 = g * g - (q1 * r1 + q2 * r2)
    ratio = abs(dot(normal, w)) / math.sqrt(det * slack2) if slack2 > 0.0 else 0.0
    t = min(max((a22 * w1 - a12 * w2) / det - ratio * q1, 0.0), 1.0)
    u = min(max((a11 * w2 - a12 * w1) / det - ratio * q2, 0.0), 1.0 - t)
    return 1.0 - t - u, t, u


@kernel
def find_weights(table, source, points, g, weights):
    """Find where in the entry of each point the size that it allows is least (see exact.py).

    Parameters
    ----------
    table : float64[m, 12]
        Nodes, edges and triangles in space.
    source : int32[n]
        The entry of each point, -1 if it has none.
    points : float64[n, 3]
    g : float64
    weights : float64[n, 3]
        Out: of the vertices.
    """
    for i in range(len(source)):
        found = (1.0, 0.0, 0.0)
        if source[i] >= 0:
            found = _weights_of(table, np.int64(source[i]), triple(points, i, 0), g)
        weights[i, 0], weights[i, 1], weights[i, 2] = found


@lean
def _least_seen(boxes, b, given):
    """Return a lower bound of what the entries in box b allow at a point; inf if it is unseen."""
    bound, frame, unseen, (sizes, i) = given
    least = least_in_box(boxes, b, bound)
    if least < sizes[i] and unseen.n[0] > 0:
        origin, scale, nudge = frame
        low, high = minus(triple(boxes, b, 0), origin), minus(triple(boxes, b, 3), origin)
        half = 0.5 * scale
        middle = half * (low[0] + high[0]), half * (low[1] + high[1]), half * (low[2] + high[2])
        # The line to an entry ends at a place in it that is moved inside.
        to_side = (
            half * (high[0] - low[0]) + nudge,
            half * (high[1] - low[1]) + nudge,
            half * (high[2] - low[2]) + nudge,
        )
        if is_unseen(unseen, middle, to_side):
            return math.inf
    return least


#: Descends to the leaves of entries that allow least at a point, but for unseen ones.
_least_seen_leaf = descent_by_bound(_least_seen)


@kernel
def lower_by_seen(walls, two_sided, entries, normals, frame, g, points, starts, found, most):
    """Lower sizes to the least that the entries allow which are seen from each point.

    Parameters
    ----------
    walls, two_sided
        As in `find_hidden`.
    entries : tuple of float64[m, 12], float64[2 * n_leaves, 7], int32[m, 3]
        Table, tree and nodes (see exact.py).
    normals : float64[n_nodes, 3]
    frame : tuple of float64[3], float, float
        Origin and scale of the frame of the walls, and how far ends are moved inside.
    g : float
    points, starts : float64[n, 3]
        Points, and the same in the frame.
    found : tuple of float64[n], int32[n]
        In/Out: sizes, and the entry where a size was lowered.
    most : int
        So many lines to hidden entries are traced before a point keeps its size.
    """
    (table, boxes, nodes), (origin, scale, nudge), (sizes, source) = entries, frame, found
    frame = (origin[0], origin[1], origin[2]), scale, nudge
    stack, trees = np.empty(DEPTH, np.int64), Stack(np.empty(DEPTH, np.int64), np.empty(DEPTH))
    unseen = Unseen(np.empty((KEPT, 16)), np.empty(KEPT, np.int64), np.zeros(1, np.int64))
    box, y = np.empty(6), np.empty(3)
    m = table.shape[0]
    for i in range(len(sizes)):
        x, start = triple(points, i, 0), triple(starts, i, 0)
        for d in range(3):
            box[d] = box[3 + d] = x[d]
        unseen.n[0] = 0
        given, missed = ((SPACE, box, g), frame, unseen, (sizes, i)), 0
        trees.box[0], trees.bound[0], height = 1, -math.inf, np.int64(1)
        while height > 0 and missed < most:
            leaf, height = _least_seen_leaf(boxes, trees, height, sizes[i], given)
            for k in range(*items_of_leaf(leaf, m)):
                s, t, u = _weights_of(table, k, x, g)
                value = s * table[k, 9]
                if t > 0.0:
                    value += t * table[k, 10]
                if u > 0.0:
                    value += u * table[k, 11]
                square = 0.0
                for d in range(3):
                    y[d] = s * table[k, d] + t * table[k, 3 + d] + u * table[k, 6 + d]
                    square += (x[d] - y[d]) ** 2
                value += g * math.sqrt(square)
                if not value < sizes[i] * _LESS:
                    continue
                for d in range(3):
                    inwards = s * normals[nodes[k, 0], d]
                    if t > 0.0:
                        inwards += t * normals[nodes[k, 1], d]
                    if u > 0.0:
                        inwards += u * normals[nodes[k, 2], d]
                    y[d] = (y[d] - origin[d]) * scale - nudge * inwards
                place = y[0], y[1], y[2]
                if is_unseen(unseen, place, (0.0, 0.0, 0.0)):
                    continue
                wall = _hiding(walls, two_sided, start, place, 0.0, stack)
                if wall < 0:
                    sizes[i], source[i] = value, k
                    continue
                missed += 1
                if not two_sided[wall]:
                    hide_behind(unseen, walls, wall, start)
