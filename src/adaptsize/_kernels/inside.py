"""Lines of sight inside a solid, and sizes carried along its surface where sight ends.

Walls are the facets of its surface, as in rays.py.  A line leaves the solid where it passes through
a facet from inside.  Ends on the surface are moved inside a little by the caller, so that a line
that starts to the outside leaves at once.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.exact import FLAT
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.rays import ALONG, hit, inverse, leaf_on_segment
from adaptsize._kernels.trees import DEPTH, cells_of_leaf
from adaptsize._kernels.vectors import cross, dot, minus, norm, triple

#: A size is lowered only by more than this share.
_LESS = 1.0 - 1e-9


@inner
def _is_hidden(walls, two_sided, x, y, strict, stack):
    """Return whether the line from x to y leaves the solid, or, if strict, meets its surface."""
    step = minus(y, x)
    length = norm(step)
    slack = walls.slack
    if length <= 2.0 * slack:
        return False
    way = (step[0] / length, step[1] / length, step[2] / length)
    segment = ((x, inverse(way), slack), length)
    stack[0], height = 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_on_segment(walls.boxes, stack, height, segment)
        for t in range(*cells_of_leaf(leaf, walls.boxes, walls.facets.shape[0])):
            along, cosine = hit(walls.facets, t, x, way)
            if not slack < along < length - slack:
                continue
            if cosine > ALONG or ((strict or two_sided[t]) and cosine < -ALONG):
                return True
    return False


@kernel
def find_hidden(walls, two_sided, ends, strict, hidden, begin, end):
    """Find which lines leave the solid.

    Parameters
    ----------
    walls : Walls
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
    starts, targets = ends
    stack = np.empty(DEPTH, np.int64)
    for i in range(begin, end):
        x, y = triple(starts, i, 0), triple(targets, i, 0)
        hidden[i] = _is_hidden(walls, two_sided, x, y, strict, stack)


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
            inside = triple(inner_places, x, 0)
            if not _is_hidden(walls, two_sided, inside, triple(inner_places, a, 0), False, stack):
                sizes[x], aims[x] = straight, a
                push_or_decrease(heap, x, straight)
                continue
            along = sizes[j] + g * norm(minus(place, triple(places, j, 0)))
            if along < sizes[x] * _LESS:
                sizes[x], aims[x] = along, j
                push_or_decrease(heap, x, along)


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
        k = source[i]
        weights[i, 0], weights[i, 1], weights[i, 2] = 1.0, 0.0, 0.0
        if k < 0 or not table[k, 10] < math.inf:
            continue
        corner = triple(table, k, 0)
        e1, w = minus(triple(table, k, 3), corner), minus(triple(points, i, 0), corner)
        r1, a11, w1 = table[k, 10] - table[k, 9], dot(e1, e1), dot(e1, w)
        if not table[k, 11] < math.inf:
            foot = w1 / a11
            height2 = max(dot(w, w) - foot * w1, 0.0)
            scale2 = a11 * (g * g * a11 - r1 * r1)
            t = foot - r1 * math.sqrt(height2 / scale2) if scale2 > 0.0 else foot
            t = min(max(t, 0.0), 1.0)
            weights[i, 0], weights[i, 1] = 1.0 - t, t
            continue
        e2 = minus(triple(table, k, 6), corner)
        r2, a12, a22, w2 = table[k, 11] - table[k, 9], dot(e1, e2), dot(e2, e2), dot(e2, w)
        normal = cross(e1, e2)
        det = dot(normal, normal)
        if not det > FLAT * a11 * a22:
            continue
        q1, q2 = (a22 * r1 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det
        slack2 = g * g - (q1 * r1 + q2 * r2)
        ratio = abs(dot(normal, w)) / math.sqrt(det * slack2) if slack2 > 0.0 else 0.0
        t = min(max((a22 * w1 - a12 * w2) / det - ratio * q1, 0.0), 1.0)
        u = min(max((a11 * w2 - a12 * w1) / det - ratio * q2, 0.0), 1.0 - t)
        weights[i, 0], weights[i, 1], weights[i, 2] = 1.0 - t - u, t, u
