"""Local mesh improvement: smoothing of nodes in their stars.

The quality is the volume-length measure: the measure of a cell over that of a regular one with
the same root mean square edge length; 1 at best, 0 for flat cells, negative for inverted ones.

References
----------
V. N. Parthasarathy, C. M. Graichen, A. F. Hathaway, "A comparison of tetrahedron quality
measures", Finite Elem. Anal. Des. 15 (1994) 255-261.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel, lean
from adaptsize._kernels.vectors import between, cross, dot

#: A change must gain this much.
GAIN = 1e-3


@inner
def _triangle(points, a, b, c):
    """Return 4 sqrt(3) A / (sum of squared edges), signed."""
    ux = points[b, 0] - points[a, 0]
    uy = points[b, 1] - points[a, 1]
    vx = points[c, 0] - points[a, 0]
    vy = points[c, 1] - points[a, 1]
    wx = vx - ux
    wy = vy - uy
    squares = ux * ux + uy * uy + vx * vx + vy * vy + wx * wx + wy * wy
    if squares == 0.0:
        return 0.0
    return 3.4641016151377544 * (ux * vy - uy * vx) / squares


@lean
def tetrahedron(points, a, b, c, d):
    """Return 6 sqrt(2) V / (root mean square edge)^3, signed."""
    u, v, w = between(points, a, b), between(points, a, c), between(points, a, d)
    six = dot(u, cross(v, w))
    # The squares of the other three edges are u . u + v . v - 2 u . v and so on.
    squares, products = dot(u, u) + dot(v, v) + dot(w, w), dot(u, v) + dot(u, w) + dot(v, w)
    mean = (3.0 * squares - 2.0 * products) / 6.0
    if mean <= 0.0:
        return 0.0
    return math.sqrt(2.0) * six / (mean * math.sqrt(mean))


@inner
def _quality(points, cells, c):
    if cells.shape[1] == 3:
        return _triangle(points, cells[c, 0], cells[c, 1], cells[c, 2])
    return tetrahedron(points, cells[c, 0], cells[c, 1], cells[c, 2], cells[c, 3])


@kernel
def fill_quality(points, cells, quality):
    """Fill the volume-length measure of each cell.

    Parameters
    ----------
    points : float64[n, dim]
    cells : int32[m, dim + 1]
    quality : float64[m]
        Out: -1 to 1.
    """
    for c in range(cells.shape[0]):
        quality[c] = _quality(points, cells, c)


@inner
def _worst_around(points, cells, rings, i):
    ring_ptr, ring = rings
    worst = 2.0
    for place in range(ring_ptr[i], ring_ptr[i + 1]):
        q = _quality(points, cells, ring[place])
        if q < worst:
            worst = q
    return worst


@kernel
def smooth_nodes(points, cells, rings, moves):
    """Move nodes one after the other so that the worst cell around each improves.

    For each node, steps along the axes in both directions and towards the mean of its neighbours
    are tested; if none improves the worst cell, the step is halved.  This compass search needs
    no gradient, which the quality of the worst cell does not have.

    Parameters
    ----------
    points : float64[n, dim]
        In/Out.
    cells : int32[m, dim + 1]
    rings : tuple of int32[n + 1], int32[m * (dim + 1)]
        Cells around each node.
    moves : tuple of int64[k], float64[n, dim], float64[n]
        The nodes to move, in this order; at each node the unit normal of the plane in which it may
        move, 0 if it may move freely; and the initial length of a step.
    """
    (ring_ptr, ring), (nodes, normals, steps) = rings, moves
    dim = points.shape[1]
    start = np.empty(dim)
    best = np.empty(dim)
    step_to = np.empty(dim)
    for k in range(nodes.shape[0]):
        i = nodes[k]
        worst = _worst_around(points, cells, rings, i)
        step = steps[i]
        for _ in range(6):
            for d in range(dim):
                start[d] = points[i, d]
                best[d] = start[d]
            before = worst
            for direction in range(2 * dim + 1):
                for d in range(dim):
                    step_to[d] = 0.0
                if direction < 2 * dim:
                    step_to[direction // 2] = step if direction % 2 == 0 else -step
                else:
                    count = 0
                    for place in range(ring_ptr[i], ring_ptr[i + 1]):
                        for v in range(dim + 1):
                            j = cells[ring[place], v]
                            if j != i:
                                count += 1
                                for d in range(dim):
                                    step_to[d] += points[j, d] - start[d]
                    for d in range(dim):
                        step_to[d] *= 0.5 / count
                along = 0.0
                for d in range(dim):
                    along += step_to[d] * normals[i, d]
                for d in range(dim):
                    points[i, d] = start[d] + step_to[d] - along * normals[i, d]
                q = _worst_around(points, cells, rings, i)
                if q > worst + GAIN:
                    worst = q
                    for d in range(dim):
                        best[d] = points[i, d]
                for d in range(dim):
                    points[i, d] = start[d]
            for d in range(dim):
                points[i, d] = best[d]
            if worst == before:
                step *= 0.5
