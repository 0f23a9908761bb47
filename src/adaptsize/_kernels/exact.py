"""The limited size in a convex domain: the minimum of finitely many cones, found by trees.

A node, an edge or a triangle on which the bound h0 is linear is an *entry*.  It allows the size

    min over its points y of  h0(y) + g |x - y|

at x (closed forms: local_updates.py), and the limited size is the minimum of these.  Only the
*survivors* matter, the nodes that keep their bound: if h0_i + g |x_i - x_j| < h0_j, then
i allows less than j everywhere, by the triangle inequality.  The same holds for an edge or
triangle all of whose vertices one cone dominates, since a cone is convex and h0 is linear there.

Points are processed in *blocks* of consecutive points along a Morton curve.  For each block, the
tree of the entries is descended as long as

    least value of a box + g (distance of box and block)

is below the largest size in the block.  The remaining entries are tested on all points of the
block.  The result is the minimum of a finite set of numbers and does not depend on the order of
nodes and blocks.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.trees import DEPTH, LEAF, distance_to_box

#: Points of a block.
BLOCK = 32

# Bounds are lowered by this share, so that rounding discards no relevant entry.
SLACK = 1.0 - 1e-13


class Entries(NamedTuple):
    """Nodes, edges and triangles with linear bounds, sorted along a Morton curve."""

    places: np.ndarray
    """float64[m, dim, dim]: vertices of each entry; unused rows are arbitrary."""
    sizes: np.ndarray
    """float64[m, dim]: bounds at the vertices."""
    counts: np.ndarray
    """int8[m]: 1, 2 or 3 vertices."""
    boxes: np.ndarray
    """float64[2 * n_leaves, 2 * dim + 1]: the tree over them (see trees.py)."""
    n_leaves: int


@inner
def gather_block(points, axes, order, start, stop, x, box):
    """Copy the points order[start:stop] to x, float64[dim, BLOCK], and bound them by ``box``."""
    dim = len(axes)
    for d in range(dim):
        box[d], box[dim + d] = math.inf, -math.inf
        for i in range(stop - start):
            value = points[order[start + i], d]
            x[d, i] = value
            box[d] = min(box[d], value)
            box[dim + d] = max(box[dim + d], value)


@inner
def push_children(entries, axes, b, box, g, worst, stack, bound, size):
    """Push the halves of box b that may lower a size, the more promising one last.

    Returns the new size of the stack.
    """
    boxes, dim = entries.boxes, len(axes)
    near, far = 2 * b, 2 * b + 1
    at_near = SLACK * (boxes[near, 2 * dim] + g * distance_to_box(boxes, near, axes, box))
    at_far = SLACK * (boxes[far, 2 * dim] + g * distance_to_box(boxes, far, axes, box))
    if at_far < at_near:
        near, far = far, near
        at_near, at_far = at_far, at_near
    if at_far < worst:
        stack[size], bound[size] = far, at_far
        size += 1
    if at_near < worst:
        stack[size], bound[size] = near, at_near
        size += 1
    return size


@inner
def reaches(entries, b, axes, x, h, count, g):
    """Return whether box b may lower any of the points x[:, :count] of a block, of sizes h.

    The test pays near the leaves, where it avoids testing all entries of a box on all points.
    """
    boxes, dim = entries.boxes, len(axes)
    for i in range(count):
        square = 0.0
        for d in range(dim):
            gap = max(boxes[b, d] - x[d, i], x[d, i] - boxes[b, dim + d])
            if gap > 0.0:
                square += gap * gap
        if SLACK * (boxes[b, 2 * dim] + g * math.sqrt(square)) < h[i]:
            return True
    return False


@inner
def least_allowed(entries, k, axes, box, g):
    """Return a lower bound for the size that entry k allows in a box."""
    square = 0.0
    for d in range(len(axes)):
        low = high = entries.places[k, 0, d]
        for v in range(1, entries.counts[k]):
            low = min(low, entries.places[k, v, d])
            high = max(high, entries.places[k, v, d])
        gap = max(low - box[len(axes) + d], box[d] - high)
        if gap > 0.0:
            square += gap * gap
    base = entries.sizes[k, 0]
    for v in range(1, entries.counts[k]):
        base = min(base, entries.sizes[k, v])
    return SLACK * (base + g * math.sqrt(square))


@inner
def fill_cone(entries, k, x, count, axes, g, values):
    """Fill the sizes that the node k of the entries allows at the points x[:, :count]."""
    base = entries.sizes[k, 0]
    for i in range(count):
        square = 0.0
        for d in range(len(axes)):
            square += (x[d, i] - entries.places[k, 0, d]) ** 2
        values[i] = base + g * math.sqrt(square)


@kernel
def lower_sizes(points, axes, order, first, last, entries, g, sizes, source):
    """Lower the sizes of points to the minimum that nodes allow, without regard to visibility.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    order : int32[n]
        The points along a Morton curve.
    first, last : int
        The part of ``order`` to process; ``first`` a multiple of BLOCK.
    entries : Entries
        Nodes only.
    g : float64
    sizes : float64[n]
        In/Out.
    source : int32[n]
        In/Out: the entry where a size was lowered.
    """
    dim = len(axes)
    m = entries.counts.shape[0]
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    box = np.empty(2 * dim)
    x, values, h = np.empty((dim, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    by = np.empty(BLOCK, np.int32)
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        count = stop - start
        gather_block(points, axes, order, start, stop, x, box)
        worst = -math.inf
        for i in range(count):
            h[i] = sizes[order[start + i]]
            by[i] = -1
            worst = max(worst, h[i])
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0:
            size -= 1
            b = stack[size]
            if bound[size] >= worst:
                continue
            if 4 * b >= entries.n_leaves and not reaches(entries, b, axes, x, h, count, g):
                continue
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, worst, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                if least_allowed(entries, k, axes, box, g) >= worst:
                    continue
                fill_cone(entries, k, x, count, axes, g, values)
                worst = -math.inf
                for i in range(count):
                    if values[i] < h[i]:
                        h[i], by[i] = values[i], k
                    worst = max(worst, h[i])
        for i in range(count):
            if by[i] >= 0:
                sizes[order[start + i]] = h[i]
                source[order[start + i]] = by[i]


@kernel
def find_survivors(points, axes, order, first, last, entries, g, sizes, survives):
    """Find the nodes that keep their bound: no entry allows less there.

    Parameters
    ----------
    points, axes, order, first, last, entries, g
        As in `lower_sizes`.
    sizes : float64[n]
        Bounds of ``points``.
    survives : bool[n]
        Out, for the points in ``order``.
    """
    dim = len(axes)
    m = entries.counts.shape[0]
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    box = np.empty(2 * dim)
    x, values, h = np.empty((dim, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    node = np.empty(BLOCK, np.int64)
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        count = stop - start
        gather_block(points, axes, order, start, stop, x, box)
        worst = -math.inf
        for i in range(count):
            node[i] = order[start + i]
            h[i] = sizes[node[i]]
            survives[node[i]] = True
            worst = max(worst, h[i])
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0 and count > 0:
            size -= 1
            b = stack[size]
            if bound[size] >= worst:
                continue
            if 4 * b >= entries.n_leaves and not reaches(entries, b, axes, x, h, count, g):
                continue
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, worst, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                if least_allowed(entries, k, axes, box, g) >= worst:
                    continue
                fill_cone(entries, k, x, count, axes, g, values)
                left = 0
                worst = -math.inf
                for i in range(count):
                    if values[i] < h[i]:
                        survives[node[i]] = False
                        continue
                    for d in range(dim):
                        x[d, left] = x[d, i]
                    h[left], node[left] = h[i], node[i]
                    worst = max(worst, h[i])
                    left += 1
                count = left
