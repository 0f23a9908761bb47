"""Location of points in a mesh by a tree of boxes."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.distance import closest_on_cell, find_inside
from adaptsize._kernels.trees import (
    box_of_cell,
    cells_of_leaf,
    descent_by_bound,
    leaf_within,
    nearest_leaf,
)

# Weights below this are rounding errors: values at nodes next to inf are exact.
_ROUNDING = 3e-15


class Located(NamedTuple):
    """Where query points are.

    Parameters
    ----------
    cell : int32[n_queries]
        Row of the cells of the tree.
    weights : float64[n_queries, k + 1]
        Barycentric coordinates of the closest point.
    distance : float64[n_queries]
        0 inside.
    """

    cell: np.ndarray
    weights: np.ndarray
    distance: np.ndarray


@lean
def _distance_to_centre(boxes, node, x):
    """Return twice the Manhattan distance of x to the centre of a box; inf outside of the box."""
    total = 0.0
    for d in range(3):
        if not boxes[node, d] <= x[d] <= boxes[node, 3 + d]:
            return math.inf
        total += abs(boxes[node, d] + boxes[node, 3 + d] - 2.0 * x[d])
    return total


_holding_leaf = descent_by_bound(_distance_to_centre)


@lean
def _distance2_to_cell_box(tree, c, x):
    """Return the squared distance of x to the bounding box of cell c, 0 inside."""
    low, high = box_of_cell(tree.points, tree.cells, c)
    total = 0.0
    for d in range(3):
        gap = max(low[d] - x[d], x[d] - high[d])
        if gap > 0.0:
            total += gap * gap
    return total


@lean
def _find_cell(tree, x, stack):
    """Return a cell that contains x and its weights, or -1; boxes with the nearer centre first."""
    stack.box[0], stack.bound[0] = 1, 0.0
    height = np.int64(1)
    while height > 0:
        leaf, height = _holding_leaf(tree.boxes, stack, height, math.inf, x)
        for c in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
            if _distance2_to_cell_box(tree, c, x) > 0.0:
                continue
            inside, weights = find_inside(tree.points, tree.cells, c, x)
            if inside:
                return c, weights
    return -1, (0.0, 0.0, 0.0, 0.0)


@lean
def _find_closest(tree, x, stack):
    """Return the closest cell, the weights of the closest point, the squared distance."""
    best, best_cell, best_weights = math.inf, -1, (1.0, 0.0, 0.0, 0.0)
    stack.box[0], stack.bound[0] = 1, 0.0
    height = np.int64(1)
    while height > 0:
        leaf, height = nearest_leaf(tree.boxes, stack, height, best, x)
        for c in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
            if _distance2_to_cell_box(tree, c, x) >= best:
                continue
            distance2, weights = closest_on_cell(tree.points, tree.cells, c, x)
            if distance2 < best:
                best, best_cell, best_weights = distance2, c, weights
    return best_cell, best_weights, best


@lean
def _keep(q, cell, weights, distance2, found):
    """Enter what was found for query q."""
    found.cell[q] = cell
    found.distance[q] = math.sqrt(distance2)
    for v in range(found.weights.shape[1]):
        found.weights[q, v] = weights[v] if weights[v] > _ROUNDING else 0.0


@lean_kernel
def locate(tree, full, queries, which, stack, found):
    """Find the cell that contains each query point, or else the closest point of the mesh.

    The answer for a point does not depend on the other points.

    Parameters
    ----------
    tree : Tree
    full : bool
        Whether the cells have the dimension of the space, so that they contain points.
    queries : float64[n_queries, 3]
    which : int64[n]
        The queries to process.  Neighbours should be near each other, for the cache.
    stack : Stack
        Scratch.
    found : Located
        Out.
    """
    for q in which:
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        cell = -1
        distance2 = 0.0
        w = (0.0, 0.0, 0.0, 0.0)
        if full:
            cell, w = _find_cell(tree, x, stack)
        if cell < 0:
            cell, w, distance2 = _find_closest(tree, x, stack)
        _keep(q, cell, w, distance2, found)


@lean_kernel
def locate_in_ranges(mesh, first, ranges, queries, which, found):
    """Find the cell that contains each query point, or else the closest one, among few.

    Parameters
    ----------
    mesh : tuple of float64[n, 3] and int32[m, k + 1]
        Points and cells; k = 2 with all points in the plane z = 0, or k = 3.
    first : int64[n_ranges + 1]
        First cell of each range of consecutive cells, and their number.
    ranges : int32[n_queries]
        Where to look for each query.
    queries, which
        As in `locate`.
    found : Located
        Out: rows of the cells of the mesh.
    """
    points, cells = mesh
    for q in which:
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        best, best_cell, w = math.inf, -1, (0.0, 0.0, 0.0, 0.0)
        for c in range(first[ranges[q]], first[ranges[q] + 1]):
            inside, weights = find_inside(points, cells, c, x)
            if inside:
                best, best_cell, w = 0.0, c, weights
                break
        else:
            for c in range(first[ranges[q]], first[ranges[q] + 1]):
                distance2, weights = closest_on_cell(points, cells, c, x)
                if distance2 < best:
                    best, best_cell, w = distance2, c, weights
        _keep(q, best_cell, w, best, found)


@lean_kernel
def list_within(tree, queries, reach, stack, rows):
    """List the cells that are at most a given distance away from each query point.

    Parameters
    ----------
    tree, queries
        As in `locate`.
    reach : float64[n_queries]
        Largest distance, >= 0.
    stack : int64[DEPTH]
        Scratch.
    rows : int32[room, 2]
        Out: query and cell, as numbered in the tree, as far as there is room.

    Returns
    -------
    int
        Number of rows, which may exceed the room.
    """
    count = 0
    for q in range(queries.shape[0]):
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        reach2 = reach[q] * reach[q]
        stack[0], height = 1, np.int64(1)
        while height > 0:
            leaf, height = leaf_within(tree.boxes, stack, height, ((x, x), reach2))
            for c in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
                if _distance2_to_cell_box(tree, c, x) > reach2:
                    continue
                if closest_on_cell(tree.points, tree.cells, c, x)[0] <= reach2:
                    if count < rows.shape[0]:
                        rows[count, 0] = q
                        rows[count, 1] = c
                    count += 1
    return count
