"""Trees of boxes over points, segments or triangles, sorted along a Morton curve.

Items are sorted along the curve; every `LEAF` consecutive ones share a leaf; the boxes of the
leaves and of their unions form a binary heap: box 1 is the root, 2 b and 2 b + 1 are the
halves of box b, and leaf l is box ``n_leaves + l``, the number of leaves being a power of 2.
A box is one row of ``boxes``: lower corner, upper corner, and the least value in it, so that

    value + g dist(x, box)

is a lower bound for all that the items in the box allow at x.  Empty boxes have the
value inf and lie at infinity.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel

#: Items of a leaf.
LEAF = 4

#: Rows of a stack on which a depth-first descent finds room, with at most 2^31 leaves.
DEPTH = 64

# Bits of a Morton key that are sorted at a time: three levels of a quadtree, two of an octree.
_DIGIT = 6
_BUCKETS = 1 << _DIGIT

# Buckets of so few items are sorted by insertion.
_FEW = 24


@kernel
def fill_keys(points, axes, lower, scale, keys):
    """Fill the Morton keys of points: bits of the coordinates in turn, the highest first.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    lower : float64[dim]
    scale : float64
        Coordinates less ``lower`` times this are in [0, 2^21).
    keys : uint64[n]
        Out: 21 bits per axis, in the upper bits of 63.
    """
    dim = len(axes)
    for i in range(points.shape[0]):
        key = np.uint64(0)
        for d in range(dim):
            x = np.uint64((points[i, d] - lower[d]) * scale)
            if dim == 2:
                x = (x | (x << np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
                x = (x | (x << np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
                x = (x | (x << np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
                x = (x | (x << np.uint64(2))) & np.uint64(0x3333333333333333)
                x = (x | (x << np.uint64(1))) & np.uint64(0x5555555555555555)
            elif dim == 3:
                x = (x | (x << np.uint64(32))) & np.uint64(0x001F00000000FFFF)
                x = (x | (x << np.uint64(16))) & np.uint64(0x001F0000FF0000FF)
                x = (x | (x << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
                x = (x | (x << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
                x = (x | (x << np.uint64(2))) & np.uint64(0x1249249249249249)
            key |= x << np.uint64(d)
        keys[i] = key


@inner
def _insertion_sort(keys, order, first, last):
    for i in range(first + 1, last):
        key, item = keys[i], order[i]
        j = i
        while j > first and keys[j - 1] > key:
            keys[j], order[j] = keys[j - 1], order[j - 1]
            j -= 1
        keys[j], order[j] = key, item


@kernel
def sort_by_keys(keys, order, other_keys, other_order, top):
    """Sort items by their keys, from the highest digits down, ties in any fixed order.

    Buckets of the highest digit are split by the next one, until few are left in each: a
    uniform set of n points takes log2(n) / 6 rounds, and a graded one more of them only where
    it is fine.

    Parameters
    ----------
    keys : uint64[n]
        In/Out: sorted.
    order : int32[n]
        Out: the items in the order of their keys.
    other_keys, other_order : uint64[n], int32[n]
        Scratch.
    top : int
        Number of bits of a key.
    """
    n = keys.shape[0]
    for i in range(n):
        order[i] = i
    counts = np.empty(_BUCKETS + 1, np.int64)
    # Each entry: first, last, shift; the items of one bucket wait while the next are split.
    stack = np.empty((_BUCKETS * (top // _DIGIT + 2), 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, n, top - _DIGIT
    size = 1
    while size > 0:
        size -= 1
        first, last, shift = stack[size, 0], stack[size, 1], stack[size, 2]
        if last - first <= _FEW:
            _insertion_sort(keys, order, first, last)
            continue
        bits = np.uint64(max(shift, 0))
        counts[:] = 0
        for i in range(first, last):
            counts[((keys[i] >> bits) & np.uint64(_BUCKETS - 1)) + np.uint64(1)] += 1
        for b in range(_BUCKETS):
            counts[b + 1] += counts[b]
        for i in range(first, last):
            b = (keys[i] >> bits) & np.uint64(_BUCKETS - 1)
            to = first + counts[b]
            counts[b] += 1
            other_keys[to], other_order[to] = keys[i], order[i]
        for i in range(first, last):
            keys[i], order[i] = other_keys[i], other_order[i]
        if shift <= 0:
            continue
        begin = first
        for b in range(_BUCKETS):
            end = first + counts[b]
            if end - begin > 1:
                stack[size, 0], stack[size, 1], stack[size, 2] = begin, end, shift - _DIGIT
                size += 1
            begin = end


@kernel
def fill_boxes(lower, upper, value, axes, n_leaves, boxes):
    """Fill the boxes of a tree over sorted items.

    Parameters
    ----------
    lower, upper : float64[m, dim]
        Boxes of the items.
    value : float64[m]
        Least value of each.
    axes : tuple of length dim
    n_leaves : int
        A power of 2, at least m / LEAF.
    boxes : float64[2 * n_leaves, 2 * dim + 1]
        Out.
    """
    dim = len(axes)
    m = value.shape[0]
    for d in range(dim):
        boxes[0, d] = boxes[0, dim + d] = 0.0
    boxes[0, 2 * dim] = math.inf
    for leaf in range(n_leaves):
        row = n_leaves + leaf
        for d in range(dim):
            boxes[row, d] = math.inf
            boxes[row, dim + d] = -math.inf
        boxes[row, 2 * dim] = math.inf
        for i in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
            for d in range(dim):
                boxes[row, d] = min(boxes[row, d], lower[i, d])
                boxes[row, dim + d] = max(boxes[row, dim + d], upper[i, d])
            boxes[row, 2 * dim] = min(boxes[row, 2 * dim], value[i])
    for back in range(1, n_leaves):
        row = n_leaves - back
        for d in range(dim):
            boxes[row, d] = min(boxes[2 * row, d], boxes[2 * row + 1, d])
            boxes[row, dim + d] = max(boxes[2 * row, dim + d], boxes[2 * row + 1, dim + d])
        boxes[row, 2 * dim] = min(boxes[2 * row, 2 * dim], boxes[2 * row + 1, 2 * dim])


@inner
def distance_to_box(boxes, b, axes, box):
    """Return the distance of box b of a tree from the box float64[2 * dim]; inf if b is empty."""
    dim = len(axes)
    square = 0.0
    for d in range(dim):
        gap = max(boxes[b, d] - box[dim + d], box[d] - boxes[b, dim + d])
        if gap > 0.0:
            square += gap * gap
    return math.sqrt(square)


@kernel
def fill_extent(points, axes, extent):
    """Fill the lower and the upper corner of points, float64[2 * dim]."""
    dim = len(axes)
    for d in range(dim):
        extent[d] = extent[dim + d] = points[0, d]
    for i in range(points.shape[0]):
        for d in range(dim):
            extent[d] = min(extent[d], points[i, d])
            extent[dim + d] = max(extent[dim + d], points[i, d])


@kernel
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
