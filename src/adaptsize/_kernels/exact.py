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
from adaptsize._kernels.linear_data import fill_edge, fill_face
from adaptsize._kernels.trees import DEPTH, LEAF, distance_to_box

#: Points of a block.
BLOCK = 32

# Bounds are lowered by this share, so that rounding discards no relevant entry.
SLACK = 1.0 - 1e-13


class Block(NamedTuple):
    """Scratch for the points of a block and the descent of a tree."""

    x: np.ndarray
    """float64[dim, BLOCK]: the points."""
    box: np.ndarray
    """float64[2 * dim]: their bounding box."""
    h: np.ndarray
    """float64[BLOCK]: sizes; -inf where nothing is to be lowered."""
    by: np.ndarray
    """int64[BLOCK]: the entry that lowered each point, -1 if none."""
    values: np.ndarray
    """float64[BLOCK]: sizes that one entry allows."""
    share: np.ndarray
    """float64[BLOCK]: weight of the second vertex of an edge at its minimising point."""
    stack: np.ndarray
    """int64[DEPTH]: boxes of the tree."""
    bound: np.ndarray
    """float64[DEPTH]: lower bounds of what they allow in the block."""


def new_block(dim: int) -> Block:
    """Return scratch for one thread."""
    return Block(
        np.empty((dim, BLOCK)),
        np.empty(2 * dim),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK),
        np.empty(BLOCK),
        np.empty(DEPTH, np.int64),
        np.empty(DEPTH),
    )


@lean
def gather(points, axes, order, start, count, x, box):
    """Copy the points order[start : start + count] to x, and bound them by ``box``."""
    dim = len(axes)
    for d in range(dim):
        low, high = math.inf, -math.inf
        for i in range(count):
            value = points[order[start + i], d]
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
def push_children(boxes, axes, b, box, g, worst, stack, bound, size):
    """Push the halves of box b that may lower a size, the more promising one last.

    Returns the new size of the stack.
    """
    value = 2 * len(axes)
    near, far = 2 * b, 2 * b + 1
    at_near = SLACK * (boxes[near, value] + g * distance_to_box(boxes, near, axes, box))
    at_far = SLACK * (boxes[far, value] + g * distance_to_box(boxes, far, axes, box))
    if at_far < at_near:
        near, far, at_near, at_far = far, near, at_far, at_near
    if at_far < worst:
        stack[size], bound[size] = far, at_far
        size += 1
    if at_near < worst:
        stack[size], bound[size] = near, at_near
        size += 1
    return size


@lean
def _reaches(boxes, b, axes, x, h, count, g):
    """Return whether box b may lower any of the points x[:, :count] of a block, of sizes h.

    The test pays near the leaves, where it avoids testing all entries of a box on all points.
    """
    dim = len(axes)
    for i in range(count):
        square = 0.0
        for d in range(dim):
            gap = max(boxes[b, d] - x[d, i], x[d, i] - boxes[b, dim + d])
            if gap > 0.0:
                square += gap * gap
        if SLACK * (boxes[b, 2 * dim] + g * math.sqrt(square)) < h[i]:
            return True
    return False


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
def fill_values(table, k, axes, x, count, g, values, share, edges, faces):
    """Fill the sizes that entry k allows at points, inf where the minimum is at an end of an edge.

    ``edges`` and ``faces`` are None if there are no such entries; their code is then not compiled.
    """
    dim = len(axes)
    if faces is not None and table[k, dim * dim + dim - 1] < math.inf:
        fill_face(table, k, x, count, g, values)
        return
    if edges is not None and table[k, dim * dim + 1] < math.inf:
        fill_edge(table, k, axes, x, count, g, values, share)
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
def lower_sizes(
    points,
    axes,
    order,
    first,
    last,
    table,
    boxes,
    g,
    sizes,
    source,
    once,
    edges,
    faces,
    radius,
    block,
):
    """Lower the sizes of points to the minimum that entries allow, without regard to visibility.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    order : int32[n]
        The points along a Morton curve.
    first, last : int
        The part of ``order`` to process; ``first`` a multiple of BLOCK.
    table : float64[m, dim * (dim + 1)]
        Entries.
    boxes : float64[2 * n_leaves, 2 * dim + 1]
        The tree over them (see trees.py).
    g : float64
    sizes : float64[n]
        In/Out.
    source : int32[n]
        In/Out: the entry where a size was lowered.
    once : bool
        Whether to lower each size once only, which is enough to know that it is not kept.
    edges, faces : None or bool
        None if there are no edges (triangles) among the entries.
    radius : None or float64
        Radius of a sphere around 0 on which all points lie and along which distances run; there
        are only nodes then.  Boxes are compared by chords, which are never longer.
    block : Block
    """
    x, box, h, by, values = block.x, block.box, block.h, block.by, block.values
    share, stack, bound = block.share, block.stack, block.bound
    m, n_leaves = table.shape[0], boxes.shape[0] // 2
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        gather(points, axes, order, start, count, x, box)
        for i in range(count):
            h[i], by[i] = sizes[order[start + i]], -1
        worst = largest(h, count)
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0:
            size -= 1
            b = stack[size]
            if bound[size] >= worst:
                continue
            if 4 * b >= n_leaves and not _reaches(boxes, b, axes, x, h, count, g):
                continue
            if b < n_leaves:
                size = push_children(boxes, axes, b, box, g, worst, stack, bound, size)
                continue
            for k in range((b - n_leaves) * LEAF, min(m, (b - n_leaves + 1) * LEAF)):
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
