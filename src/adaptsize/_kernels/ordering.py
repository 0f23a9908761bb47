"""Orders of points along Morton curves, of nodes of grids by tiles, and of cells in trees."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel, lean_kernel

#: Bits per axis of a Morton key.
BITS = 21
#: Bits of a key that are sorted at a time; three digits of one axis fit into a key of 63 bits.
DIGIT = 11


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
def fill_keys(points, curve, keys):
    """Fill the keys of points: the bits of the coordinates in turn, the highest first.

    Parameters
    ----------
    points : float64[n, dim]
    curve : Curve
    keys : int64[n]
        Out.
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
        keys[i] = key


@lean_kernel
def deal(keys, span, shift, places, dealt, order):
    """Put keys, and their numbers, into buckets by their highest bits.

    Parameters
    ----------
    keys : int64[n]
    span : tuple of int
        The first and the last key to process.
    shift : int
        Number of lower bits.
    places : int64[n_buckets]
        In/Out: the next place in each bucket.
    dealt, order : int64[n], int32[n]
        Out: keys, and their numbers.
    """
    for i in range(span[0], span[1]):
        b = keys[i] >> shift
        to = places[b]
        places[b] = to + 1
        dealt[to], order[to] = keys[i], i


@lean_kernel
def sort_keys(keys, order, span, bits, counts):
    """Sort keys by their lower bits, equal ones in their order.

    They are sorted by one digit after another, from the lowest to the highest.

    Parameters
    ----------
    keys, order : int64[2, n], int32[2, n]
        In/Out: keys, and their numbers; the second rows are scratch.
    span : tuple of int
        The first and the last key to sort.
    bits : int
    counts : int64[2^DIGIT]
        Scratch.
    """
    first, last = span
    mask = 2**DIGIT - 1
    here = 0
    for shift in range(0, bits, DIGIT):
        for b in range(mask + 1):
            counts[b] = 0
        for i in range(first, last):
            counts[(keys[here, i] >> shift) & mask] += 1
        total = first
        for b in range(mask + 1):
            total += counts[b]
            counts[b] = total - counts[b]
        for i in range(first, last):
            b = (keys[here, i] >> shift) & mask
            to = counts[b]
            counts[b] = to + 1
            keys[1 - here, to], order[1 - here, to] = keys[here, i], order[here, i]
        here = 1 - here
    if here == 1:
        for i in range(first, last):
            keys[0, i], order[0, i] = keys[1, i], order[1, i]


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
def _select(keys, axis, order, span, middle):
    """Move the cells of smaller keys before place ``middle``, the others behind (quickselect).

    ``keys``: float64[m, dim], of which one column, ``axis``, counts; ``span``: the first and the
    last place.  In/Out: ``keys`` and ``order``.
    """
    low, high = span
    while low < high:
        pivot = keys[(low + high) // 2, axis]
        i, j = low, high
        while i <= j:
            while keys[i, axis] < pivot:
                i += 1
            while keys[j, axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for d in range(keys.shape[1]):
                    keys[i, d], keys[j, d] = keys[j, d], keys[i, d]
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
    centroids : float64[m, dim]
        In/Out.  Centroids along a space-filling curve are faster.
    n_leaves : int
        Power of 2, at most m.
    order : int64[m]
        In/Out: numbers of the cells.
    """
    m, dim = centroids.shape
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
        for d in range(dim):
            lower = math.inf
            upper = -math.inf
            for place in range(first, last):
                lower = min(lower, centroids[place, d])
                upper = max(upper, centroids[place, d])
            if upper - lower > longest:
                axis = d
                longest = upper - lower
        middle = (leaf + width // 2) * m // n_leaves
        _select(centroids, axis, order, (first, last - 1), middle)
