"""Intersections of the cells of two meshes: their measures, and integrals over them.

The new cell is cut by the sides of the old one.  Its corners are given by their barycentric
coordinates in the old cell, so that a side of that cell is where one coordinate is zero.  In the
plane what is left is a convex polygon.  In space it is a convex polyhedron of which three edges
meet at each corner; it is kept as a graph of its corners, which is cut by the signs of one
coordinate alone [1]_.  Corners that coincide by degeneracy do no harm then.  Coordinates in space
are taken relative to a corner of the new cell, so that none is larger than the two cells.

The old cells that overlap a new one are found from neighbour to neighbour [2]_, beginning with the
one at its centroid, and where these do not cover it, by a search tree.

Edge e of corner p of a polyhedron has the number 4 p + e.  The same edge has another number at its
other end, which is its *twin*.

References
----------
.. [1] D. Powell, T. Abel, "An exact general remeshing scheme applied to physically conservative
   voxelization", J. Comput. Phys. 297 (2015) 340-356.
.. [2] P. E. Farrell, J. R. Maddison, "Conservative interpolation between volume meshes by local
   Galerkin projection", Comput. Methods Appl. Mech. Eng. 200 (2011) 89-100.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inlined, kernel, lean, lean_kernel
from adaptsize._kernels.trees import DEPTH, box_of_cell, cells_of_leaf, leaf_within

# A tetrahedron cut by four planes has at most 8 faces, so 12 corners and 18 edges, on each of which
# a corner may be added before others are removed.  A triangle cut three times has at most 6.
MAX_CORNERS = 32

# A new cell of which a larger share is missing may extend beyond the boundary, or across a slit.
_COVERED = 1e-12

# Twins of the edges of a tetrahedron.
_TETRAHEDRON = (6, 14, 8, 0, 10, 12, 0, 0, 2, 13, 4, 0, 5, 9, 1, 0)


class Clipping(NamedTuple):
    """Scratch for the intersection of two cells.

    Parameters
    ----------
    start : float64[3]
        First corner of the new cell, from which coordinates are taken.
    cut : float64[4, 3]
        Corners of the new cell.
    corners : float64[4, 3]
        Corners of the old cell.
    gradients, old_gradients : float64[4, 3]
        Gradients of the barycentric coordinates of the two cells, from the second one on.
    mixed : float64[4, 4]
        Coordinates in the new cell (rows) of the corners of the old one (columns).
    back : float64[4, 4]
        Coordinates in the old cell (columns) of the corners of the new one (rows).
    place, other : float64[MAX_CORNERS, 4]
        Barycentric coordinates of the corners of what is left, in the cell that cuts.
    twins : int64[4 * MAX_CORNERS]
        The other number of each edge; edges in the same sense around each corner.
    seen : bool[4 * MAX_CORNERS]
        Edges of the faces that were visited.
    first : float64[3]
        Integrals of coordinates relative to a corner of what is left.
    second : float64[3, 3]
        Integrals of their products.
    products : float64[4, 4]
        Integrals of the products of these coordinates.
    local : float64[4, 4]
        Integrals of the products of coordinates in the new cell (rows) and in the old one.
    stack : int64[DEPTH]
    """

    start: np.ndarray
    cut: np.ndarray
    corners: np.ndarray
    gradients: np.ndarray
    old_gradients: np.ndarray
    mixed: np.ndarray
    back: np.ndarray
    place: np.ndarray
    other: np.ndarray
    twins: np.ndarray
    seen: np.ndarray
    first: np.ndarray
    second: np.ndarray
    products: np.ndarray
    local: np.ndarray
    stack: np.ndarray


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


def new_clipping() -> Clipping:
    """Return scratch for one thread."""
    return Clipping(
        np.empty(3), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)),
        np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((MAX_CORNERS, 4)), np.zeros((MAX_CORNERS, 4)),
        np.zeros(4 * MAX_CORNERS, np.int64), np.zeros(4 * MAX_CORNERS, np.bool_),
        np.zeros(3), np.zeros((3, 3)), np.zeros((4, 4)), np.zeros((4, 4)),
        np.empty(DEPTH, np.int64),
    )  # fmt: skip


@lean
def _set_corners(points, cells, c, start, axes, corners):
    """Set the corners of a cell, relative to a point."""
    for v in range(len(axes) + 1):
        for d in range(len(axes)):
            corners[v, d] = points[cells[c, v], d] - start[d]


@lean
def _set_gradients(x, axes, gradients):
    """Set the gradients of the barycentric coordinates; return the measure, 0 of a flat cell."""
    e0, e1, e2 = x[1, 0] - x[0, 0], x[1, 1] - x[0, 1], x[1, 2] - x[0, 2]
    f0, f1, f2 = x[2, 0] - x[0, 0], x[2, 1] - x[0, 1], x[2, 2] - x[0, 2]
    if len(axes) == 2:
        twice = e0 * f1 - e1 * f0
        if twice == 0.0:
            return 0.0
        gradients[1, 0], gradients[1, 1] = f1 / twice, -f0 / twice
        gradients[2, 0], gradients[2, 1] = -e1 / twice, e0 / twice
        return 0.5 * abs(twice)
    g0, g1, g2 = x[3, 0] - x[0, 0], x[3, 1] - x[0, 1], x[3, 2] - x[0, 2]
    a0, a1, a2 = f1 * g2 - f2 * g1, f2 * g0 - f0 * g2, f0 * g1 - f1 * g0
    six = e0 * a0 + e1 * a1 + e2 * a2
    if six == 0.0:
        return 0.0
    s = 1.0 / six
    gradients[1, 0], gradients[1, 1], gradients[1, 2] = s * a0, s * a1, s * a2
    gradients[2, 0] = s * (g1 * e2 - g2 * e1)
    gradients[2, 1] = s * (g2 * e0 - g0 * e2)
    gradients[2, 2] = s * (g0 * e1 - g1 * e0)
    gradients[3, 0] = s * (e1 * f2 - e2 * f1)
    gradients[3, 1] = s * (e2 * f0 - e0 * f2)
    gradients[3, 2] = s * (e0 * f1 - e1 * f0)
    return abs(six) / 6.0


@lean
def _set_coordinates(gradients, corners, x, axes, result):
    k = len(axes) + 1
    """Set the barycentric coordinates of points in a cell, ``result[i, v]`` coordinate v of i."""
    for i in range(k):
        r0, r1, r2 = x[i, 0] - corners[0, 0], x[i, 1] - corners[0, 1], x[i, 2] - corners[0, 2]
        rest = 1.0
        for v in range(1, k):
            value = gradients[v, 0] * r0 + gradients[v, 1] * r1
            if k == 4:
                value += gradients[v, 2] * r2
            result[i, v] = value
            rest -= value
        result[i, 0] = rest


@inlined
def _clip_polygon(work, v, n):
    """Cut a polygon of n corners where coordinate v is negative; return how many are left."""
    place, other = work.place, work.other
    left = 0
    p = n - 1
    before = place[p, v]
    for q in range(n):
        after = place[q, v]
        if (before >= 0.0) != (after >= 0.0):
            t = before / (before - after)
            for a in range(3):
                other[left, a] = place[p, a] + t * (place[q, a] - place[p, a])
            left += 1
        if after >= 0.0:
            for a in range(3):
                other[left, a] = place[q, a]
            left += 1
        p, before = q, after
    for q in range(left):
        for a in range(3):
            place[q, a] = other[q, a]
    return left


@lean
def _turned(h):
    """Return the edge of a corner that follows edge h, in the sense of rotation."""
    return h + 1 if h & 3 < 2 else h - 2


@inlined
def _clip_polyhedron(work, v, n):
    """Cut a polyhedron of n corners where coordinate v is negative; return how many are left."""
    place, twins = work.place, work.twins
    if n > 12:  # not convex, which rounding of flat cells might cause
        return n
    # A corner on each edge that crosses the plane.
    total = n
    for p in range(n):
        inside = place[p, v]
        if inside < 0.0:
            continue
        for e in range(3):
            q = twins[4 * p + e] >> 2
            outside = place[q, v]
            if outside >= 0.0:
                continue
            t = inside / (inside - outside)
            for a in range(4):
                place[total, a] = place[p, a] + t * (place[q, a] - place[p, a])
            twins[4 * total] = 4 * p + e
            twins[4 * p + e] = 4 * total
            total += 1
    # The edges between them: along what is left of each face that was cut, to the next one.
    for new in range(n, total):
        h = twins[4 * new]
        while h < 4 * n:
            h = twins[_turned(h)]
        twins[4 * new + 2] = h + 1
        twins[h + 1] = 4 * new + 2
    # The last corners take the places of those that are cut off.
    for p in range(n):
        if p >= total or place[p, v] >= 0.0:
            continue
        total -= 1
        while total > p and total < n and place[total, v] < 0.0:
            total -= 1
        if total == p:
            break
        for a in range(4):
            place[p, a] = place[total, a]
        for e in range(3):
            h = twins[4 * total + e]
            twins[4 * p + e] = h
            twins[h] = 4 * p + e
    return total


@inlined
def _polygon_integrals(work, n, whole):
    """Return the area of a polygon over that of the old cell; set the integrals of coordinates."""
    place = work.place
    o1, o2 = place[0, 1], place[0, 2]
    area = f1 = f2 = s11 = s12 = s22 = 0.0
    x1, x2 = place[1, 1] - o1, place[1, 2] - o2
    for q in range(2, n):
        y1, y2 = place[q, 1] - o1, place[q, 2] - o2
        twice = x1 * y2 - x2 * y1
        area += twice
        if whole:
            t1, t2 = x1 + y1, x2 + y2
            f1 += twice * t1
            f2 += twice * t2
            s11 += twice * (x1 * x1 + y1 * y1 + t1 * t1)
            s12 += twice * (x1 * x2 + y1 * y2 + t1 * t2)
            s22 += twice * (x2 * x2 + y2 * y2 + t2 * t2)
        x1, x2 = y1, y2
    sign = 1.0 if area > 0.0 else -1.0
    work.first[0], work.first[1] = sign * f1 / 3.0, sign * f2 / 3.0
    work.second[0, 0], work.second[1, 1] = sign * s11 / 12.0, sign * s22 / 12.0
    work.second[0, 1] = work.second[1, 0] = sign * s12 / 12.0
    return abs(area)


@inlined
def _polyhedron_integrals(work, n, whole):
    """Return the volume of a polyhedron over that of the old cell; set the integrals."""
    place, twins, seen = work.place, work.twins, work.seen
    o1, o2, o3 = place[0, 1], place[0, 2], place[0, 3]
    volume = f1 = f2 = f3 = s11 = s12 = s13 = s22 = s23 = s33 = 0.0
    for h in range(4 * n):
        # Faces at corner 0, from which coordinates are taken, count nothing.
        seen[h] = h & 3 == 3
    for e in range(3):
        h = np.int64(e)
        while not seen[h]:
            seen[h] = True
            h = _turned(twins[h])
    for first in range(4, 4 * n):
        if seen[first]:
            continue
        # A fan of triangles from the first corner of the face.
        start, h = first >> 2, twins[first]
        a1, a2, a3 = place[start, 1] - o1, place[start, 2] - o2, place[start, 3] - o3
        p = h >> 2
        x1, x2, x3 = place[p, 1] - o1, place[p, 2] - o2, place[p, 3] - o3
        while True:
            h = _turned(h)
            seen[h] = True
            h = twins[h]
            p = h >> 2
            if p == start:
                break
            y1, y2, y3 = place[p, 1] - o1, place[p, 2] - o2, place[p, 3] - o3
            six = a1 * (x2 * y3 - x3 * y2) + a2 * (x3 * y1 - x1 * y3) + a3 * (x1 * y2 - x2 * y1)
            volume += six
            if whole:
                t1, t2, t3 = a1 + x1 + y1, a2 + x2 + y2, a3 + x3 + y3
                f1 += six * t1
                f2 += six * t2
                f3 += six * t3
                s11 += six * (a1 * a1 + x1 * x1 + y1 * y1 + t1 * t1)
                s12 += six * (a1 * a2 + x1 * x2 + y1 * y2 + t1 * t2)
                s13 += six * (a1 * a3 + x1 * x3 + y1 * y3 + t1 * t3)
                s22 += six * (a2 * a2 + x2 * x2 + y2 * y2 + t2 * t2)
                s23 += six * (a2 * a3 + x2 * x3 + y2 * y3 + t2 * t3)
                s33 += six * (a3 * a3 + x3 * x3 + y3 * y3 + t3 * t3)
            x1, x2, x3 = y1, y2, y3
    sign = 1.0 if volume > 0.0 else -1.0
    work.first[0], work.first[1], work.first[2] = sign * f1 / 4, sign * f2 / 4, sign * f3 / 4
    second = work.second
    second[0, 0], second[1, 1], second[2, 2] = sign * s11 / 20, sign * s22 / 20, sign * s33 / 20
    second[0, 1] = second[1, 0] = sign * s12 / 20
    second[0, 2] = second[2, 0] = sign * s13 / 20
    second[1, 2] = second[2, 1] = sign * s23 / 20
    return abs(volume)


@inlined
def _set_products(work, axes, measure, share):
    k = len(axes) + 1
    """Set the integrals of the products of coordinates in the old cell, of the given measure.

    Those over what is left, the given share of the cell, follow from the integrals of coordinates
    relative to corner 0 of what is left, and from the sum of all coordinates, which is 1.
    """
    products, place = work.products, work.place
    for a in range(1, k):
        for b in range(1, k):
            products[a, b] = measure * (
                work.second[a - 1, b - 1]
                + place[0, a] * work.first[b - 1]
                + place[0, b] * (work.first[a - 1] + share * place[0, a])
            )
    products[0, 0] = measure * share
    for a in range(1, k):
        rest = measure * (work.first[a - 1] + share * place[0, a])
        products[0, 0] -= rest
        for b in range(1, k):
            rest -= products[a, b]
        products[0, a] = products[a, 0] = rest
        products[0, 0] -= rest


@inlined
def _intersection(old, k, new_measure, work, whole, axes):
    """Return the measure that old cell k and the new cell of the scratch have in common.

    If ``whole``, set the integrals of the products of coordinates in the new and the old cell.
    """
    corners, mixed, place = work.corners, work.mixed, work.place
    dim = len(axes)
    n_corners = dim + 1
    _set_corners(old.points, old.cells, k, work.start, axes, corners)
    # A side of one cell that has all of the other beyond it: nothing to be cut.
    for i in range(1, n_corners):
        g0, g1, g2 = work.gradients[i, 0], work.gradients[i, 1], work.gradients[i, 2]
        highest = -math.inf
        for v in range(n_corners):
            value = g0 * corners[v, 0] + g1 * corners[v, 1]
            if dim == 3:
                value += g2 * corners[v, 2]
            mixed[i, v] = value
            highest = max(highest, value)
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
    measure = _set_gradients(corners, axes, work.old_gradients)
    if measure == 0.0:
        return 0.0
    _set_coordinates(work.old_gradients, corners, work.cut, axes, work.back)
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
    n = n_corners
    if dim == 3:
        for h in range(16):
            work.twins[h] = _TETRAHEDRON[h]
    for v in range(n_corners):
        lowest = math.inf
        for i in range(n):
            lowest = min(lowest, place[i, v])
        if lowest >= 0.0:
            continue
        n = _clip_polygon(work, v, n) if dim == 2 else _clip_polyhedron(work, v, n)
        if n < n_corners:
            return 0.0
    if dim == 2:
        share = _polygon_integrals(work, n, whole)
    else:
        share = _polyhedron_integrals(work, n, whole)
    if whole:
        _set_products(work, axes, measure, share)
        for i in range(n_corners):
            for j in range(n_corners):
                total = 0.0
                for a in range(n_corners):
                    if turned:
                        total += work.products[i, a] * work.back[a, j]
                    else:
                        total += mixed[i, a] * work.products[a, j]
                work.local[i, j] = total
    return measure * share


@inlined
def _walk(old, neighbours, row, work, axes):
    """Walk from an old cell to the one at the centroid of the new cell; return -1 on failure."""
    k = len(axes) + 1
    for _ in range(DEPTH):
        _set_corners(old.points, old.cells, row, work.start, axes, work.corners)
        if _set_gradients(work.corners, axes, work.old_gradients) == 0.0:
            return np.int64(-1)
        _set_coordinates(work.old_gradients, work.corners, work.cut, axes, work.back)
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
        _set_corners(new[0], cells, c, work.start, axes, work.cut)
        size = _set_gradients(work.cut, axes, work.gradients)
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
def add_mass(cells, share, x, y):
    """Add the product of the mass matrix of linear elements with columns.

    Parameters
    ----------
    cells : int32[m, k]
    share : float64[m]
        The measures of the cells over k (k + 1).
    x, y : float64[n, columns]
        ``y``: In/Out.
    """
    for c in range(cells.shape[0]):
        for j in range(x.shape[1]):
            total = 0.0
            for v in range(cells.shape[1]):
                total += x[cells[c, v], j]
            for v in range(cells.shape[1]):
                y[cells[c, v], j] += share[c] * (x[cells[c, v], j] + total)


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
            low = np.inf
            high = -np.inf
            for place in range(start[i], start[i + 1]):
                if weights[place] > 0.0:
                    value = values[found[place], j]
                    mean += weights[place] / total * value
                    low = min(low, value)
                    high = max(high, value)
            result[i, j] = min(max(mean, low), high)
