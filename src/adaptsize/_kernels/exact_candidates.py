"""Candidate sources: nodes of steep cells, and edges and faces that are not dominated.

Let h0 be linear on the cells, and y a point of the domain where h0(y) + g |x - y| is least,
the closest one to x of these.  In the cell T at y in the direction of x, moving y towards x changes
h0 by at most |grad h0| per length and the distance by -1; so |grad h0| > g in T.  Only the
vertices, edges and faces of such *steep* cells can hold y, and of the edges (faces) only those
along which h0 is less steep than g: on others the minimum is at an end (edge).
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact import fill_values
from adaptsize._kernels.linear_data import FLAT
from adaptsize._kernels.local_updates import distance

# Gradients below g by less than this are treated as steep, so that rounding loses no source.
_NEARLY = 1.0 - 1e-9


# What is left of a size when rounding is taken off.
_LESS = 1.0 - 1e-11


@lean
def _is_steep(points, axes, cells, c, h0, g):
    """Return whether |grad h0| in a cell may exceed g; all bounds are finite."""
    dim = len(axes)
    o = cells[c, 0]
    a11 = a12 = a22 = a13 = a23 = a33 = 0.0
    for d in range(dim):
        e1 = points[cells[c, 1], d] - points[o, d]
        e2 = points[cells[c, 2], d] - points[o, d]
        a11 += e1 * e1
        a12 += e1 * e2
        a22 += e2 * e2
        if dim == 3:
            e3 = points[cells[c, dim], d] - points[o, d]
            a13 += e1 * e3
            a23 += e2 * e3
            a33 += e3 * e3
    r1, r2 = h0[cells[c, 1]] - h0[o], h0[cells[c, 2]] - h0[o]
    if dim == 2:
        det = a11 * a22 - a12 * a12
        square = a22 * r1 * r1 - 2.0 * a12 * r1 * r2 + a11 * r2 * r2
        return det <= FLAT * a11 * a22 or square > g * g * _NEARLY * det
    r3 = h0[cells[c, dim]] - h0[o]
    b11, b22, b33 = a22 * a33 - a23 * a23, a11 * a33 - a13 * a13, a11 * a22 - a12 * a12
    b12, b13, b23 = a13 * a23 - a12 * a33, a12 * a23 - a13 * a22, a12 * a13 - a11 * a23
    det = a11 * b11 + a12 * b12 + a13 * b13
    square = b11 * r1 * r1 + b22 * r2 * r2 + b33 * r3 * r3
    square += 2.0 * (b12 * r1 * r2 + b13 * r1 * r3 + b23 * r2 * r3)
    return det <= FLAT * a11 * a22 * a33 or square > g * g * _NEARLY * det


@lean_kernel
def have_neighbours(cells, h0):
    """Return whether any cell has two nodes with finite bounds."""
    for c in range(cells.shape[0]):
        n_finite = 0
        for v in range(cells.shape[1]):
            if h0[cells[c, v]] < math.inf:
                n_finite += 1
        if n_finite > 1:
            return True
    return False


@lean_kernel
def any_edge_exceeds(points, axes, cells, h, g):
    """Return whether sizes differ by more than g times its length, and rounding, along any edge."""
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            for w in range(v):
                i, j = cells[c, v], cells[c, w]
                high, low = max(h[i], h[j]), min(h[i], h[j])
                rise = high * _LESS - low
                square = 0.0
                for d in range(len(axes)):
                    square += (points[i, d] - points[j, d]) ** 2
                if rise > 0.0 and rise * rise > g * g * square:
                    return True
    return False


@lean_kernel
def mark_steep(points, axes, cells, h0, g, linear, margin, steep, candidate):
    """Mark steep cells and the nodes that may be sources.

    A node may be one if it has a bound, a steep cell, and no neighbour in a steep cell that
    dominates it.  Cells without any bound are left out; those with bounds at some nodes are steep.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    h0 : float64[n]
    g : float64
    linear : bool
        Whether bounds count as linear on cells; if not, gentle cells are no better than others.
    margin : float
        A node is dominated if a neighbour allows less than its bound by more than this.
    steep : bool[m]
        Out: steep cells with two bounds or more.
    candidate : bool[n]
        Out.

    Returns
    -------
    int
        The number of cells marked.
    """
    corners = len(axes) + 1
    count = 0
    candidate[:] = False
    for c in range(cells.shape[0]):
        n_finite = 0
        for v in range(corners):
            if h0[cells[c, v]] < math.inf:
                n_finite += 1
        steep[c] = False
        if n_finite == 0:
            continue
        if linear and n_finite == corners and not _is_steep(points, axes, cells, c, h0, g):
            continue
        for v in range(corners):
            if h0[cells[c, v]] < math.inf:
                candidate[cells[c, v]] = True
        if n_finite > 1:
            steep[c] = True
            count += 1
    for c in range(cells.shape[0]):
        if not steep[c]:
            continue
        for v in range(corners):
            i = np.int64(cells[c, v])
            for w in range(v):
                j = np.int64(cells[c, w])
                away = g * distance(points, axes, i, j) + margin
                if h0[i] + away < h0[j]:
                    candidate[j] = False
                elif h0[j] + away < h0[i]:
                    candidate[i] = False
    return count


@lean_kernel
def keep_undominated(points, axes, rows, h0, source, table, g, edges, faces, block, keep):
    """Find the edges or faces that no source of one of their vertices dominates.

    For convex domains.  The size that an entry allows is a convex function, and h0 is linear on
    the edge (face).  Hence it is below h0 everywhere if it is below h0 at all vertices.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    rows : int32[m, k]
        Nodes of the edges or faces, padded with -1.
    h0 : float64[n]
    source : int32[n]
        The entry from which the size of each node grows, -1 if there is none.
    table, g, edges, faces, block
        As in `exact.lower_sizes`.
    keep : bool[m]
        Out.
    """
    values = block.values
    for r in range(rows.shape[0]):
        keep[r] = True
        count = np.int64(0)  # callees would be compiled for a literal, too
        for v in range(rows.shape[1]):
            if rows[r, v] >= 0:
                count += 1
                for d in range(len(axes)):
                    block.x[d, v] = points[rows[r, v], d]
        for v in range(count):
            k = np.int64(source[rows[r, v]])
            if k < 0 or not keep[r]:
                continue
            fill_values(table, k, axes, block.x, count, g, values, block.share, edges, faces)
            keep[r] = False
            for w in range(count):
                if not values[w] < h0[rows[r, w]]:
                    keep[r] = True
