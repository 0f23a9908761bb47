"""Sizes allowed by edges and triangles with linear bounds."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.exact import BLOCK, gather_block, least_allowed, push_children, reaches
from adaptsize._kernels.local_updates import distance, minimum_on_edge, minimum_on_triangle
from adaptsize._kernels.trees import DEPTH, LEAF

#: Cells and faces flatter than this (determinant of the Gram matrix over the product of squared
#: lengths) are treated as steep, since their gradients are dominated by rounding.
FLAT = 1e-14


@inner
def set_vertices(entries, k, axes, work):
    """Copy the vertices of entry k to work[1:]."""
    for v in range(entries.counts[k]):
        for d in range(len(axes)):
            work[1 + v, d] = entries.places[k, v, d]


@inner
def allowed(entries, k, axes, work, g, faces):
    """Return the size that entry k allows at work[0], and the weights of the minimising point.

    ``work``: float64[4, dim], rows 1 to 3 the vertices of the entry.  ``faces``: None if there
    are no triangles; their code is then not compiled.
    """
    zero = 0
    sizes = entries.sizes
    if entries.counts[k] == 1:
        return sizes[k, 0] + g * distance(work, axes, zero, zero + 1), 0.0, 0.0
    if faces is None or entries.counts[k] == 2:
        value, t = minimum_on_edge(
            work, axes, zero, zero + 1, zero + 2, sizes[k, 0], sizes[k, 1], g
        )
        return value, t, 0.0
    return minimum_on_triangle(
        work,
        axes,
        zero,
        zero + 1,
        zero + 2,
        zero + 3,
        sizes[k, 0],
        sizes[k, 1],
        sizes[k, 2],
        g,
        True,
    )


@kernel
def keep_undominated(points, axes, rows, h0, source, entries, g, faces, keep):
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
    entries : Entries
    g : float64
    faces : None or bool
        None if there are no triangles among the entries.
    keep : bool[m]
        Out.
    """
    work = np.empty((4, len(axes)))
    for r in range(rows.shape[0]):
        keep[r] = True
        for v in range(rows.shape[1]):
            if rows[r, v] < 0 or source[rows[r, v]] < 0 or not keep[r]:
                continue
            k = source[rows[r, v]]
            set_vertices(entries, k, axes, work)
            above = False
            for w in range(rows.shape[1]):
                i = rows[r, w]
                if i < 0:
                    continue
                for d in range(len(axes)):
                    work[0, d] = points[i, d]
                if not allowed(entries, k, axes, work, g, faces)[0] < h0[i]:
                    above = True
                    break
            keep[r] = above


@inner
def _fill_edge(entries, k, axes, x, count, g, values):
    """Fill the sizes that edge k allows at points, inf where the minimum is at an end.

    This is the closed form of `minimum_on_edge` for a block.  An end is a separate entry, or
    dominated.
    """
    rise = entries.sizes[k, 1] - entries.sizes[k, 0]
    length2 = 0.0
    for d in range(len(axes)):
        length2 += (entries.places[k, 1, d] - entries.places[k, 0, d]) ** 2
    slack2 = g * g * length2 - rise * rise
    scale = math.sqrt(max(0.0, length2 * slack2))
    for i in range(count):
        values[i] = math.inf
    if scale == 0.0:
        return
    for i in range(count):
        dot = height2 = 0.0
        for d in range(len(axes)):
            e = entries.places[k, 1, d] - entries.places[k, 0, d]
            dot += e * (x[d, i] - entries.places[k, 0, d])
        foot = dot / length2
        for d in range(len(axes)):
            e = entries.places[k, 1, d] - entries.places[k, 0, d]
            height2 += (x[d, i] - entries.places[k, 0, d] - foot * e) ** 2
        ratio = math.sqrt(height2) / scale
        t = foot - rise * ratio
        if 0.0 < t < 1.0:
            values[i] = entries.sizes[k, 0] + foot * rise + ratio * slack2


@inner
def _fill_face(entries, k, x, count, g, values):
    """Fill the sizes that triangle k allows at points, inf where the minimum is not inside.

    This is the closed form of `minimum_on_triangle` for a block.
    """
    for i in range(count):
        values[i] = math.inf
    places, sizes = entries.places, entries.sizes
    e1x, e1y, e1z = (
        places[k, 1, 0] - places[k, 0, 0],
        places[k, 1, 1] - places[k, 0, 1],
        places[k, 1, 2] - places[k, 0, 2],
    )
    e2x, e2y, e2z = (
        places[k, 2, 0] - places[k, 0, 0],
        places[k, 2, 1] - places[k, 0, 1],
        places[k, 2, 2] - places[k, 0, 2],
    )
    a11 = e1x * e1x + e1y * e1y + e1z * e1z
    a12 = e1x * e2x + e1y * e2y + e1z * e2z
    a22 = e2x * e2x + e2y * e2y + e2z * e2z
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    det = nx * nx + ny * ny + nz * nz
    if det <= FLAT * a11 * a22:
        return
    r1, r2 = sizes[k, 1] - sizes[k, 0], sizes[k, 2] - sizes[k, 0]
    q1, q2 = (a22 * r1 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det
    slack2 = g * g - (q1 * r1 + q2 * r2)
    if slack2 <= 0.0:
        return
    scale = 1.0 / math.sqrt(det * slack2)
    for i in range(count):
        wx, wy, wz = x[0, i] - places[k, 0, 0], x[1, i] - places[k, 0, 1], x[2, i] - places[k, 0, 2]
        w1 = e1x * wx + e1y * wy + e1z * wz
        w2 = e2x * wx + e2y * wy + e2z * wz
        p1, p2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
        ratio = abs(nx * wx + ny * wy + nz * wz) * scale
        l1, l2 = p1 - ratio * q1, p2 - ratio * q2
        if l1 >= 0.0 and l2 >= 0.0 and l1 + l2 <= 1.0:
            values[i] = sizes[k, 0] + p1 * r1 + p2 * r2 + ratio * slack2


@kernel
def lower_by_items(points, axes, order, first, last, entries, g, sizes, source, faces):
    """Lower the sizes of points to the minimum that edges or triangles allow.

    Parameters
    ----------
    points, axes, order, first, last, entries, g, sizes, source
        As in `exact.lower_sizes`.
    faces : None or bool
        None if there are no triangles among the entries.
    """
    dim = len(axes)
    m = entries.counts.shape[0]
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    box, values = np.empty(2 * dim), np.empty(BLOCK)
    x, h, by = np.empty((dim, BLOCK)), np.empty(BLOCK), np.empty(BLOCK, np.int32)
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        count = stop - start
        gather_block(points, axes, order, start, stop, x, box)
        worst = -math.inf
        for i in range(count):
            h[i], by[i] = sizes[order[start + i]], -1
            worst = max(worst, h[i])
        stack[0], bound[0], size = 1, -math.inf, 1
        while size > 0:
            size -= 1
            b = stack[size]
            if bound[size] >= worst:
                continue
            if 4 * b >= entries.n_leaves and not reaches(entries, b, axes, x, h, count, g):
                continue
            if b < entries.n_leaves:
                size = push_children(entries, axes, b, box, g, worst, stack, bound, size)
                continue
            leaf = b - entries.n_leaves
            for k in range(leaf * LEAF, min(m, (leaf + 1) * LEAF)):
                if least_allowed(entries, k, axes, box, g) >= worst:
                    continue
                if faces is None or entries.counts[k] == 2:
                    _fill_edge(entries, k, axes, x, count, g, values)
                else:
                    _fill_face(entries, k, x, count, g, values)
                for i in range(count):
                    if values[i] < h[i]:
                        h[i], by[i] = values[i], k
            worst = -math.inf
            for i in range(count):
                worst = max(worst, h[i])
        for i in range(count):
            if by[i] >= 0:
                sizes[order[start + i]] = h[i]
                source[order[start + i]] = by[i]
