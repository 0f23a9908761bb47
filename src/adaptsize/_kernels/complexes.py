"""Simplices that are added, removed and changed one at a time, with those around each node.

Every corner of a simplex is an entry of a doubly linked list, that of its node.  So a local
operation on a mesh takes a time that does not depend on the size of the mesh.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel


class Complex(NamedTuple):
    """Simplices of k nodes each.

    Parameters
    ----------
    nodes : int32[room, k]
    label : int32[room]
        Region or group of each simplex.
    alive : bool[room]
        Which rows are in use.
    head : int32[n_points]
        The first corner at each node, ``row * k + v``, or -1.
    after, before : int32[room * k]
        The next and the previous corner at the same node, or -1.
    free : int32[room]
        A stack of the rows that are not in use.
    count : int64[1]
        Their number.
    """

    nodes: np.ndarray
    label: np.ndarray
    alive: np.ndarray
    head: np.ndarray
    after: np.ndarray
    before: np.ndarray
    free: np.ndarray
    count: np.ndarray


def new_complex(nodes: np.ndarray, label: np.ndarray, n_points: int, room: int) -> Complex:
    """Return simplices in the first of ``room`` rows.

    Parameters
    ----------
    nodes : int32[m, k]
    label : int32[m]
    """
    m, k = nodes.shape
    rows = np.zeros((room, k), np.int32)
    rows[:m] = nodes
    labels = np.zeros(room, np.int32)
    labels[:m] = label
    alive = np.zeros(room, np.bool_)
    alive[:m] = True
    free = np.zeros(room, np.int32)
    free[: room - m] = np.arange(room - 1, m - 1, -1)
    after, before = np.full((2, room * k), -1, np.int32)
    head = np.full(n_points, -1, np.int32)
    found = Complex(rows, labels, alive, head, after, before, free, np.array([room - m]))
    link_rows(found, m)
    return found


@lean
def _link(cx, row, v):
    corner, node = row * cx.nodes.shape[1] + v, cx.nodes[row, v]
    first = cx.head[node]
    cx.after[corner] = first
    cx.before[corner] = -1
    if first >= 0:
        cx.before[first] = corner
    cx.head[node] = corner


@lean
def _unlink(cx, row, v):
    corner = row * cx.nodes.shape[1] + v
    earlier, later = cx.before[corner], cx.after[corner]
    if earlier >= 0:
        cx.after[earlier] = later
    else:
        cx.head[cx.nodes[row, v]] = later
    if later >= 0:
        cx.before[later] = earlier


@lean_kernel
def link_rows(cx, m):
    """Link the first m rows, so that the simplices around each node ascend."""
    for row in range(m - 1, -1, -1):
        for v in range(cx.nodes.shape[1]):
            _link(cx, row, v)


@lean
def add_row(cx, nodes, label):
    """Add a simplex of the first k of four nodes and return its row; there must be room."""
    cx.count[0] -= 1
    row = np.int64(cx.free[cx.count[0]])
    a, b, c, d = nodes
    k = cx.nodes.shape[1]
    cx.nodes[row, 0], cx.nodes[row, 1] = a, b
    if k > 2:
        cx.nodes[row, 2] = c
    if k > 3:
        cx.nodes[row, 3] = d
    cx.label[row] = label
    cx.alive[row] = True
    for v in range(k):
        _link(cx, row, v)
    return row


@lean
def remove_row(cx, row):
    """Remove a simplex."""
    for v in range(cx.nodes.shape[1]):
        _unlink(cx, row, v)
    cx.alive[row] = False
    cx.free[cx.count[0]] = row
    cx.count[0] += 1


@lean
def replace_node(cx, row, i, j):
    """Replace node i of a simplex by j."""
    for v in range(cx.nodes.shape[1]):
        if cx.nodes[row, v] == i:
            _unlink(cx, row, v)
            cx.nodes[row, v] = j
            _link(cx, row, v)


@lean
def has_node(cx, row, i):
    """Return whether node i is a corner of a simplex."""
    found = False
    for v in range(cx.nodes.shape[1]):
        found = found or cx.nodes[row, v] == i
    return found


@lean
def count_with(cx, a, b, c):
    """Return the number of simplices with nodes a, b and, unless negative, c, and the last one."""
    k, count, found = cx.nodes.shape[1], 0, np.int64(-1)
    corner = np.int64(cx.head[a])
    while corner >= 0:
        row = corner // k
        if has_node(cx, row, b) and (c < 0 or has_node(cx, row, c)):
            count += 1
            found = row
        corner = np.int64(cx.after[corner])
    return count, found


@lean
def are_joined(cx, a, b):
    """Return whether two nodes are in a simplex together."""
    return count_with(cx, a, b, -1)[0] > 0
