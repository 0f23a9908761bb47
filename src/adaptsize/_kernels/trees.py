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

from adaptsize._kernels.compiling import generated, inner, kernel, lean, lean_kernel
from adaptsize._kernels.vectors import triple

#: Items of a leaf.
LEAF = 4

#: Rows of a stack on which a depth-first descent finds room, with at most 2^31 leaves.
DEPTH = 64

#: Bits per axis of a Morton key.
BITS = 21

#: Bits of a key that are sorted at a time; three digits of one axis fit into a key of 63 bits.
DIGIT = 11


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
    shaft : float64[4 * dim]
        Out: lower and upper corner, and their changes.
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


@lean
def _meets_shaft(boxes, b, given):
    """Return whether box b meets a shaft: one of the boxes at the times 0 to 1."""
    shaft, axes = given
    dim, begin, end = len(axes), 0.0, 1.0
    for d in range(dim):
        # The lower side of the box is below the upper side of the other, and vice versa.
        for side in range(2):
            sign = 1.0 - 2.0 * side
            room = sign * (boxes[b, (1 - side) * dim + d] - shaft[side * dim + d])
            change = sign * shaft[(2 + side) * dim + d]
            if change > 0.0:
                end = min(end, room / change)
            elif change < 0.0:
                begin = max(begin, room / change)
            elif room < 0.0:
                return False
    return begin <= end


#: Descends to the leaves in a shaft; ``given``: the shaft and ``axes``.
leaf_in_shaft = descent(_meets_shaft)


class Curve(NamedTuple):
    """Where a Morton curve runs.

    Parameters
    ----------
    axes : tuple[int, ...]
        Of length dim.
    lower : float64[dim]
    scale : float
        Coordinates less ``lower`` times this are in [0, 2^BITS); others, and nan, count as
        0.
    spread : int64[2^DIGIT]
        Numbers with dim - 1 zeros after each of their bits.
    """

    axes: tuple[int, ...]
    lower: np.ndarray
    scale: float
    spread: np.ndarray


@lean_kernel
def sort_along_curve(points, curve, keys, order, counts):
    """Sort points along a Morton curve, equal keys by their number.

    A key has the bits of the coordinates in turn, the highest first.  Keys are sorted by one digit
    after another, from the lowest to the highest.

    Parameters
    ----------
    points : float64[n, dim]
    curve : Curve
    keys : int64[2, n]
        Out: the sorted keys, and scratch.
    order : int32[2, n]
        Out: the numbers of the points, and scratch.
    counts : int64[2^DIGIT]
        Scratch.
    """
    lower, scale, spread = curve.lower, curve.scale, curve.spread
    dim = len(curve.axes)
    mask = 2**DIGIT - 1
    for i in range(points.shape[0]):
        key = 0
        for d in range(dim):
            along = (points[i, d] - lower[d]) * scale
            x = int(along) if 0.0 <= along < 2.0**BITS else 0
            key |= (spread[x & mask] | (spread[x >> DIGIT] << (DIGIT * dim))) << d
        keys[0, i] = key
        order[0, i] = i
    here = 0
    for shift in range(0, BITS * dim, DIGIT):  # an even number of digits
        for b in range(mask + 1):
            counts[b] = 0
        for i in range(points.shape[0]):
            counts[(keys[here, i] >> shift) & mask] += 1
        total = 0
        for b in range(mask + 1):
            total += counts[b]
            counts[b] = total - counts[b]
        for i in range(points.shape[0]):
            b = (keys[here, i] >> shift) & mask
            to = counts[b]
            counts[b] = to + 1
            keys[1 - here, to], order[1 - here, to] = keys[here, i], order[here, i]
        here = 1 - here


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


@lean_kernel
def fill_tiles(shape, tile, order):
    """Fill the numbers of the nodes of a grid, tile by tile.

    Parameters
    ----------
    shape, tile : tuple of 3 int
        Numbers of nodes along the axes, of the grid and of a tile; 1 where there is no axis.
    order : int32[product of shape]
        Out.
    """
    count = 0
    for first_i in range(0, shape[0], tile[0]):
        for first_j in range(0, shape[1], tile[1]):
            for first_k in range(0, shape[2], tile[2]):
                for i in range(first_i, min(first_i + tile[0], shape[0])):
                    for j in range(first_j, min(first_j + tile[1], shape[1])):
                        for k in range(first_k, min(first_k + tile[2], shape[2])):
                            order[count] = (i * shape[1] + j) * shape[2] + k
                            count += 1


@inner
def _select(keys, axis, order, middle):
    """Move the cells of smaller keys before place ``middle``, the others behind (quickselect).

    ``keys``: float64[m, 3], of which one column, ``axis``, counts; ``order``: In/Out.
    """
    low, high = 0, order.shape[0] - 1
    while low < high:
        pivot = keys[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while keys[order[i], axis] < pivot:
                i += 1
            while keys[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def sort_for_tree(centroids, n_leaves, order):
    """Put cells in the order of a tree: each node is halved along the longest side.

    Halving by number keeps the tree complete; unlike runs along a space-filling curve,
    the halves of a box overlap by no more than the size of a cell.

    Parameters
    ----------
    centroids : float64[m, 3]
    n_leaves : int
        Power of 2, at most m.
    order : int64[m]
        In/Out: numbers of the cells.  Centroids along a space-filling curve are faster.
    """
    m = centroids.shape[0]
    for node in range(1, n_leaves):
        width = n_leaves  # number of leaves under the node
        level = node
        while level > 1:
            level >>= 1
            width >>= 1
        leaf = node * width - n_leaves
        first, last = leaf * m // n_leaves, (leaf + width) * m // n_leaves
        axis = np.int64(0)  # callees would be compiled for a literal, too
        longest = -1.0
        for d in range(3):
            lower = math.inf
            upper = -math.inf
            for place in range(first, last):
                lower = min(lower, centroids[order[place], d])
                upper = max(upper, centroids[order[place], d])
            if upper - lower > longest:
                axis = d
                longest = upper - lower
        _select(centroids, axis, order[first:last], (leaf + width // 2) * m // n_leaves - first)


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
