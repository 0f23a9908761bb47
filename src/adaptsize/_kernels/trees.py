"""Trees of boxes over points, segments, triangles or tetrahedra, and the descent of a tree.

The boxes form a binary heap: box 1 is the root, 2 b and 2 b + 1 are the halves of box b, and leaf l
is box ``n_leaves + l``, the number of leaves being a power of 2.  There are two kinds of trees.

* Trees of items that are sorted along a Morton curve.  Every `LEAF` consecutive items share a leaf
  (`items_of_leaf`).  A box is one row of ``boxes``: lower corner, upper corner, and the least value
  in it, so that  value + g dist(x, box)  is a lower bound for all that the items in the box allow
  at x.  Empty boxes have the value inf and lie at infinity.
* Trees of cells in space.  Each box is halved along the longest side, by number (`sort_for_tree`).
  The halves overlap by no more than the size of a cell.  All leaves have the same number of cells,
  or one more (`cells_of_leaf`).  A box is a lower and an upper corner, float64[6].
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import generated, inner, lean, lean_kernel
from adaptsize._kernels.vectors import triple

#: Items of a leaf.
LEAF = 4
# The inverse of no change: a side that rests reaches nothing further within any time.
_NEVER = 1e300

#: Rows of a stack on which a depth-first descent finds room, with at most 2^31 leaves.
DEPTH = 64


class Tree(NamedTuple):
    """Cells in a tree.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        In the order of the tree.
    boxes : float64[2 * n_leaves, 6]
    """

    points: np.ndarray
    cells: np.ndarray
    boxes: np.ndarray


class Stack(NamedTuple):
    """Scratch for the descent of a tree, the nearer half first.

    Parameters
    ----------
    box : int64[DEPTH]
    bound : float64[DEPTH]
        Lower bounds of what the boxes contain.
    """

    box: np.ndarray
    bound: np.ndarray


@lean_kernel
def fill_boxes(lower, upper, value, boxes):
    """Fill the boxes of a tree over items sorted along a curve.

    Parameters
    ----------
    lower, upper : float64[m, dim]
        Boxes around the items.
    value : float64[m]
        Least values in the items.
    boxes : float64[2 * n_leaves, 2 * dim + 1]
        Out.
    """
    (m, dim), n_leaves = lower.shape, boxes.shape[0] // 2
    boxes[0] = 0.0
    boxes[0, 2 * dim] = math.inf
    for b in range(2 * n_leaves - 1, 0, -1):
        for d in range(dim):
            boxes[b, d], boxes[b, dim + d] = math.inf, -math.inf
        boxes[b, 2 * dim] = math.inf
        if b < n_leaves:
            for child in range(2 * b, 2 * b + 2):
                for d in range(dim):
                    boxes[b, d] = min(boxes[b, d], boxes[child, d])
                    boxes[b, dim + d] = max(boxes[b, dim + d], boxes[child, dim + d])
                boxes[b, 2 * dim] = min(boxes[b, 2 * dim], boxes[child, 2 * dim])
            continue
        for k in range((b - n_leaves) * LEAF, min(m, (b - n_leaves + 1) * LEAF)):
            for d in range(dim):
                boxes[b, d] = min(boxes[b, d], lower[k, d])
                boxes[b, dim + d] = max(boxes[b, dim + d], upper[k, d])
            boxes[b, 2 * dim] = min(boxes[b, 2 * dim], value[k])


@lean_kernel
def fill_boxes_of_cells(points, cells, boxes):
    """Fill the boxes of a tree over cells.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        In the order of the tree.
    boxes : float64[2 * n_leaves, 6]
        Out.
    """
    (m, k), n_leaves = cells.shape, boxes.shape[0] // 2
    boxes[0] = 0.0
    for b in range(2 * n_leaves - 1, 0, -1):
        first, last = (b - n_leaves) * m // n_leaves, (b - n_leaves + 1) * m // n_leaves
        for d in range(3):
            lower, upper = math.inf, -math.inf
            if b < n_leaves:
                lower = min(boxes[2 * b, d], boxes[2 * b + 1, d])
                upper = max(boxes[2 * b, 3 + d], boxes[2 * b + 1, 3 + d])
            else:
                for c in range(first, last):
                    for v in range(k):
                        lower = min(lower, points[cells[c, v], d])
                        upper = max(upper, points[cells[c, v], d])
            boxes[b, d], boxes[b, 3 + d] = lower, upper


def new_stack() -> Stack:
    """Return scratch for one thread."""
    return Stack(np.empty(DEPTH, np.int64), np.empty(DEPTH))


def descent(is_near):
    """Return a function that descends a tree to the next leaf that is near.

    ``is_near(boxes, b, given)`` is whether box b is entered.  The second half of a box comes first.
    A descent begins with the root, box 1, on the stack, int64[DEPTH], and height 1.  The function
    returns a leaf and the height of the stack, or -1 and 0 at the end.
    """

    @generated
    def next_leaf(boxes, stack, height, given):
        n_leaves = boxes.shape[0] // 2
        while height > 0:
            height -= 1
            b = stack[height]
            if not is_near(boxes, b, given):
                continue
            if b >= n_leaves:
                return b - n_leaves, height
            stack[height], stack[height + 1] = 2 * b, 2 * b + 1
            height += 2
        return np.int64(-1), np.int64(0)

    return next_leaf


def descent_by_bound(bound_of):
    """Return a function that descends a tree as that of `descent`, to bounds below a limit.

    ``bound_of(boxes, b, given)`` is a lower bound of what box b contains.  The half with the
    smaller bound comes first.
    """

    @generated
    def next_leaf(boxes, stack, height, limit, given):
        n_leaves = boxes.shape[0] // 2
        while height > 0:
            height -= 1
            b = stack.box[height]
            if stack.bound[height] >= limit:
                continue
            if b >= n_leaves:
                return b - n_leaves, height
            near, far = 2 * b, 2 * b + 1
            at_near, at_far = bound_of(boxes, near, given), bound_of(boxes, far, given)
            if at_far < at_near:
                near, far, at_near, at_far = far, near, at_far, at_near
            if at_far < limit:
                stack.box[height], stack.bound[height] = far, at_far
                height += 1
            if at_near < limit:
                stack.box[height], stack.bound[height] = near, at_near
                height += 1
        return np.int64(-1), np.int64(0)

    return next_leaf


@lean
def items_of_leaf(leaf, n_items):
    """Return the range of the items of a leaf, none for leaf -1."""
    return max(leaf, 0) * LEAF, min(n_items, (leaf + 1) * LEAF)


@lean
def cells_of_leaf(leaf, boxes, n_cells):
    """Return the range of the cells of a leaf, none for leaf -1."""
    n_leaves = boxes.shape[0] // 2
    return max(leaf, 0) * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves


@lean
def set_shaft(a, b, which, m, axes, slack, shaft):
    """Fill the box around some points a, and its change on the way to the box of the points b.

    The *shaft* of two boxes is their hull: the union of the boxes between them, whose corners move
    from those of one to those of the other.

    Parameters
    ----------
    a, b : float64[dim, n]
    which : int64[n]
        The numbers of m points.
    m : int
    axes : tuple of length dim
    slack : float
        Width that is added around the boxes.
    shaft : float64[6 * dim]
        Out: lower and upper corner, their changes, and the inverses of these.
    """
    dim = len(axes)
    for d in range(dim):
        a_low = b_low = math.inf
        a_high = b_high = -math.inf
        for k in range(m):
            at, to = a[d, which[k]], b[d, which[k]]
            a_low, a_high = min(a_low, at), max(a_high, at)
            b_low, b_high = min(b_low, to), max(b_high, to)
        shaft[d], shaft[dim + d] = a_low - slack, a_high + slack
        shaft[2 * dim + d], shaft[3 * dim + d] = b_low - a_low, b_high - a_high
        # A box that the resting side does not reach is beyond it at all times from 0 to 1.
        shaft[4 * dim + d] = _inverse(b_low - a_low, _NEVER)
        shaft[5 * dim + d] = _inverse(b_high - a_high, -_NEVER)


@lean
def _inverse(change, otherwise):
    """Return 1 / change, ``otherwise`` if it would not be a number."""
    return 1.0 / change if abs(change) > 1.0 / _NEVER else otherwise


@lean
def _meets_shaft(boxes, b, given):
    """Return whether box b meets a shaft: one of the boxes at the times 0 to 1."""
    shaft, axes = given
    dim, begin, end = len(axes), 0.0, 1.0
    for d in range(dim):
        # The upper side of the box is above the lower side of the other, and vice versa.
        inverse = shaft[4 * dim + d]
        time = (boxes[b, dim + d] - shaft[d]) * inverse
        if inverse > 0.0:
            end = min(end, time)
        else:
            begin = max(begin, time)
        inverse = shaft[5 * dim + d]
        time = (boxes[b, d] - shaft[dim + d]) * inverse
        if inverse < 0.0:
            end = min(end, time)
        else:
            begin = max(begin, time)
    return begin <= end


#: Descends to the leaves in a shaft; ``given``: the shaft and ``axes``.
leaf_in_shaft = descent(_meets_shaft)


@lean
def gap2_to_box(boxes, b, axes, corners):
    """Return the squared distance between box b and the box with two corners, low and high."""
    (low, high), dim = corners, len(axes)
    square = 0.0
    for d in range(dim):
        gap = max(boxes[b, d] - high[d], low[d] - boxes[b, dim + d])
        if gap > 0.0:
            square += gap * gap
    return square


@lean
def distance_to_box(boxes, b, axes, box):
    """Return the distance of box b of a tree from the box float64[2 * dim]; inf if b is empty."""
    return math.sqrt(gap2_to_box(boxes, b, axes, (box, box[len(axes) :])))


@lean
def box_of_cell(points, cells, c):
    """Return the corners of the bounding box of a cell in space, as tuples."""
    low = high = triple(points, cells[c, 0], 0)
    for v in range(1, cells.shape[1]):
        x = triple(points, cells[c, v], 0)
        low = (min(low[0], x[0]), min(low[1], x[1]), min(low[2], x[2]))
        high = (max(high[0], x[0]), max(high[1], x[1]), max(high[2], x[2]))
    return low, high


@inner
def distance2_to_box(boxes, node, x):
    """Return the squared distance of x, three floats, to the box of a node, 0 inside."""
    return gap2_to_box(boxes, node, x, (x, x))


#: Descends to the leaves nearest to a point, by squared distances.
nearest_leaf = descent_by_bound(distance2_to_box)


@lean
def _is_within(boxes, b, given):
    """Return whether box b is near a box; ``given``: its corners, and the squared distance."""
    (low, high), reach2 = given
    return gap2_to_box(boxes, b, low, (low, high)) <= reach2


#: Descends to the leaves that are near a box in space; its corners are tuples.
leaf_within = descent(_is_within)
