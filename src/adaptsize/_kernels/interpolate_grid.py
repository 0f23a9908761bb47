"""Multilinear interpolation between the nodes of a Cartesian grid."""

import math

import numpy as np

from adaptsize._kernels.compiling import kernel


@kernel
def interpolate_grid(
    lower, spacing, shape, snap, values, active, queries, first, last, result, distances
):
    """Fill the multilinear interpolant at the closest point of the grid's box.

    Corners of weight 0 do not count, so that 0 * inf is no nan, and neither do corners
    that are not active; the weights of the others are then scaled to the sum 1.  The
    result is kept between the smallest and the largest value that count: constants are
    exact.  One query costs the eight corners of its box at most.

    Parameters
    ----------
    lower, spacing : float64[3]
        Of the axes that the grid lacks: 0 and 1.
    shape : int64[3]
        Nodes per axis, 1 along axes that the grid lacks.
    snap : float64[3]
        Points within this distance of a plane of nodes, in spacings, lie in it.
    values : float64[n_points]
        Finite or +inf, the last axis fastest.
    active : bool[n_points] or bool[0]
        Empty if all nodes are active.
    queries : float64[n_queries, dim]
    first, last : int
        Only ``queries[first:last]`` are processed.
    result : float64[n_queries]
        Out: inf where no active corner counts.
    distances : float64[n_queries]
        Out: from the box, 0 inside.
    """
    dim = queries.shape[1]
    masked = active.shape[0] > 0
    corner = np.zeros(3, np.int64)
    share = np.zeros(3)
    gap = np.zeros(3)
    for q in range(first, last):
        for d in range(dim):
            along = (queries[q, d] - lower[d]) / spacing[d]
            end = float(shape[d] - 1)
            gap[d] = 0.0
            if along < 0.0:
                gap[d] = lower[d] - queries[q, d]
                along = 0.0
            elif along > end:
                gap[d] = queries[q, d] - (lower[d] + end * spacing[d])
                along = end
            i = min(int(along), shape[d] - 2)
            f = along - i
            if f <= snap[d]:
                f = 0.0
            elif f >= 1.0 - snap[d]:
                f = 1.0
            corner[d] = i
            share[d] = f
        distances[q] = math.hypot(math.hypot(gap[0], gap[1]), gap[2])
        total = 0.0
        weight = 0.0
        low = math.inf
        high = -math.inf
        for a in range(2):
            w_a = share[0] if a == 1 else 1.0 - share[0]
            if w_a == 0.0:
                continue
            for b in range(2):
                w_b = w_a * (share[1] if b == 1 else 1.0 - share[1])
                if w_b == 0.0:
                    continue
                row = ((corner[0] + a) * shape[1] + corner[1] + b) * shape[2] + corner[2]
                for c in range(2):
                    w = w_b * (share[2] if c == 1 else 1.0 - share[2])
                    if w == 0.0 or (masked and not active[row + c]):
                        continue
                    value = values[row + c]
                    total += w * value
                    weight += w
                    low = min(low, value)
                    high = max(high, value)
        if weight == 0.0:
            result[q] = math.inf
        else:
            result[q] = min(max(total / weight, low), high)
