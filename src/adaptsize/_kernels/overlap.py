"""Overlaps of the cells of two meshes: their measures, and means over them.

One of two cells is cut by the sides of the other.  In the plane what is left is a convex polygon.
In space it is kept as a list of tetrahedra, because a plane cuts a tetrahedron into tetrahedra
and prisms, and a prism is three of them.  Coordinates are taken relative to a corner of the
cell that is cut, so that none is larger than the two cells.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.trees import DEPTH, cells_of_leaf, descent

# A triangle cut three times has at most six corners.
MAX_CORNERS = 8

# A tetrahedron cut by a plane leaves at most three, and so for each of four planes.
MAX_PIECES = 81

# Where corners lie from a plane.
_BEHIND, _ACROSS, _BEFORE = -1, 0, 1


class Clipping(NamedTuple):
    """Scratch for the intersection of two cells.

    Parameters
    ----------
    polygons : float64[2, MAX_CORNERS, 2]
    pieces : float64[2, MAX_PIECES, 4, 3]
    prism : float64[6, 3]
    height : float64[4]
    order : int64[4]
    where : int64[4]
    start : float64[3]
        First corner of the new cell, from which coordinates are taken.
    cut : float64[4, 3]
        Corners of the new cell.
    sides : float64[2, 4, 3]
        Normals and origins of its planes.
    corners : float64[4, 3]
        Corners of the old cell.
    old_sides : float64[2, 4, 3]
        Normals and origins of its planes.
    """

    polygons: np.ndarray
    pieces: np.ndarray
    prism: np.ndarray
    height: np.ndarray
    order: np.ndarray
    where: np.ndarray
    start: np.ndarray
    cut: np.ndarray
    sides: np.ndarray
    corners: np.ndarray
    old_sides: np.ndarray


@inner
def _triangles_overlap(old, k, new, c, polygons):
    """Return the area that old cell k and new cell c have in common."""
    (old_points, old_cells), (new_points, new_cells) = old, new
    here, there = polygons[0], polygons[1]
    x0, y0 = new_points[new_cells[c, 0], 0], new_points[new_cells[c, 0], 1]
    n = 3
    for v in range(3):
        here[v, 0] = new_points[new_cells[c, v], 0] - x0
        here[v, 1] = new_points[new_cells[c, v], 1] - y0
    i, j, m = old_cells[k, 0], old_cells[k, 1], old_cells[k, 2]
    turn = (old_points[j, 0] - old_points[i, 0]) * (old_points[m, 1] - old_points[i, 1]) - (
        old_points[j, 1] - old_points[i, 1]
    ) * (old_points[m, 0] - old_points[i, 0])
    if turn == 0.0:
        return 0.0
    if turn < 0.0:
        j, m = m, j
    for _ in range(3):
        # The side from i to j; what lies to its left is kept.
        ax, ay = old_points[i, 0] - x0, old_points[i, 1] - y0
        ex, ey = old_points[j, 0] - old_points[i, 0], old_points[j, 1] - old_points[i, 1]
        left = 0
        px, py = here[n - 1, 0], here[n - 1, 1]
        before = ex * (py - ay) - ey * (px - ax)
        for v in range(n):
            qx, qy = here[v, 0], here[v, 1]
            after = ex * (qy - ay) - ey * (qx - ax)
            if (before >= 0.0) != (after >= 0.0):
                t = before / (before - after)
                there[left, 0] = px + t * (qx - px)
                there[left, 1] = py + t * (qy - py)
                left += 1
            if after >= 0.0:
                there[left, 0] = qx
                there[left, 1] = qy
                left += 1
            px, py, before = qx, qy, after
        if left < 3:
            return 0.0
        n = left
        here, there = there, here
        i, j, m = j, m, i
    twice = 0.0
    for v in range(1, n - 1):
        twice += (here[v, 0] - here[0, 0]) * (here[v + 1, 1] - here[0, 1]) - (
            here[v, 1] - here[0, 1]
        ) * (here[v + 1, 0] - here[0, 0])
    return 0.5 * abs(twice)


@inner
def _between(piece, i, j, t, corner):
    """Set ``corner`` to the point at fraction t from corner i to corner j of a piece."""
    for d in range(3):
        corner[d] = piece[i, d] + t * (piece[j, d] - piece[i, d])


@inner
def _add_prism(prism, pieces, n):
    """Append the three tetrahedra of a prism; return the new number of pieces.

    ``prism``: the corners of one triangle, then the corresponding ones of the other.
    """
    for t in range(3):
        for v in range(4):
            for d in range(3):
                pieces[n + t, v, d] = prism[t + v, d]
    return n + 3


@inner
def _cut(pieces, n, plane, kept, work):
    """Cut n tetrahedra by a half space; return how many are left (Out: kept).

    What has ``(x - origin) . normal >= 0`` is kept; ``plane``: normal and origin.
    """
    (normal, origin), prism, height, order = plane, work.prism, work.height, work.order
    m = 0
    n0, n1, n2 = normal[0], normal[1], normal[2]
    o0, o1, o2 = origin[0], origin[1], origin[2]
    for p in range(n):
        # Corners that are kept come first in ``order``.
        n_in = 0
        n_out = 0
        for v in range(4):
            above = (
                (pieces[p, v, 0] - o0) * n0
                + (pieces[p, v, 1] - o1) * n1
                + (pieces[p, v, 2] - o2) * n2
            )
            height[v] = above
            if above >= 0.0:
                order[n_in] = v
                n_in += 1
            else:
                n_out += 1
                order[4 - n_out] = v
        if n_in == 0:
            continue
        if n_in == 4:
            for v in range(4):
                for d in range(3):
                    kept[m, v, d] = pieces[p, v, d]
            m += 1
            continue
        if n_in == 1:
            i = order[0]
            for d in range(3):
                kept[m, 0, d] = pieces[p, i, d]
            for v in range(1, 4):
                j = order[v]
                _between(pieces[p], i, j, height[i] / (height[i] - height[j]), kept[m, v])
            m += 1
            continue
        if n_in == 3:  # the tip is cut off
            o = order[3]
            for v in range(3):
                i = order[v]
                for d in range(3):
                    prism[v, d] = pieces[p, i, d]
                _between(pieces[p], i, o, height[i] / (height[i] - height[o]), prism[3 + v])
        else:  # an edge is cut off
            for v in range(2):
                i = order[v]
                for d in range(3):
                    prism[3 * v, d] = pieces[p, i, d]
                for w in range(2):
                    j = order[2 + w]
                    t = height[i] / (height[i] - height[j])
                    _between(pieces[p], i, j, t, prism[3 * v + 1 + w])
        m = _add_prism(prism, kept, m)
    return m


@inner
def _six_volumes(x, a, b, c, d):
    """Return (b - a) x (c - a) . (d - a) of four rows of x, float64[.., 3]."""
    e0, e1, e2 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    f0, f1, f2 = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    g0, g1, g2 = x[d, 0] - x[a, 0], x[d, 1] - x[a, 1], x[d, 2] - x[a, 2]
    return g0 * (e1 * f2 - e2 * f1) + g1 * (e2 * f0 - e0 * f2) + g2 * (e0 * f1 - e1 * f0)


@inner
def _set_plane(corners, v, normal, origin):
    """Set the plane of the side opposite to corner v of four, its normal towards the corner."""
    a, b, c = (v + 1) % 4, (v + 2) % 4, (v + 3) % 4
    e0, e1, e2 = (
        corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1], corners[b, 2] - corners[a, 2]
    )  # fmt: skip
    f0, f1, f2 = (
        corners[c, 0] - corners[a, 0], corners[c, 1] - corners[a, 1], corners[c, 2] - corners[a, 2]
    )  # fmt: skip
    normal[0] = e1 * f2 - e2 * f1
    normal[1] = e2 * f0 - e0 * f2
    normal[2] = e0 * f1 - e1 * f0
    side = 0.0
    for d in range(3):
        origin[d] = corners[a, d]
        side += (corners[v, d] - corners[a, d]) * normal[d]
    if side < 0.0:
        for d in range(3):
            normal[d] = -normal[d]


@inner
def _side_of(normal, origin, corners):
    """Return if four corners, float64[4, 3], lie all behind a plane (or in it), before, or both."""
    lowest = math.inf
    highest = -math.inf
    for w in range(4):
        height = (
            (corners[w, 0] - origin[0]) * normal[0]
            + (corners[w, 1] - origin[1]) * normal[1]
            + (corners[w, 2] - origin[2]) * normal[2]
        )
        lowest = min(lowest, height)
        highest = max(highest, height)
    if highest <= 0.0:
        return _BEHIND
    return _BEFORE if lowest >= 0.0 else _ACROSS


@inner
def _set_planes(corners, sides):
    """Set the planes of the four sides of a tetrahedron, normals inwards."""
    for v in range(4):
        _set_plane(corners, v, sides[0, v], sides[1, v])


@inner
def _tetrahedra_overlap(old, k, work):
    """Return the volume that old cell k and the new cell of the scratch have in common."""
    (points, cells), corners, where = old, work.corners, work.where
    for v in range(4):
        for d in range(3):
            corners[v, d] = points[cells[k, v], d] - work.start[d]
    # A side of one cell that has all of the other beyond it: nothing to be cut.
    for v in range(4):
        if _side_of(work.sides[0, v], work.sides[1, v], corners) == _BEHIND:
            return 0.0
    if _six_volumes(corners, 0, 1, 2, 3) == 0.0:
        return 0.0
    _set_planes(corners, work.old_sides)
    for v in range(4):
        where[v] = _side_of(work.old_sides[0, v], work.old_sides[1, v], work.cut)
        if where[v] == _BEHIND:
            return 0.0
    here, there = work.pieces[0], work.pieces[1]
    n = 1
    for v in range(4):
        for d in range(3):
            here[0, v, d] = work.cut[v, d]
    for v in range(4):
        if where[v] == _BEFORE:
            continue
        n = _cut(here, n, (work.old_sides[0, v], work.old_sides[1, v]), there, work)
        if n == 0:
            return 0.0
        here, there = there, here
    total = 0.0
    for p in range(n):
        total += abs(_six_volumes(here[p], 0, 1, 2, 3))
    return total / 6.0


@inner
def _set_box(points, cells, c, box):
    """Set ``box``, float64[6], to the lower and the upper corner of the box around a cell."""
    for d in range(3):
        box[d] = points[cells[c, 0], d]
        box[3 + d] = box[d]
        for v in range(1, cells.shape[1]):
            box[d] = min(box[d], points[cells[c, v], d])
            box[3 + d] = max(box[3 + d], points[cells[c, v], d])


@inner
def _apart(box, other):
    """Return whether two boxes, float64[6], have no point in common."""
    apart = False
    for d in range(3):
        apart = apart or box[d] > other[3 + d] or box[3 + d] < other[d]
    return apart


@inner
def _meets(boxes, node, box):
    return not _apart(box, boxes[node])


_meeting_leaf = descent(_meets)


@kernel
def fill_overlaps(old, points, cells, which, out):
    """Find the old cells that overlap each new cell, and the measures of the overlaps.

    Parameters
    ----------
    old : Tree
        Triangles in the plane or tetrahedra.
    points, cells : float64[n_new, 3], int32[m_new, k + 1]
        The new cells.
    which : int64[n]
        New cells to process, in this order, as many as there is room for.
    out : tuple of int64[m_new], int32[room], float64[room]
        Out: the number of old cells that overlap each new cell; the old cells, those of one new
        cell after the other; their overlaps, > 0.

    Returns
    -------
    int
        Number of new cells that were processed; 0 if there is no room for one.
    int
        Number of overlaps.
    """
    counts, found, measures = out
    planar = cells.shape[1] == 3
    old_cells, new = (old.points, old.cells), (points, cells)
    stack, box, other = np.empty(DEPTH, np.int64), np.empty(6), np.empty(6)
    work = Clipping(
        np.empty((2, MAX_CORNERS, 2)), np.empty((2, MAX_PIECES, 4, 3)), np.empty((6, 3)),
        np.empty(4), np.empty(4, np.int64), np.empty(4, np.int64), np.empty(3), np.empty((4, 3)),
        np.empty((2, 4, 3)), np.empty((4, 3)), np.empty((2, 4, 3)),
    )  # fmt: skip
    used = 0
    for place in range(which.shape[0]):
        c = which[place]
        start = used
        _set_box(points, cells, c, box)
        if not planar:
            for v in range(4):
                for d in range(3):
                    work.start[d] = points[cells[c, 0], d]
                    work.cut[v, d] = points[cells[c, v], d] - work.start[d]
            _set_planes(work.cut, work.sides)
        stack[0], height = 1, np.int64(1)
        while height > 0:
            leaf, height = _meeting_leaf(old.boxes, stack, height, box)
            for k in range(*cells_of_leaf(leaf, old.boxes, old.cells.shape[0])):
                _set_box(old.points, old.cells, k, other)
                if _apart(box, other):
                    continue
                if planar:
                    measure = _triangles_overlap(old_cells, k, new, c, work.polygons)
                else:
                    measure = _tetrahedra_overlap(old_cells, k, work)
                if measure > 0.0:
                    if used == found.shape[0]:
                        return place, start
                    found[used] = k
                    measures[used] = measure
                    used += 1
        counts[c] = used - start
    return which.shape[0], used


@kernel
def combine(start, found, weights, values, result):
    """Fill means of rows of values, kept between the least and the largest that count.

    Parameters
    ----------
    start : int64[n_new + 1]
        Row i takes part in ``start[i]:start[i + 1]`` of the next two.
    found : int32[n]
        Rows of ``values``.
    weights : float64[n]
        >= 0; need not sum to 1.
    values : float64[n_old, k]
    result : float64[n_new, k]
        Out; left as it is in rows of which all weights are zero.
    """
    for i in range(start.shape[0] - 1):
        total = 0.0
        for place in range(start[i], start[i + 1]):
            total += weights[place]
        if total <= 0.0:
            continue
        for j in range(values.shape[1]):
            mean = 0.0
            low = np.inf
            high = -np.inf
            for place in range(start[i], start[i + 1]):
                if weights[place] > 0.0:
                    value = values[found[place], j]
                    mean += weights[place] / total * value
                    low = min(low, value)
                    high = max(high, value)
            result[i, j] = min(max(mean, low), high)
