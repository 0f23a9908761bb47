"""Location of points in a mesh by a tree of boxes, and linear interpolation.

The tree is a complete binary tree in heap order: node 1 is the root, the children of
node i are 2 i and 2 i + 1, and the last ``n_leaves`` nodes are leaves.  The cells are
put in an order in which leaf number l holds those from ``l * n_cells // n_leaves`` to
``(l + 1) * n_cells // n_leaves``, so no array but that of the boxes is needed.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.distance import closest_on_cell, find_inside

# A path from the root to a leaf leaves one node behind per level.
_STACK = 64


@kernel
def fill_centroids(points, cells, centroids):
    """Fill the mean of the corners of each cell.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
    centroids : float64[m, 3]
        Out.
    """
    k = cells.shape[1]
    for c in range(cells.shape[0]):
        for d in range(3):
            total = 0.0
            for v in range(k):
                total += points[cells[c, v], d]
            centroids[c, d] = total / k


@inner
def _select(keys, axis, order, first, last, middle):
    """Move the cells of smaller keys before place ``middle``, the others behind (quickselect).

    Parameters
    ----------
    keys : float64[m, 3]
    axis : int
        Column of the keys.
    order : int64[m]
        In/Out: ``order[first:last]`` is rearranged.
    first, last, middle : int
        ``first <= middle < last``.
    """
    low, high = first, last - 1
    while low < high:
        pivot = keys[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while keys[order[i], axis] < pivot:
                i += 1
            while keys[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
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
    centroids : float64[m, 3]
    n_leaves : int
        Power of 2, at most m.
    order : int64[m]
        In/Out: numbers of the cells.  Centroids along a space-filling curve are faster.
    """
    m = centroids.shape[0]
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
        for d in range(3):
            lower = math.inf
            upper = -math.inf
            for place in range(first, last):
                lower = min(lower, centroids[order[place], d])
                upper = max(upper, centroids[order[place], d])
            if upper - lower > longest:
                axis = d
                longest = upper - lower
        _select(centroids, axis, order, first, last, (leaf + width // 2) * m // n_leaves)


@kernel
def fill_boxes(points, cells, boxes):
    """Fill the bounding boxes of a tree over sorted cells, leaves first.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        In the order of the tree.
    boxes : float64[2 * n_leaves, 6]
        Out: lower and upper corner of each node; row 0 is not used.
    """
    n_cells = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    for leaf in range(n_leaves):
        node = n_leaves + leaf
        for d in range(3):
            boxes[node, d] = math.inf
            boxes[node, 3 + d] = -math.inf
        for c in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
            for v in range(cells.shape[1]):
                for d in range(3):
                    value = points[cells[c, v], d]
                    boxes[node, d] = min(boxes[node, d], value)
                    boxes[node, 3 + d] = max(boxes[node, 3 + d], value)
    for node in range(n_leaves - 1, 0, -1):
        for d in range(3):
            boxes[node, d] = min(boxes[2 * node, d], boxes[2 * node + 1, d])
            boxes[node, 3 + d] = max(boxes[2 * node, 3 + d], boxes[2 * node + 1, 3 + d])


@inner
def _holds(boxes, node, x):
    """Return whether x lies in the closed box of a node."""
    return (
        boxes[node, 0] <= x[0] <= boxes[node, 3]
        and boxes[node, 1] <= x[1] <= boxes[node, 4]
        and boxes[node, 2] <= x[2] <= boxes[node, 5]
    )


@inner
def _distance_to_centre(boxes, node, x):
    """Return twice the Manhattan distance of x to the centre of the box of a node."""
    total = 0.0
    for d in range(3):
        total += abs(boxes[node, d] + boxes[node, 3 + d] - 2.0 * x[d])
    return total


@inner
def distance2_to_box(boxes, node, x):
    """Return the squared distance of x to the box of a node, 0 inside."""
    total = 0.0
    for d in range(3):
        gap = max(boxes[node, d] - x[d], x[d] - boxes[node, 3 + d])
        if gap > 0.0:
            total += gap * gap
    return total


@inner
def _distance2_to_cell_box(points, cells, c, x):
    """Return the squared distance of x to the bounding box of cell c, 0 inside."""
    total = 0.0
    for d in range(3):
        low = points[cells[c, 0], d]
        high = low
        for v in range(1, cells.shape[1]):
            low = min(low, points[cells[c, v], d])
            high = max(high, points[cells[c, v], d])
        gap = max(low - x[d], x[d] - high)
        if gap > 0.0:
            total += gap * gap
    return total


@inner
def _find_cell(points, cells, boxes, x, stack):
    """Return a cell that contains x and its weights, or -1.

    Parameters as in `locate`; ``stack`` is int64[64], scratch.
    """
    n_cells = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    stack[0] = 1
    top = 1 if _holds(boxes, stack[0], x) else 0
    while top > 0:
        top -= 1
        node = stack[top]
        if node < n_leaves:
            # The child whose centre is nearer is taken first.
            near, far = 2 * node, 2 * node + 1
            if _distance_to_centre(boxes, far, x) < _distance_to_centre(boxes, near, x):
                near, far = far, near
            for child in (far, near):
                if _holds(boxes, child, x):
                    stack[top] = child
                    top += 1
            continue
        leaf = node - n_leaves
        for c in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
            if _distance2_to_cell_box(points, cells, c, x) > 0.0:
                continue
            inside, weights = find_inside(points, cells, c, x)
            if inside:
                return c, weights
    return -1, (0.0, 0.0, 0.0, 0.0)


@inner
def _find_closest(points, cells, boxes, x, stack, bounds):
    """Return the closest cell, the weights of the closest point, the squared distance.

    Branch and bound, nearer child first: the first descent gives a good bound.

    Parameters as in `locate`; ``stack`` int64[64] and ``bounds`` float64[64] are scratch.
    """
    n_cells = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    best = math.inf
    best_cell = -1
    best_weights = (1.0, 0.0, 0.0, 0.0)
    stack[0] = 1
    bounds[0] = distance2_to_box(boxes, stack[0], x)
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if bounds[top] >= best:
            continue
        if node < n_leaves:
            near, far = 2 * node, 2 * node + 1
            near2 = distance2_to_box(boxes, near, x)
            far2 = distance2_to_box(boxes, far, x)
            if far2 < near2:
                near, far = far, near
                near2, far2 = far2, near2
            stack[top] = far
            bounds[top] = far2
            stack[top + 1] = near
            bounds[top + 1] = near2
            top += 2
            continue
        leaf = node - n_leaves
        for c in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
            if _distance2_to_cell_box(points, cells, c, x) >= best:
                continue
            distance2, weights = closest_on_cell(points, cells, c, x)
            if distance2 < best:
                best = distance2
                best_cell = c
                best_weights = weights
    return best_cell, best_weights, best


@kernel
def locate(points, cells, boxes, full, queries, order, first, last, found, weights, distances):
    """Find the cell that contains each query point, or else the closest point of the mesh.

    The answer for a point does not depend on the other points.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        In the order of the tree.
    boxes : float64[2 * n_leaves, 6]
        From `fill_boxes`.
    full : bool
        Whether the cells have the dimension of the space, so that they contain points.
    queries : float64[n_queries, 3]
    order : int64[n_queries]
        Order of processing; neighbours should be near each other, for the cache.
    first, last : int
        Only ``order[first:last]`` is processed.
    found : int32[n_queries]
        Out: cell, as numbered in ``cells``.
    weights : float64[n_queries, k + 1]
        Out: barycentric coordinates of the closest point.
    distances : float64[n_queries]
        Out: 0 inside.
    """
    stack = np.empty(_STACK, np.int64)
    bounds = np.empty(_STACK)
    for place in range(first, last):
        q = order[place]
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        cell = -1
        distance2 = 0.0
        w = (0.0, 0.0, 0.0, 0.0)
        if full:
            cell, w = _find_cell(points, cells, boxes, x, stack)
        if cell < 0:
            cell, w, distance2 = _find_closest(points, cells, boxes, x, stack, bounds)
        found[q] = cell
        distances[q] = math.sqrt(distance2)
        for v in range(cells.shape[1]):
            weights[q, v] = w[v]


@kernel
def list_within(points, cells, boxes, queries, reach, rows):
    """List the cells that are at most a given distance away from each query point.

    Parameters
    ----------
    points, cells, boxes, queries
        As in `locate`.
    reach : float64[n_queries]
        Largest distance, >= 0.
    rows : int32[room, 2]
        Out: query and cell, as numbered in ``cells``, as far as there is room.

    Returns
    -------
    int
        Number of rows, which may exceed the room.
    """
    n_cells = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    stack = np.empty(_STACK, np.int64)
    count = 0
    for q in range(queries.shape[0]):
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        reach2 = reach[q] * reach[q]
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if distance2_to_box(boxes, node, x) > reach2:
                continue
            if node < n_leaves:
                stack[top] = 2 * node
                stack[top + 1] = 2 * node + 1
                top += 2
                continue
            leaf = node - n_leaves
            for c in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
                if _distance2_to_cell_box(points, cells, c, x) > reach2:
                    continue
                if closest_on_cell(points, cells, c, x)[0] <= reach2:
                    if count < rows.shape[0]:
                        rows[count, 0] = q
                        rows[count, 1] = c
                    count += 1
    return count


@kernel
def interpolate(cells, values, found, weights, result):
    """Fill the linear interpolant at located points.

    Nodes of weight 0 do not count, so that 0 * inf is no nan.  The result is kept
    between the smallest and the largest value that count: constants are exact.

    Parameters
    ----------
    cells : int32[m, k + 1]
    values : float64[n]
        Finite or +inf.
    found : int32[n_queries]
    weights : float64[n_queries, k + 1]
        All >= 0.
    result : float64[n_queries]
        Out.
    """
    for q in range(found.shape[0]):
        total = 0.0
        low = math.inf
        high = -math.inf
        for v in range(cells.shape[1]):
            if weights[q, v] > 0.0:
                value = values[cells[found[q], v]]
                total += weights[q, v] * value
                low = min(low, value)
                high = max(high, value)
        result[q] = min(max(total, low), high)
