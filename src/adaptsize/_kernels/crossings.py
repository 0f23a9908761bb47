"""Triangles of a surface that cross each other.

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
from adaptsize._kernels.vectors import between, cross, dot, minus, norm, triple, unit, without


class Crossings(NamedTuple):
    """The deepest crossing of each triangle.

    Parameters
    ----------
    depth : float64[m], In/Out
        0 where there is none.
    partner : int32[m], Out
        The other triangle, in the order of the tree.
    place : float64[m, 3], Out
        Where that is.
    stack : int64[DEPTH]
        Scratch.
    """

    depth: np.ndarray
    partner: np.ndarray
    place: np.ndarray
    stack: np.ndarray


def new_crossings(n: int) -> Crossings:
    """Return no crossings of n triangles."""
    return Crossings(
        np.zeros(n), np.zeros(n, np.int32), np.zeros((n, 3)), np.empty(DEPTH, np.int64)
    )


@lean
def _normal(tree, t):
    """Return the unit normal of a triangle, zero if it is degenerate."""
    a, b, c = tree.cells[t, 0], tree.cells[t, 1], tree.cells[t, 2]
    return unit(cross(between(tree.points, a, b), between(tree.points, a, c)))


@lean
def _heights(tree, t, other, normal, slack):
    """Return the distances of the corners of triangle t from the plane of ``other``.

    They are 0 within the slack.  The second result is how far t reaches to both sides.
    """
    points, cells, base = tree.points, tree.cells, tree.cells[other, 0]
    a = dot(normal, between(points, base, cells[t, 0]))
    b = dot(normal, between(points, base, cells[t, 1]))
    c = dot(normal, between(points, base, cells[t, 2]))
    a, b, c = (
        0.0 if abs(a) <= slack else a,
        0.0 if abs(b) <= slack else b,
        0.0 if abs(c) <= slack else c,
    )
    return (a, b, c), min(max(a, b, c), -min(a, b, c))


@lean
def _segment(tree, t, heights):
    """Return the ends of the segment of triangle t in a plane on both sides of which it lies."""
    begin = end = (0.0, 0.0, 0.0)
    count = 0
    for v in range(3):
        w = (v + 1) % 3
        if heights[v] == 0.0:
            share = 0.0
        elif (heights[v] > 0.0) != (heights[w] > 0.0) and heights[w] != 0.0:
            share = heights[v] / (heights[v] - heights[w])
        else:
            continue
        i, j = tree.cells[t, v], tree.cells[t, w]
        place = without(triple(tree.points, i, 0), -share, between(tree.points, i, j))
        if count == 0:
            begin = place
        elif count == 1:
            end = place
        count += 1
    return begin, end


@lean
def _deepest(tree, s, t, normal, slack):
    """Return how deeply two triangles cross, 0 if they do not, and where.

    The depth is the least distance that a corner reaches beyond the other plane, and at most the
    length of the common segment.  ``normal``: that of the first triangle.
    """
    nowhere = 0.0, (0.0, 0.0, 0.0)
    heights_t, depth = _heights(tree, t, s, normal, slack)
    if not depth > 0.0:
        return nowhere
    normal_t = _normal(tree, t)
    heights_s, reach = _heights(tree, s, t, normal_t, slack)
    depth = min(depth, reach)
    # The line that both planes have in common.
    line = cross(normal, normal_t)
    length = norm(line)
    if not (depth > 0.0 and length > 0.0):
        return nowhere
    (p, q), (u, v) = _segment(tree, t, heights_t), _segment(tree, s, heights_s)
    # Positions along the line, from p on.
    at_q, at_u = dot(line, minus(q, p)) / length, dot(line, minus(u, p)) / length
    at_v = dot(line, minus(v, p)) / length
    begin, end = max(min(0.0, at_q), min(at_u, at_v)), min(max(0.0, at_q), max(at_u, at_v))
    if end - begin <= slack:
        return nowhere
    middle = 0.5 * (begin + end) / length
    return min(depth, end - begin), without(p, -middle, line)


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
    stack = found.stack
    for s in range(first, last):
        normal = _normal(tree, s)
        if not norm(normal) > 0.0:
            continue
        box = box_of_cell(tree.points, tree.cells, s)
        stack[0], height = 1, np.int64(1)
        while height > 0:
            leaf, height = leaf_within(tree.boxes, stack, height, (box, 0.0))
            begin, end = cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])
            for t in range(max(begin, s + 1), end):
                if _common_nodes(tree.cells, s, t) > 1:
                    continue
                depth, place = _deepest(tree, s, t, normal, slack)
                for k in range(2):
                    own, other = (s, t) if k == 0 else (t, s)
                    if depth > found.depth[own]:
                        found.depth[own] = depth
                        found.partner[own] = other
                        for d in range(3):
                            found.place[own, d] = place[d]
