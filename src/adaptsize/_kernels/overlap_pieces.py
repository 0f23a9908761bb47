"""Intersections of the cells of two meshes, divided into simplices: pieces of their overlap.

Where overlap.py integrates over what clipping.py leaves of a cell, quadrature needs its simplices.
"""

import numpy as np

from adaptsize._kernels.clipping import (
    begin_faces,
    clip,
    next_at_corner,
    set_coordinates,
    set_corners,
    set_gradients,
)
from adaptsize._kernels.compiling import inlined, lean, lean_kernel


@lean
def _add_piece(work, corners, p, used, out, axes):
    """Write one simplex of an intersection; return the number of simplices.

    ``corners``: its corners among those of the intersection; ``p``: the pair.
    """
    pair_of, in_new, in_old = out
    k = len(axes) + 1
    pair_of[used] = p
    for i in range(k):
        q = corners[i]
        for v in range(k):
            in_old[used, i, v] = work.place[q, v]
            total = 0.0
            for a in range(k):
                total += work.place[q, a] * work.local[a, v]
            in_new[used, i, v] = total
    return used + 1


@inlined
def _divide_polygon(work, n, p, used, out, axes):
    """Write the triangles of a polygon of n corners; return the number of simplices."""
    for q in range(2, n):
        used = _add_piece(work, (0, q - 1, q, q), p, used, out, axes)
    return used


@inlined
def _divide_polyhedron(work, n, p, used, out, axes):
    """Write the tetrahedra of a polyhedron of n corners; return the number of simplices.

    They connect corner 0 with the triangles of all faces that do not have it.
    """
    twins, seen = work.twins, work.seen
    begin_faces(work, n)
    for first in range(4, 4 * n):
        if seen[first]:
            continue
        start, h = first >> 2, twins[first]
        x = h >> 2
        while True:
            h = next_at_corner(h)
            seen[h] = True
            h = twins[h]
            y = h >> 2
            if y == start:
                break
            used = _add_piece(work, (0, start, x, y), p, used, out, axes)
            x = y
    return used


@lean_kernel
def fill_pieces(old, new, pairs, work, out, axes):
    """Divide the intersections of pairs of cells into simplices.

    Parameters
    ----------
    old, new : tuple of float64[n, 3], int32[m, k]
        Points and cells, in the plane with a third coordinate.
    pairs : tuple of int32[n], int32[n]
        The new and the old cell of each pair.
    work : Clipping
        Scratch.
    out : tuple of int32[room], float64[room, k, k], float64[room, k, k]
        Out: the pair of each simplex, and the barycentric coordinates of its corners in the new and
        in the old cell.
    axes : tuple of length k - 1

    Returns
    -------
    int
        Number of pairs that were processed: those for which there was room.
    int
        Number of simplices.
    """
    k = len(axes) + 1
    room = out[0].shape[0]
    used = np.int64(0)  # callees would be compiled for a literal, too
    for p in range(pairs[0].shape[0]):
        c, row = np.int64(pairs[0][p]), np.int64(pairs[1][p])
        for d in range(k - 1):
            work.start[d] = new[0][new[1][c, 0], d]
        set_corners(new[0], new[1], c, work.start, axes, work.cut)
        set_corners(old[0], old[1], row, work.start, axes, work.corners)
        if set_gradients(work.cut, axes, work.gradients) == 0.0:
            continue
        if set_gradients(work.corners, axes, work.old_gradients) == 0.0:
            continue
        set_coordinates(work.gradients, work.cut, work.corners, axes, work.local)
        set_coordinates(work.old_gradients, work.corners, work.cut, axes, work.back)
        for i in range(k):
            for v in range(k):
                work.place[i, v] = work.back[i, v]
        n = clip(work, axes)
        if n == 0:
            continue
        if used + 2 * n > room:
            return np.int64(p), used
        if k == 3:
            used = _divide_polygon(work, n, p, used, out, axes)
        else:
            used = _divide_polyhedron(work, n, p, used, out, axes)
    return np.int64(pairs[0].shape[0]), used
