"""Interpolation: of nodal values at located points, on grids, and by weighted means."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import kernel


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


class GridFrame(NamedTuple):
    """A Cartesian grid of three axes.

    Parameters
    ----------
    lower : float64[3]
        0 of the axes that the grid lacks.
    spacing : float64[3]
        1 of these axes.
    shape : int64[3]
        Nodes per axis, 1 along these axes.
    """

    lower: np.ndarray
    spacing: np.ndarray
    shape: np.ndarray


class GridNodes(NamedTuple):
    """The nodes of a Cartesian grid, whose frame comes first.

    Parameters
    ----------
    lower, spacing, shape
        As in `GridFrame`.
    snap : float64[dim]
        Points within this distance of a plane of nodes, in spacings, lie in it.
    active : bool[n_points]
        Or bool[0] if all nodes are active.
    """

    lower: np.ndarray
    spacing: np.ndarray
    shape: np.ndarray
    snap: np.ndarray
    active: np.ndarray


@kernel
def interpolate_grid(grid, values, queries, result, distances):
    """Fill the multilinear interpolant at the closest point of the grid's box.

    Corners of weight 0 do not count, so that 0 * inf is no nan, and neither do corners
    that are not active; the weights of the others are then scaled to the sum 1.  The
    result is kept between the smallest and the largest value that count: constants are
    exact.  One query costs the eight corners of its box at most.

    Parameters
    ----------
    grid : GridNodes
    values : float64[n_points]
        Finite or +inf, the last axis fastest.
    queries : float64[n_queries, dim]
    result : float64[n_queries]
        Out: inf where no active corner counts.
    distances : float64[n_queries]
        Out: from the box, 0 inside.
    """
    lower, spacing, shape, snap, active = grid
    dim = queries.shape[1]
    masked = active.shape[0] > 0
    corner = np.zeros(3, np.int64)
    share = np.zeros(3)
    gap = np.zeros(3)
    for q in range(queries.shape[0]):
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
            low = math.inf
            high = -math.inf
            for place in range(start[i], start[i + 1]):
                if weights[place] > 0.0:
                    value = values[found[place], j]
                    mean += weights[place] / total * value
                    low = min(low, value)
                    high = max(high, value)
            result[i, j] = min(max(mean, low), high)
