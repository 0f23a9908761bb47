"""Splitting of the boxes of a Cartesian grid into simplices."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from adaptsize.typing import BoolArray, IntArray


def simplices_of_boxes(shape: tuple[int, ...]) -> IntArray:
    """Return the Kuhn simplices of each box of a grid, mirrored from box to box.

    A Kuhn simplex follows the axes, in one of the ``dim!`` orders, from one corner of the
    box to the opposite one.  The first corner is the one with even indices.  Neighbouring boxes
    are therefore mirror images and split the face between them in the same way.

    Parameters
    ----------
    shape : tuple of int
        Nodes per axis, the last axis fastest.

    Returns
    -------
    int32[n_boxes along each axis ..., dim!, dim + 1]
        Nodes of the simplices, all of positive orientation.
    """
    dim = len(shape)
    strides = [int(np.prod(shape[d + 1 :], dtype=np.int64)) for d in range(dim)]
    number = np.arange(np.prod(shape, dtype=np.int64), dtype=np.int32).reshape(shape)
    first = number[(slice(-1),) * dim]
    orders = list(permutations(range(dim)))
    cells = np.empty((*first.shape, len(orders), dim + 1), np.int32)
    for odd in product((0, 1), repeat=dim):
        boxes = tuple(slice(is_odd, None, 2) for is_odd in odd)
        start = sum(stride for stride, is_odd in zip(strides, odd, strict=True) if is_odd)
        for m, order in enumerate(orders):
            steps = [strides[d] * (1 - 2 * odd[d]) for d in order]
            path = start + np.concatenate([[0], np.cumsum(steps)]).astype(np.int32)
            if (_is_odd(order) + sum(odd)) % 2 == 1:
                path[[-2, -1]] = path[[-1, -2]]
            cells[..., m, :][boxes] = first[boxes][..., None] + path
    return cells


def both_ways(finite: BoolArray, active: BoolArray | None) -> IntArray:
    """Return the triangles into which both diagonals split the whole boxes of a plane grid.

    If data are finite at exactly three corners, only the triangles of the diagonal to the fourth
    corner are returned.  The other diagonal would be a short cut for data along a line that
    turns a corner there.

    Parameters
    ----------
    finite : bool[shape]
        Nodes with data.
    active : bool[shape], optional
        Active nodes; all by default.

    Returns
    -------
    int32[m, 3]
    """
    number = np.arange(finite.size, dtype=np.int32).reshape(finite.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    whole = np.ones(corners[0].shape, np.bool_) if active is None else whole_boxes(active)
    a, b, c, d = (x[whole] for x in corners)
    has = finite.ravel()
    of_three = has[a].astype(np.int8) + has[b] + has[c] + has[d] == 3
    falling = np.where(of_three, ~(has[b] & has[c]), True)
    rising = np.where(of_three, ~(has[a] & has[d]), True)
    pieces = [np.stack(t, axis=1)[falling] for t in ((a, b, c), (b, d, c))]
    pieces += [np.stack(t, axis=1)[rising] for t in ((a, b, d), (a, d, c))]
    return np.concatenate(pieces)


def whole_boxes(active: BoolArray) -> BoolArray:
    """Return which boxes of a grid have active corners only."""
    whole = np.ones([n - 1 for n in active.shape], np.bool_)
    for corner in product((slice(None, -1), slice(1, None)), repeat=active.ndim):
        whole &= active[corner]
    return whole


def _is_odd(order: tuple[int, ...]) -> int:
    """Return 1 for an odd permutation, 0 for an even one."""
    pairs = [(a, b) for i, a in enumerate(order) for b in order[i + 1 :]]
    return sum(a > b for a, b in pairs) % 2
