"""Intersections of the cells of two meshes: their measures, and integrals over them.

The cell that has fewer sides through the other one cuts it (clipping.py).  Coordinates are taken
relative to a corner of the new cell, so that none is larger than the two cells.

The old cells that overlap a new one are found from neighbour to neighbour [1]_, beginning with the
one at its centroid, and where these do not cover it, by a search tree.

References
----------
.. [1] P. E. Farrell, J. R. Maddison, "Conservative interpolation between volume meshes by local
   Galerkin projection", Comput. Methods Appl. Mech. Eng. 200 (2011) 89-100.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.clipping import clip, integrate, set_coordinates, set_corners, set_gradients
from adaptsize._kernels.compiling import inlined, lean, lean_kernel
from adaptsize._kernels.trees import DEPTH, box_of_cell, cells_of_leaf, leaf_within
from adaptsize._kernels.vectors import dot, triple

# A new cell of which a larger share is missing may extend beyond the boundary, or across a slit.
_COVERED = 1e-12


class Front(NamedTuple):
    """The old cells that may overlap a new one.

    Parameters
    ----------
    neighbours : int32[m, k]
        The old cell beyond the side opposite to each corner, -1 where there is none.
    stamps : int32[m]
        In/Out: the number of the new cell for which an old cell was queued last, plus one.
    queue : int32[room]
        Scratch.
    """

    neighbours: np.ndarray
    stamps: np.ndarray
    queue: np.ndarray


@inlined
def _intersection(old, k, new_measure, work, whole, axes):
    """Return the measure that old cell k and the new cell of the scratch have in common.

    If ``whole``, set the integrals of the products of coordinates in the new and the old cell.
    """
    corners, mixed, place = work.corners, work.mixed, work.place
    dim = len(axes)
    n_corners = dim + 1
    set_corners(old.points, old.cells, k, work.start, axes, corners)
    # A side of one cell that has all of the other beyond it: nothing to be cut.
    for i in range(1, n_corners):
        gradient = triple(work.gradients, i, 0)
        highest = -math.inf
        for v in range(n_corners):
            mixed[i, v] = dot(gradient, triple(corners, v, 0))
            highest = max(highest, mixed[i, v])
        if highest <= 0.0:
            return 0.0
    highest = -math.inf
    for v in range(n_corners):
        rest = 1.0
        for i in range(1, n_corners):
            rest -= mixed[i, v]
        mixed[0, v] = rest
        highest = max(highest, rest)
    if highest <= 0.0:
        return 0.0
    measure = set_gradients(corners, axes, work.old_gradients)
    if measure == 0.0:
        return 0.0
    set_coordinates(work.old_gradients, corners, work.cut, axes, work.back)
    cuts = 0
    for v in range(n_corners):
        highest, lowest = -math.inf, math.inf
        for i in range(n_corners):
            highest, lowest = max(highest, work.back[i, v]), min(lowest, work.back[i, v])
        if highest <= 0.0:
            return 0.0
        cuts += lowest < 0.0
    # The cell that has fewer sides through the other one cuts it.
    for i in range(n_corners):
        lowest = math.inf
        for v in range(n_corners):
            lowest = min(lowest, mixed[i, v])
        cuts -= lowest < 0.0
    turned = cuts > 0
    if turned:
        measure = new_measure
    for i in range(n_corners):
        for v in range(n_corners):
            place[i, v] = mixed[v, i] if turned else work.back[i, v]
    n = clip(work, axes)
    if n == 0:
        return 0.0
    measure = integrate(work, n, measure, whole, axes)
    if whole:
        for i in range(n_corners):
            for j in range(n_corners):
                total = 0.0
                for a in range(n_corners):
                    if turned:
                        total += work.products[i, a] * work.back[a, j]
                    else:
                        total += mixed[i, a] * work.products[a, j]
                work.local[i, j] = total
    return measure


@inlined
def _walk(old, neighbours, row, work, axes):
    """Walk from an old cell to the one at the centroid of the new cell; return -1 on failure."""
    k = len(axes) + 1
    for _ in range(DEPTH):
        set_corners(old.points, old.cells, row, work.start, axes, work.corners)
        if set_gradients(work.corners, axes, work.old_gradients) == 0.0:
            return np.int64(-1)
        set_coordinates(work.old_gradients, work.corners, work.cut, axes, work.back)
        lowest, side = 0.0, np.int64(-1)
        for v in range(k):
            total = 0.0
            for i in range(k):
                total += work.back[i, v]
            if total < lowest:
                lowest, side = total, np.int64(v)
        if side < 0:
            return row
        row = np.int64(neighbours[row, side])
        if row < 0:
            return row
    return np.int64(-1)


@inlined
def _queue_by_boxes(old, front, stamp, n, new, c, work):
    """Queue old cells whose boxes are near that of new cell c; return the length of the queue."""
    (_, stamps, queue), box = front, box_of_cell(*new, c)
    work.stack[0], height = 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_within(old.boxes, work.stack, height, (box, 0.0))
        for row in range(*cells_of_leaf(leaf, old.boxes, stamps.shape[0])):
            if stamps[row] != stamp and n < queue.shape[0]:
                stamps[row] = stamp
                queue[n] = row
                n += 1
    return n


@inlined
def _queue_neighbours(row, front, stamp, n, back, axes):
    """Queue the neighbours of an old cell into which the new one extends; return the length."""
    neighbours, stamps, queue = front
    for v in range(len(axes) + 1):
        lowest = 0.0
        for i in range(len(axes) + 1):
            lowest = min(lowest, back[i, v])
        other = neighbours[row, v]
        if lowest < 0.0 and other >= 0 and stamps[other] != stamp:
            stamps[other] = stamp
            queue[n] = other
            n += 1
    return n


@lean
def _add_products(cells, c, work, place, used, members, axes):
    """Add the products of an intersection to those of the new cell; return the number of rows.

    ``c``: the old cell; ``place``: first row of the new cell.
    """
    _, node_of, slot, products = members
    k = len(axes) + 1
    for v in range(k):
        node = cells[c, v]
        row = np.int64(slot[node])
        if row < place or row >= used or node_of[row] != node:
            row = used
            slot[node] = row
            node_of[row] = node
            for i in range(k):
                products[row, i] = 0.0
            used += 1
        for i in range(k):
            products[row, i] += work.local[i, v]
    return used


@lean_kernel
def fill_overlaps(old, front, new, which, work, overlaps, members, axes):
    r"""Find the old cells that overlap each new cell, and integrals over the intersections.

    Parameters
    ----------
    old : Tree
        Triangles in the plane or tetrahedra.
    front : Front
        With stamps 0, and ``room`` at least that of k cells.
    new : tuple of float64[n_new, 3], int32[m_new, k]
        The new points and cells.
    which : int64[n]
        New cells to process, in this order, as many as there is room for.
    work : Clipping
        Scratch.
    overlaps : tuple of int64[m_new], int32[room], float64[room]
        Out: the number of old cells that overlap each new cell; the old cells, those of one new
        cell after the other; the measures of the overlaps, > 0.
    members : tuple of int64[m_new], int32[room], int32[n_old], float64[room, k]
        Out: the number of nodes of these old cells, for each new cell; the nodes, those of one new
        cell after the other; scratch; the integrals of :math:`\phi_i \phi_j` over the new cell,
        for its corners i and the old node j.  Not filled if there is room for none.
    axes : tuple of length k - 1

    Returns
    -------
    int
        Number of new cells that were processed; 0 if there is no room for one.
    int
        Number of overlaps.
    int
        Number of nodes.
    """
    cells = new[1]
    counts, found, measures = overlaps
    n_nodes, node_of, _, _ = members
    k = len(axes) + 1
    whole, room = node_of.shape[0] > 0, front.queue.shape[0]
    used = n_used = seed = np.int64(0)  # callees would be compiled for a literal, too
    for place in range(which.shape[0]):
        c = which[place]
        start, first, stamp = used, n_used, np.int32(c + 1)
        counts[c] = 0
        for d in range(k - 1):
            work.start[d] = new[0][cells[c, 0], d]
        set_corners(new[0], cells, c, work.start, axes, work.cut)
        size = set_gradients(work.cut, axes, work.gradients)
        if size == 0.0:
            continue
        at = n = np.int64(0)
        row = _walk(old, front.neighbours, seed, work, axes)
        if row >= 0:
            front.stamps[row] = stamp
            front.queue[0] = row
            n += 1
        covered, complete = 0.0, False
        while at < n or not complete:
            if at == n:
                complete = True
                if covered < (1.0 - _COVERED) * size:
                    n = _queue_by_boxes(old, front, stamp, n, new, c, work)
                    if n == room:
                        return place, start, first
                continue
            row = np.int64(front.queue[at])
            at += 1
            measure = _intersection(old, row, size, work, whole, axes)
            if measure > 0.0:
                if used == found.shape[0] or n + k > room or (whole and n_used + k > room):
                    return place, start, first
                found[used] = seed = row
                measures[used] = measure
                covered += measure
                used += 1
                if whole:
                    n_used = _add_products(old.cells, row, work, first, n_used, members, axes)
                n = _queue_neighbours(row, front, stamp, n, work.back, axes)
        counts[c] = used - start
        if whole:
            n_nodes[c] = n_used - first
    return which.shape[0], used, n_used


@lean_kernel
def fill_rows(rings, cells, members, nodes, slot, rows):
    """Sum integrals over cells to the rows of the mixed mass matrix, one for each new node.

    Parameters
    ----------
    rings : tuple of int32[n + 1], int32[m * k]
        The new cells around each node.
    cells : int32[m, k]
        The new cells.
    members : tuple of int64[m], int64[m], int32[used], float64[used, k]
        For each new cell the first and the number of its rows in those that follow: old nodes, and
        the integrals of `fill_overlaps`.
    nodes : tuple of int
        The first and the last new node to process.
    slot : int64[n_old]
        Scratch.
    rows : tuple of int64[last - first], int32[room], float64[room]
        Out: the number of entries of each row; their columns and values.

    Returns
    -------
    int
        Number of entries.
    """
    (ring_ptr, ring), (counts, columns, values) = rings, rows
    first_row, n_rows, node_of, products = members
    used = np.int64(0)
    for i in range(nodes[0], nodes[1]):
        first = used
        for at in range(ring_ptr[i], ring_ptr[i + 1]):
            c = ring[at]
            v = 0
            while cells[c, v] != i:
                v += 1
            for row in range(first_row[c], first_row[c] + n_rows[c]):
                node = node_of[row]
                place = slot[node]
                if place < first or place >= used or columns[place] != node:
                    place = used
                    slot[node] = place
                    columns[place] = node
                    values[place] = 0.0
                    used += 1
                values[place] += products[row, v]
        counts[i - nodes[0]] = used - first
    return used
