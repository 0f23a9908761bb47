"""Trees of boxes and slabs for the search of the largest sphere at a point of a boundary.

Each node of a tree has a box (`adaptsize._kernels.interpolate.fill_boxes`) and a slab: the mean
normal of its cells, and the interval that the cells take along it.  A slab is thin where the
boundary is nearly flat, and then excludes balls that reach into the box.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import kernel, part

#: Radii may come out larger than the least one by this share.  Without it all boxes would be opened
#: where the ball touches the boundary all around, as in a sphere.
EXCESS = 1e-2


@kernel
def fill_slabs(points, cells, normals, measures, slabs):
    """Fill a direction, and the interval that the cells take along it, for each node of a tree.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        In the order of the tree.
    normals : float64[m, 3]
        Unit normals, zero if there is none.
    measures : float64[m]
        Their weights.
    slabs : float64[2 * n_leaves, 5]
        Out: direction (zero: none), lower and upper end; row 0 is not used.
    """
    m, width = cells.shape
    n_leaves = slabs.shape[0] // 2
    for node in range(2 * n_leaves - 1, 0, -1):
        leaves, first = 1, node
        while first < n_leaves:
            first *= 2
            leaves *= 2
        begin = (first - n_leaves) * m // n_leaves
        end = (first - n_leaves + leaves) * m // n_leaves
        u = np.zeros(3)
        for c in range(begin, end):
            for d in range(3):
                u[d] += measures[c] * normals[c, d]
        length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        low, high = math.inf, -math.inf
        for d in range(3):
            u[d] = u[d] / length if length > 0.0 else 0.0
            slabs[node, d] = u[d]
        for c in range(begin, end):
            for v in range(width):
                i = cells[c, v]
                along = u[0] * points[i, 0] + u[1] * points[i, 1] + u[2] * points[i, 2]
                low = min(low, along)
                high = max(high, along)
        slabs[node, 3] = low
        slabs[node, 4] = high


@part
def cannot_shrink(boxes, slabs, node, p, n, r, sine):
    """Return whether no cell in a box shrinks the ball: all are out of it, or too low.

    Parameters
    ----------
    boxes : float64[2 * n_leaves, 6]
    slabs : float64[2 * n_leaves, 5]
    node : int
    p, n : tuple of 3 float64
        Probe and unit normal.
    r : float64
        Radius of the ball.
    sine : float64
        Least sine of the angle between q - p and the tangent plane.
    """
    to_centre, to_probe, from_probe = 0.0, 0.0, 0.0
    highest, lowest, along = 0.0, 0.0, 0.0
    for d in range(3):
        low, high = boxes[node, d], boxes[node, 3 + d]
        centre = p[d] + r * n[d]
        gap = max(low - centre, centre - high)
        if gap > 0.0:
            to_centre += gap * gap
        gap = max(low - p[d], p[d] - high)
        if gap > 0.0:
            to_probe += gap * gap
        from_probe += max(high - p[d], p[d] - low) ** 2
        above, below = (high, low) if n[d] > 0.0 else (low, high)
        highest += n[d] * (above - p[d])
        lowest += n[d] * (below - p[d])
        along += slabs[node, d] * centre
    if highest <= 0.0 or highest * highest < sine * sine * to_probe:
        return True
    # What reaches as deep as b r into a ball, at an angle a over the tangent plane,
    # makes it smaller by the share b / (2 sin(a)^2).
    depth = max(sine, lowest / math.sqrt(from_probe)) if from_probe > 0.0 else sine
    reach = r * (1.0 - 2.0 * EXCESS * depth * depth)
    if to_centre >= reach * reach:
        return True
    return max(slabs[node, 3] - along, along - slabs[node, 4]) >= reach


@part
def nearer_half(boxes, node, p):
    """Return which of the two halves of a box has its centre nearer to p, in the 1-norm."""
    near, far = 2 * node, 2 * node + 1
    to_near, to_far = 0.0, 0.0
    for d in range(3):
        to_near += abs(boxes[near, d] + boxes[near, 3 + d] - 2.0 * p[d])
        to_far += abs(boxes[far, d] + boxes[far, 3 + d] - 2.0 * p[d])
    return far if to_far < to_near else near
