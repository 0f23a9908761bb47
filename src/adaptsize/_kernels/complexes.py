"""Simplices that are added, removed and changed one at a time, with those around each node.

Cells, facets and lines share one store, and each row holds a simplex of one of these levels.  Every
corner of a simplex is an entry of a doubly linked list, that of its node and level.  So a local
operation on a mesh takes a time that does not depend on the size of the mesh.  Few arrays hold it
all, since every function is passed all of them, which takes most of the time of compilation.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.compiling import lean, lean_kernel

#: Levels: cells; facets that bound or separate regions; lines.  Functions would be compiled once
#: for each of these numbers if they were Python's.
CELLS, FACETS, LINES = np.int64(0), np.int64(1), np.int64(2)
#: No node.
NONE = np.int64(-1)


class Complex(NamedTuple):
    """Simplices of two to four nodes.

    Parameters
    ----------
    nodes : int32[room, 4]
        Filled up with -1.
    about : int32[room, 3]
        The label of each simplex, a region or a group; its level, -1 if the row is not in use; and
        a stack of the rows that are not in use.
    links : int32[4 * room, 2]
        The next and the previous corner of the same level at the same node, or -1.  A corner is
        4 times the row and the place in the row.
    head : int32[n_points, 3]
        The first corner at each node, by level, or -1.
    n_free : int64[1]
        Number of rows that are not in use.
    """

    nodes: npt.NDArray[np.int32]
    about: npt.NDArray[np.int32]
    links: npt.NDArray[np.int32]
    head: npt.NDArray[np.int32]
    n_free: npt.NDArray[np.int64]


def new_complex(
    parts: list[tuple[np.int64, npt.NDArray[np.int32], npt.NDArray[np.int32]]],
    n_points: int,
    n_more: int,
) -> Complex:
    """Return a complex from levels, their simplices int32[m, k] and labels int32[m].

    It has room for ``n_points`` points and ``n_more`` simplices more.
    """
    count = sum(len(simplices) for _, simplices, _ in parts)
    room = count + n_more
    nodes, about = np.full((room, 4), -1, np.int32), np.full((room, 3), -1, np.int32)
    first = 0
    for level, simplices, label in parts:
        rows = slice(first, first + len(simplices))
        nodes[rows, : simplices.shape[1]] = simplices
        about[rows, 0], about[rows, 1] = label, level
        first += len(simplices)
    about[: room - count, 2] = np.arange(room - 1, count - 1, -1)
    links, head = np.full((4 * room, 2), -1, np.int32), np.full((n_points, 3), -1, np.int32)
    found = Complex(nodes, about, links, head, np.array([room - count], np.int64))
    link_rows(found, count)
    return found


@lean
def _link(cx, row, v):
    corner, node, level = 4 * row + v, cx.nodes[row, v], cx.about[row, 1]
    first = cx.head[node, level]
    cx.links[corner, 0] = first
    cx.links[corner, 1] = -1
    if first >= 0:
        cx.links[first, 1] = corner
    cx.head[node, level] = corner


@lean
def _unlink(cx, row, v):
    corner = 4 * row + v
    later, earlier = cx.links[corner, 0], cx.links[corner, 1]
    if earlier >= 0:
        cx.links[earlier, 0] = later
    else:
        cx.head[cx.nodes[row, v], cx.about[row, 1]] = later
    if later >= 0:
        cx.links[later, 1] = earlier


@lean_kernel
def link_rows(cx, count):
    """Link the first rows, so that the simplices around each node ascend."""
    for row in range(count - 1, -1, -1):
        for v in range(4):
            if cx.nodes[row, v] >= 0:
                _link(cx, row, v)


@lean
def first_corner(cx, level, i):
    """Return the first corner of a level at a node, or -1."""
    return np.int64(cx.head[i, level])


@lean
def next_corner(cx, corner):
    """Return the next corner of the same level at the same node, or -1."""
    return np.int64(cx.links[corner, 0])


@lean
def is_on(cx, level, i):
    """Return whether a node has simplices of a level."""
    return cx.head[i, level] >= 0


@lean
def add_row(cx, level, nodes, label):
    """Add a simplex of four nodes, filled up with -1, and return its row; there must be room."""
    cx.n_free[0] -= 1
    row = np.int64(cx.about[cx.n_free[0], 2])
    a, b, c, d = nodes
    cx.nodes[row, 0], cx.nodes[row, 1], cx.nodes[row, 2], cx.nodes[row, 3] = a, b, c, d
    cx.about[row, 0], cx.about[row, 1] = label, level
    for v in range(4):
        if cx.nodes[row, v] >= 0:
            _link(cx, row, v)
    return row


@lean
def remove_row(cx, row):
    """Remove a simplex."""
    for v in range(4):
        if cx.nodes[row, v] >= 0:
            _unlink(cx, row, v)
    cx.about[row, 1] = -1
    cx.about[cx.n_free[0], 2] = row
    cx.n_free[0] += 1


@lean
def replace_node(cx, row, i, j):
    """Replace node i of a simplex by j."""
    for v in range(4):
        if cx.nodes[row, v] == i:
            _unlink(cx, row, v)
            cx.nodes[row, v] = j
            _link(cx, row, v)


@lean
def has_node(cx, row, i):
    """Return whether node i, which is not negative, is a corner of a simplex; False for -1."""
    nodes = cx.nodes
    return i >= 0 and (
        nodes[row, 0] == i or nodes[row, 1] == i or nodes[row, 2] == i or nodes[row, 3] == i
    )


@lean
def rows_with(cx, level, a, b, c):
    """Return how many simplices have nodes a, b and c, unless it is -1; the first and the last."""
    count, first, last = 0, np.int64(-1), np.int64(-1)
    corner = first_corner(cx, level, a)
    while corner >= 0:
        row = corner // 4
        if has_node(cx, row, b) and (c < 0 or has_node(cx, row, c)):
            first = row if count == 0 else first
            count, last = count + 1, row
        corner = next_corner(cx, corner)
    return count, first, last


@lean
def are_joined(cx, level, a, b):
    """Return whether two nodes are in a simplex together."""
    return rows_with(cx, level, a, b, NONE)[0] > 0


@lean
def nodes_of(cx, row):
    """Return four nodes of a simplex, filled up with -1."""
    return (
        np.int64(cx.nodes[row, 0]),
        np.int64(cx.nodes[row, 1]),
        np.int64(cx.nodes[row, 2]),
        np.int64(cx.nodes[row, 3]),
    )


@lean
def third_node(cx, row, a, b):
    """Return the node of a triangle beside a and b."""
    p, q, r, _ = nodes_of(cx, row)
    return p + q + r - a - b
