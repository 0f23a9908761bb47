"""The limited size in a convex domain: the minimum of finitely many cones, found by trees.

A node, an edge or a triangle on which the bound h0 is linear is an *entry*.  It allows the size

    min over its points y of  h0(y) + g |x - y|

at x, and the limited size is the minimum of these.  Only the *survivors* matter, the nodes that
keep their bound: if h0_i + g |x_i - x_j| < h0_j, then i allows less than j everywhere, by the
triangle inequality.  The same holds for an edge or triangle all of whose vertices one cone
dominates, since a cone is convex and h0 is linear there.

Points are processed in *blocks* of consecutive points along a Morton curve.  For each block, the
tree of the entries is descended as long as

    least value of a box + g (distance of box and block)

is below the largest size in the block.  The remaining entries are tested on all points of the
block.  The result is the minimum of a finite set of numbers and does not depend on the order of
nodes and blocks.

Entries are rows of a table, sorted along a Morton curve.  The columns are the dim coordinates of
each of dim vertices, and the dim bounds there.  Where an entry has fewer vertices, the first one
is repeated with the bound inf.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.trees import (
    Stack,
    descent_by_bound,
    distance_to_box,
    items_of_leaf,
    new_stack,
)
from adaptsize._kernels.vectors import column, cross, dot, minus, triple

#: Points of a block.
BLOCK = 32
# Bounds are lowered by this share, so that rounding discards no relevant entry.
SLACK = 1.0 - 1e-13
#: Cells and faces flatter than this (determinant of the Gram matrix over the product of squared
#: lengths) are treated as steep, since their gradients are dominated by rounding.
FLAT = 1e-14


class Block(NamedTuple):
    """Scratch for the points of a block and the descent of a tree.

    Parameters
    ----------
    x : float64[dim, BLOCK]
        The points.
    box : float64[2 * dim]
        Their bounding box.
    h : float64[BLOCK]
        Sizes; -inf where nothing is to be lowered.
    by : int64[BLOCK]
        The entry that lowered each point, -1 if none.
    values : float64[BLOCK]
        Sizes that one entry allows.
    share : float64[BLOCK]
        Weight of the second vertex of an edge at its minimising point.
    stack : Stack
        Boxes of the tree, with lower bounds of what they allow in the block.
    """

    x: np.ndarray
    box: np.ndarray
    h: np.ndarray
    by: np.ndarray
    values: np.ndarray
    share: np.ndarray
    stack: Stack


def new_block(dim: int) -> Block:
    """Return scratch for one thread."""
    return Block(
        np.empty((dim, BLOCK)),
        np.empty(2 * dim),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK),
        np.empty(BLOCK),
        new_stack(),
    )


@lean
def gather(points, axes, which, x, box):
    """Copy some points to x, and bound them by ``box``."""
    dim, count = len(axes), which.shape[0]
    for d in range(dim):
        low, high = math.inf, -math.inf
        for i in range(count):
            value = points[which[i], d]
            x[d, i] = value
            low, high = min(low, value), max(high, value)
        box[d], box[dim + d] = low, high


@lean
def largest(h, count):
    """Return the largest of the first sizes."""
    worst = -math.inf
    for i in range(count):
        worst = max(worst, h[i])
    return worst


@lean
def begin(points, axes, which, sizes, block):
    """Set the points of a block and their sizes; return the largest size."""
    gather(points, axes, which, block.x, block.box)
    for i in range(which.shape[0]):
        block.h[i], block.by[i] = sizes[which[i]], -1
    return largest(block.h, which.shape[0])


@lean
def least_in_box(boxes, b, given):
    """Return a lower bound of what the entries in box b allow in the box of a block."""
    axes, box, g = given
    return SLACK * (boxes[b, 2 * len(axes)] + g * distance_to_box(boxes, b, axes, box))


#: Descends to the leaves of entries that allow least in the box of a block.
least_leaf = descent_by_bound(least_in_box)


@lean
def _least_at_points(boxes, b, given):
    """Return the same bound; inf if the box can lower no point of the block.

    The test of all points pays near the leaves, where it avoids that of all entries of a box.
    """
    axes, box, g, x, h, count = given
    dim = len(axes)
    least = least_in_box(boxes, b, (axes, box, g))
    if 8 * b < boxes.shape[0]:
        return least
    for i in range(count):
        square = 0.0
        for d in range(dim):
            gap = max(boxes[b, d] - x[d, i], x[d, i] - boxes[b, dim + d])
            if gap > 0.0:
                square += gap * gap
        if SLACK * (boxes[b, 2 * dim] + g * math.sqrt(square)) < h[i]:
            return least
    return math.inf


_leaf_for_points = descent_by_bound(_least_at_points)


@lean
def least_allowed(table, k, axes, box, g, edges):
    """Return a lower bound for the size that entry k allows in a box."""
    dim = len(axes)
    square = 0.0
    base = table[k, dim * dim]
    for d in range(dim):
        low = high = table[k, d]
        if edges is not None:
            base = min(base, table[k, dim * dim + d])
            for v in range(1, dim):
                low, high = min(low, table[k, v * dim + d]), max(high, table[k, v * dim + d])
        gap = max(low - box[dim + d], box[d] - high)
        if gap > 0.0:
            square += gap * gap
    return SLACK * (base + g * math.sqrt(square))


@lean
def _fill_edge(table, k, axes, x, count, g, values, share):
    """Fill the sizes that edge k allows at points, inf where the minimum is at an end.

    An end is a separate entry, or dominated.  ``share`` gets the weights of the second end.
    """
    dim = len(axes)
    base = table[k, dim * dim]
    rise = table[k, dim * dim + 1] - base
    length2 = 0.0
    for d in range(dim):
        length2 += (table[k, dim + d] - table[k, d]) ** 2
    slack2 = g * g * length2 - rise * rise
    scale2 = length2 * slack2
    for i in range(count):
        dot = height2 = 0.0
        for d in range(dim):
            dot += (table[k, dim + d] - table[k, d]) * (x[d, i] - table[k, d])
        foot = dot / length2
        for d in range(dim):
            e = table[k, dim + d] - table[k, d]
            height2 += (x[d, i] - table[k, d] - foot * e) ** 2
        ratio = math.sqrt(height2 / scale2) if scale2 > 0.0 else math.inf
        t = foot - rise * ratio
        share[i] = t
        values[i] = base + foot * rise + ratio * slack2 if 0.0 < t < 1.0 else math.inf


@lean
def _fill_face(table, k, x, count, g, values):
    """Fill the sizes that triangle k allows at points, inf where the minimum is not inside."""
    corner = triple(table, k, 0)
    e1, e2 = minus(triple(table, k, 3), corner), minus(triple(table, k, 6), corner)
    base = table[k, 9]
    r1, r2 = table[k, 10] - base, table[k, 11] - base
    a11, a12, a22 = dot(e1, e1), dot(e1, e2), dot(e2, e2)
    normal = cross(e1, e2)
    det = dot(normal, normal)
    q1 = q2 = scale = 0.0
    slack2 = -1.0
    if det > FLAT * a11 * a22:
        q1, q2 = (a22 * r1 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det
        slack2 = g * g - (q1 * r1 + q2 * r2)
    if slack2 > 0.0:
        scale = 1.0 / math.sqrt(det * slack2)
    for i in range(count):
        w = minus(column(x, i), corner)
        w1, w2 = dot(e1, w), dot(e2, w)
        p1, p2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
        ratio = abs(dot(normal, w)) * scale
        l1, l2 = p1 - ratio * q1, p2 - ratio * q2
        inside = scale > 0.0 and min(l1, l2) >= 0.0 and l1 + l2 <= 1.0
        values[i] = base + p1 * r1 + p2 * r2 + ratio * slack2 if inside else math.inf


@lean
def fill_values(table, k, axes, x, count, g, values, share, edges, faces):
    """Fill the sizes that entry k allows at points, inf where the minimum is at an end of an edge.

    ``edges`` and ``faces`` are None if there are no such entries; their code is then not compiled.
    """
    dim = len(axes)
    if faces is not None and table[k, dim * dim + dim - 1] < math.inf:
        _fill_face(table, k, x, count, g, values)
        return
    if edges is not None and table[k, dim * dim + 1] < math.inf:
        _fill_edge(table, k, axes, x, count, g, values, share)
        return
    base = table[k, dim * dim]
    for i in range(count):
        square = 0.0
        for d in range(dim):
            square += (x[d, i] - table[k, d]) ** 2
        values[i] = base + g * math.sqrt(square)


@lean
def fill_arcs(table, k, axes, x, count, g, radius, values):
    """Fill the sizes that node k allows at points of a sphere, along great circles.

    The angle of a chord c is 2 atan2(c, sqrt(4 R^2 - c^2)).
    """
    base = table[k, len(axes) * len(axes)]
    for i in range(count):
        square = 0.0
        for d in range(len(axes)):
            square += (x[d, i] - table[k, d]) ** 2
        rest = math.sqrt(max(4.0 * radius * radius - square, 0.0))
        values[i] = base + g * 2.0 * radius * math.atan2(math.sqrt(square), rest)


@lean_kernel
def lower_sizes(points, axes, order, span, tree, g, found, once, edges, faces, radius, block):
    """Lower the sizes of points to the minimum that entries allow, without regard to visibility.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    order : int32[n]
        The points along a Morton curve.
    span : tuple of int
        The first and the last of ``order`` to process; the first is a multiple of BLOCK.
    tree : tuple of float64[m, dim * (dim + 1)], float64[2 * n_leaves, 2 * dim + 1]
        Entries, and the tree over them (see trees.py).
    g : float64
    found : tuple of float64[n], int32[n]
        In/Out: sizes, and the entry where a size was lowered.
    once : bool
        Whether to lower each size once only, which is enough to know that it is not kept.
    edges, faces : None or bool
        None if there are no edges (triangles) among the entries.
    radius : None or float64
        Radius of a sphere around 0 on which all points lie and along which distances run; there
        are only nodes then.  Boxes are compared by chords, which are never longer.
    block : Block
    """
    (table, boxes), (sizes, source) = tree, found
    x, box, h, by, values = block.x, block.box, block.h, block.by, block.values
    share, stack, m = block.share, block.stack, table.shape[0]
    for start in range(span[0], span[1], BLOCK):
        count = min(BLOCK, span[1] - start)
        worst = begin(points, axes, order[start : start + count], sizes, block)
        stack.box[0], stack.bound[0], height = 1, -math.inf, np.int64(1)
        while height > 0:
            given = (axes, box, g, x, h, count)
            leaf, height = _leaf_for_points(boxes, stack, height, worst, given)
            for k in range(*items_of_leaf(leaf, m)):
                if least_allowed(table, k, axes, box, g, edges) >= worst:
                    continue
                if radius is not None:
                    fill_arcs(table, k, axes, x, count, g, radius, values)
                else:
                    fill_values(table, k, axes, x, count, g, values, share, edges, faces)
                for i in range(count):
                    if values[i] < h[i]:
                        h[i], by[i] = -math.inf if once else values[i], k
                worst = largest(h, count)
        for i in range(count):
            if by[i] >= 0:
                sizes[order[start + i]] = h[i]
                source[order[start + i]] = by[i]
