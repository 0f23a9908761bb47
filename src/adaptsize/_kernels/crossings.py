"""Triangles of a surface that cross each other.

Rows of the scratch are passed as int64, since each literal would be compiled separately.

Two triangles cross if each has corners on both sides of the plane of the other, farther from it
than a slack, and the segments in which they meet the line common to both planes overlap by more
than the slack [1]_.  Triangles that touch each other, or lie in one plane, do not cross.

References
----------
.. [1] T. Moeller, "A fast triangle-triangle intersection test", Journal of Graphics Tools 2
   (1997) 25-30.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.trees import DEPTH, box_of_cell, cells_of_leaf, leaf_within
from adaptsize._kernels.vectors import between, cross, dot, minus, norm


class Crossings(NamedTuple):
    """The deepest crossing of each triangle, and scratch.

    Parameters
    ----------
    depth : float64[m], In/Out
        0 where there is none.
    partner : int32[m], Out
        The other triangle, in the order of the tree.
    place : float64[m, 3], Out
        Where that is.
    stack : int64[DEPTH]
    work : float64[10, 4]
        The normals of two triangles, the distances of the corners of each from the plane of
        the other, the ends of the two segments, the place, and positions along the line
        that both planes have in common.
    """

    depth: np.ndarray
    partner: np.ndarray
    place: np.ndarray
    stack: np.ndarray
    work: np.ndarray


def new_crossings(n: int) -> Crossings:
    """Return no crossings of n triangles."""
    return Crossings(
        np.zeros(n), np.zeros(n, np.int32), np.zeros((n, 3)),
        np.empty(DEPTH, np.int64), np.empty((10, 4)),
    )  # fmt: skip


@lean
def _set_normal(tree, t, row, work):
    """Set a row of scratch to the unit normal of a triangle, and return whether it has one."""
    points = tree.points
    a, b, c = tree.cells[t, 0], tree.cells[t, 1], tree.cells[t, 2]
    across = cross(between(points, a, b), between(points, a, c))
    length = norm(across)
    if not length > 0.0:
        return False
    for d in range(3):
        work[row, d] = across[d] / length
    return True


@lean
def _penetration(tree, one, other, slack, row, work):
    """Return how far triangle ``one`` reaches to both sides of the plane of ``other``.

    ``row`` of the scratch is set to the distances of its corners from that plane, 0 within the
    slack; the normal of the plane is two rows before.
    """
    points = tree.points
    low, high = 0.0, 0.0
    a = tree.cells[other, 0]
    for v in range(3):
        i = tree.cells[one, v]
        away = dot(work[row - 2], between(points, a, i))
        if abs(away) <= slack:
            away = 0.0
        work[row, v] = away
        low = min(low, away)
        high = max(high, away)
    return min(high, -low)


@lean
def _set_segment(tree, t, row, work):
    """Set two rows of scratch, from ``2 * row`` on, to the segment of a triangle in a plane.

    The distances of its corners from the plane, in ``row``, have both signs.
    """
    points = tree.points
    count = 0
    for v in range(3):
        w = (v + 1) % 3
        i, j = tree.cells[t, v], tree.cells[t, w]
        from_i, from_j = work[row, v], work[row, w]
        if from_i == 0.0:
            share = 0.0
        elif (from_i > 0.0) != (from_j > 0.0) and from_j != 0.0:
            share = from_i / (from_i - from_j)
        else:
            continue
        if count < 2:
            for d in range(3):
                work[2 * row + count, d] = points[i, d] + share * (points[j, d] - points[i, d])
            count += 1


@lean
def _depth(tree, s, t, slack, work):
    """Return how deeply two triangles cross, 0 if they do not; row 8 of the scratch is the place.

    The depth is the least distance that a corner reaches beyond the other plane, and at most the
    length of the common segment.
    """
    depth = _penetration(tree, t, s, slack, np.int64(2), work)
    if depth == 0.0 or not _set_normal(tree, t, np.int64(1), work):
        return 0.0
    depth = min(depth, _penetration(tree, s, t, slack, np.int64(3), work))
    if depth == 0.0:
        return 0.0
    _set_segment(tree, t, np.int64(2), work)
    _set_segment(tree, s, np.int64(3), work)
    # The line that both planes have in common.
    line = cross(work[0], work[1])
    length = norm(line)
    if not length > 0.0:
        return 0.0
    for k in range(4):
        work[9, k] = dot(line, minus(work[4 + k], work[4])) / length
    begin = max(min(work[9, 0], work[9, 1]), min(work[9, 2], work[9, 3]))
    end = min(max(work[9, 0], work[9, 1]), max(work[9, 2], work[9, 3]))
    if end - begin <= slack:
        return 0.0
    middle = 0.5 * (begin + end) / length
    for d in range(3):
        work[8, d] = work[4, d] + middle * line[d]
    return min(depth, end - begin)


@lean
def _common_nodes(cells, s, t):
    """Return the number of nodes that two triangles have in common."""
    count = 0
    for k in range(9):
        if cells[s, k // 3] == cells[t, k % 3]:
            count += 1
    return count


@lean_kernel
def find_crossings(tree, slack, first, last, found):
    """Find the triangles that cross others, and for each the deepest crossing.

    Parameters
    ----------
    tree : Tree
        Of triangles.  Different numbers are different points.
    slack : float64
        Crossings that are less deep count as contacts.
    first, last : int
        Only pairs of which the first triangle is one of ``first:last`` are examined.
    found : Crossings
        In/Out.
    """
    stack, work = found.stack, found.work
    for s in range(first, last):
        if not _set_normal(tree, s, np.int64(0), work):
            continue
        box = box_of_cell(tree.points, tree.cells, s)
        stack[0], height = 1, np.int64(1)
        while height > 0:
            leaf, height = leaf_within(tree.boxes, stack, height, (box, 0.0))
            begin, end = cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])
            for t in range(max(begin, s + 1), end):
                if _common_nodes(tree.cells, s, t) > 1:
                    continue
                depth = _depth(tree, s, t, slack, work)
                for k in range(2):
                    own, other = (s, t) if k == 0 else (t, s)
                    if depth > found.depth[own]:
                        found.depth[own] = depth
                        found.partner[own] = other
                        for d in range(3):
                            found.place[own, d] = work[8, d]
