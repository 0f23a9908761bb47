"""Which old cells overlap each new cell, with the measures of the overlaps, and means over them."""

import numpy as np

from adaptsize._kernels.clipping import (
    MAX_CORNERS,
    MAX_PIECES,
    set_planes,
    tetrahedra_overlap,
    triangles_overlap,
)
from adaptsize._kernels.compiling import inner, kernel

_STACK = 64


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


@kernel
def fill_overlaps(
    old_points, old_cells, boxes, new_points, new_cells, order, first, last, counts, found, measures
):
    """Find the old cells that overlap each new cell, and the measures of the overlaps.

    Parameters
    ----------
    old_points : float64[n, 3]
        Padded with zeros in the plane.
    old_cells : int32[m, k + 1]
        Triangles in the plane or tetrahedra, in the order of a tree of boxes.
    boxes : float64[2 * n_leaves, 6]
        From `adaptsize._kernels.interpolate.fill_boxes`.
    new_points : float64[n_new, 3]
    new_cells : int32[m_new, k + 1]
    order : int64[m_new]
        Order of processing.
    first, last : int
        Only ``order[first:last]`` is processed, and less if ``found`` is full.
    counts : int64[m_new]
        Out: number of old cells that overlap each new cell.
    found : int32[room]
        Out: old cells, those of one new cell after the other.
    measures : float64[room]
        Out: their overlaps, > 0.

    Returns
    -------
    int
        Place in ``order`` at which to go on; ``first`` if ``found`` has no room for one cell.
    int
        Number of entries of ``found`` that are filled.
    """
    n_cells = old_cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    planar = old_cells.shape[1] == 3
    stack = np.empty(_STACK, np.int64)
    box, other = np.empty(6), np.empty(6)
    polygon, polygon_too = np.empty((MAX_CORNERS, 2)), np.empty((MAX_CORNERS, 2))
    here, there = np.empty((MAX_PIECES, 4, 3)), np.empty((MAX_PIECES, 4, 3))
    prism, height, corner_order = np.empty((6, 3)), np.empty(4), np.empty(4, np.int64)
    where = np.empty(4, np.int64)
    begin, cut, sides = np.empty(3), np.empty((4, 3)), np.empty((2, 4, 3))
    corners, normals, origins = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    used = 0
    for place in range(first, last):
        c = order[place]
        start = used
        _set_box(new_points, new_cells, c, box)
        if not planar:
            for v in range(4):
                for d in range(3):
                    begin[d] = new_points[new_cells[c, 0], d]
                    cut[v, d] = new_points[new_cells[c, v], d] - begin[d]
            set_planes(cut, sides[0], sides[1])
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _apart(box, boxes[node]):
                continue
            if node < n_leaves:
                stack[top] = 2 * node
                stack[top + 1] = 2 * node + 1
                top += 2
                continue
            leaf = node - n_leaves
            for k in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
                _set_box(old_points, old_cells, k, other)
                if _apart(box, other):
                    continue
                if planar:
                    measure = triangles_overlap(
                        old_points, old_cells, k, new_points, new_cells, c, polygon, polygon_too
                    )
                else:
                    measure = tetrahedra_overlap(
                        old_points, old_cells, k, begin, cut, sides,
                        corners, normals, origins, here, there, prism, height, corner_order, where,
                    )  # fmt: skip
                if measure > 0.0:
                    if used == found.shape[0]:
                        return place, start
                    found[used] = k
                    measures[used] = measure
                    used += 1
        counts[c] = used - start
    return last, used


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
