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

from adaptsize._kernels.compiling import lean, lean_kernel

#: Items of a leaf.
LEAF = 4

#: Rows of a stack on which a depth-first descent finds room, with at most 2^31 leaves.
DEPTH = 64

#: Bits per axis of a Morton key.
BITS = 21

#: Bits of a key that are sorted at a time; three digits of one axis fit into a key of 63 bits.
DIGIT = 11


@lean_kernel
def sort_along_curve(points, axes, lower, scale, spread, keys, order, counts):
    """Sort points along a Morton curve, equal keys by their number.

    A key has the bits of the coordinates in turn, the highest first.  Keys are sorted by one digit
    after another, from the lowest to the highest.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    lower : float64[dim]
    scale : float64
        Coordinates less ``lower`` times this are in [0, 2^BITS); others, and nan, count as 0.
    spread : int64[2^DIGIT]
        Numbers with dim - 1 zeros after each of their bits.
    keys : int64[2, n]
        Out: the sorted keys, and scratch.
    order : int32[2, n]
        Out: the numbers of the points, and scratch.
    counts : int64[2^DIGIT]
        Scratch.
    """
    dim = len(axes)
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
def distance_to_box(boxes, b, axes, box):
    """Return the distance of box b of a tree from the box float64[2 * dim]; inf if b is empty."""
    dim = len(axes)
    square = 0.0
    for d in range(dim):
        gap = max(boxes[b, d] - box[dim + d], box[d] - boxes[b, dim + d])
        if gap > 0.0:
            square += gap * gap
    return math.sqrt(square)


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
