"""Local mesh improvement: smoothing of nodes in their stars, and swapping of tetrahedra.

The quality is the volume-length measure: the measure of a cell over that of a regular one with
the same root mean square edge length; 1 at best, 0 for flat cells, negative for inverted ones.

References
----------
V. N. Parthasarathy, C. M. Graichen, A. F. Hathaway, "A comparison of tetrahedron quality
measures", Finite Elem. Anal. Des. 15 (1994) 255-261.
L. A. Freitag, C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping and smoothing",
Int. J. Numer. Methods Eng. 40 (1997) 3979-4002.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel

#: Largest number of cells around an edge to remove; all triangulations of the ring are examined.
MOST_AROUND = 9
#: A change must gain this much.
_GAIN = 1e-3


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


@inner
def _tetrahedron(points, a, b, c, d):
    """Return 6 sqrt(2) V / (root mean square edge)^3, signed."""
    ux = points[b, 0] - points[a, 0]
    uy = points[b, 1] - points[a, 1]
    uz = points[b, 2] - points[a, 2]
    vx = points[c, 0] - points[a, 0]
    vy = points[c, 1] - points[a, 1]
    vz = points[c, 2] - points[a, 2]
    wx = points[d, 0] - points[a, 0]
    wy = points[d, 1] - points[a, 1]
    wz = points[d, 2] - points[a, 2]
    six = ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)
    u = ux * ux + uy * uy + uz * uz
    v = vx * vx + vy * vy + vz * vz
    w = wx * wx + wy * wy + wz * wz
    uv = ux * vx + uy * vy + uz * vz
    uw = ux * wx + uy * wy + uz * wz
    vw = vx * wx + vy * wy + vz * wz
    # The squares of the other three edges are u + v - 2 uv and so on.
    mean = (3.0 * (u + v + w) - 2.0 * (uv + uw + vw)) / 6.0
    if mean <= 0.0:
        return 0.0
    return math.sqrt(2.0) * six / (mean * math.sqrt(mean))


@inner
def _quality(points, cells, c):
    if cells.shape[1] == 3:
        return _triangle(points, cells[c, 0], cells[c, 1], cells[c, 2])
    return _tetrahedron(points, cells[c, 0], cells[c, 1], cells[c, 2], cells[c, 3])


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
def _worst_around(points, cells, ring_ptr, ring, i):
    worst = 2.0
    for place in range(ring_ptr[i], ring_ptr[i + 1]):
        q = _quality(points, cells, ring[place])
        if q < worst:
            worst = q
    return worst


@kernel
def smooth_nodes(points, cells, ring_ptr, ring, nodes, normals, steps):
    """Move nodes one after the other so that the worst cell around each improves.

    For each node, steps along the axes in both directions and towards the mean of its neighbours
    are tested; if none improves the worst cell, the step is halved.  This compass search needs
    no gradient, which the quality of the worst cell does not have.

    Parameters
    ----------
    points : float64[n, dim]
        In/Out.
    cells : int32[m, dim + 1]
    ring_ptr, ring : int32[n + 1], int32[m * (dim + 1)]
        Cells around each node.
    nodes : int64[k]
        The nodes to move, in this order.
    normals : float64[n, dim]
        Unit normal of the plane in which a node may move; 0 if it may move freely.
    steps : float64[n]
        Initial length of a step at each node.
    """
    dim = points.shape[1]
    start = np.empty(dim)
    best = np.empty(dim)
    way = np.empty(dim)
    for k in range(nodes.shape[0]):
        i = nodes[k]
        worst = _worst_around(points, cells, ring_ptr, ring, i)
        step = steps[i]
        for _ in range(6):
            for d in range(dim):
                start[d] = points[i, d]
                best[d] = start[d]
            before = worst
            for direction in range(2 * dim + 1):
                for d in range(dim):
                    way[d] = 0.0
                if direction < 2 * dim:
                    way[direction // 2] = step if direction % 2 == 0 else -step
                else:
                    count = 0
                    for place in range(ring_ptr[i], ring_ptr[i + 1]):
                        for v in range(dim + 1):
                            j = cells[ring[place], v]
                            if j != i:
                                count += 1
                                for d in range(dim):
                                    way[d] += points[j, d] - start[d]
                    for d in range(dim):
                        way[d] *= 0.5 / count
                along = 0.0
                for d in range(dim):
                    along += way[d] * normals[i, d]
                for d in range(dim):
                    points[i, d] = start[d] + way[d] - along * normals[i, d]
                q = _worst_around(points, cells, ring_ptr, ring, i)
                if q > worst + _GAIN:
                    worst = q
                    for d in range(dim):
                        best[d] = points[i, d]
                for d in range(dim):
                    points[i, d] = start[d]
            for d in range(dim):
                points[i, d] = best[d]
            if worst == before:
                step *= 0.5


@kernel
def swap(points, cells, ring_ptr, ring, bad, quality, removed, made):
    """Replace cells around bad ones by others on the same nodes, if the worst quality improves.

    For each bad cell, two operations are considered.  An interior edge is removed: the ring of
    nodes around it is filled with triangles, each joined to both ends of the edge, in the optimal
    triangulation (dynamic programming).  Or a face is replaced by the edge across it.  The best of
    these operations is applied.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 4]
        Positive.
    ring_ptr, ring : int32[n + 1], int32[4 * m]
    bad : int64[k]
        Cells to remove, the worst first.
    quality : float64[m]
        Of each cell.
    removed : bool[m]
        In/Out: all False; True for the cells that are replaced.
    made : int32[capacity, 4]
        Out: new cells; swapping stops when it is full.

    Returns
    -------
    int
        Number of new cells.
    """
    most = MOST_AROUND
    around = np.empty(most, np.int64)
    left = np.empty(most, np.int64)
    right = np.empty(most, np.int64)
    loop = np.empty(most, np.int64)
    value = np.empty((most, most))
    split = np.empty((most, most), np.int64)
    stack = np.empty((2 * most, 2), np.int64)
    found = np.empty((2 * most, 4), np.int64)
    chosen = np.empty((2 * most, 4), np.int64)
    gone = np.empty(most, np.int64)
    n_made = 0
    for turn in range(bad.shape[0]):
        c = bad[turn]
        if removed[c] or n_made + 2 * most > made.shape[0]:
            continue
        gain = _GAIN
        n_chosen = 0
        n_gone = 0
        for e in range(10):
            n_found = 0
            n = 0
            new = 2.0
            old = 2.0
            if e < 6:
                p = 0 if e < 3 else (1 if e < 5 else 2)
                q = e + 1 if e < 3 else (e - 1 if e < 5 else 3)
                a = cells[c, p]
                b = cells[c, q]
                usable = True
                for place in range(ring_ptr[a], ring_ptr[a + 1]):
                    t = ring[place]
                    has = False
                    for v in range(4):
                        has = has or cells[t, v] == b
                    if not has:
                        continue
                    if removed[t] or n == most:
                        usable = False
                        break
                    u = -1
                    w = -1
                    for v in range(4):
                        if cells[t, v] != a and cells[t, v] != b:
                            if u < 0:
                                u = cells[t, v]
                            else:
                                w = cells[t, v]
                    if _tetrahedron(points, a, b, u, w) < 0.0:
                        u, w = w, u
                    around[n] = t
                    left[n] = u
                    right[n] = w
                    n += 1
                    if quality[t] < old:
                        old = quality[t]
                if not usable or n < 3:
                    continue
                loop[0] = left[0]
                here = right[0]
                length = 1
                while here != loop[0] and length < n:
                    loop[length] = here
                    length += 1
                    there = here
                    for s in range(n):
                        if left[s] == there:
                            here = right[s]
                            break
                    if here == there:
                        break
                if length != n or here != loop[0]:
                    continue  # an edge on the boundary
                # value[i, j]: the worst cell if nodes i to j of the ring are filled at best.
                for i in range(n - 1):
                    value[i, i + 1] = 2.0
                for width in range(2, n):
                    for i in range(n - width):
                        j = i + width
                        value[i, j] = -2.0
                        for k in range(i + 1, j):
                            worst = min(value[i, k], value[k, j])
                            if worst <= value[i, j]:
                                continue
                            worst = min(worst, _tetrahedron(points, a, loop[i], loop[k], loop[j]))
                            if worst <= value[i, j]:
                                continue
                            worst = min(worst, _tetrahedron(points, b, loop[i], loop[j], loop[k]))
                            if worst > value[i, j]:
                                value[i, j] = worst
                                split[i, j] = k
                new = value[0, n - 1]
                if new - old <= gain:
                    continue
                stack[0, 0] = 0
                stack[0, 1] = n - 1
                height = 1
                while height > 0:
                    height -= 1
                    i = stack[height, 0]
                    j = stack[height, 1]
                    if j - i < 2:
                        continue
                    k = split[i, j]
                    found[n_found, 0] = a
                    found[n_found, 1] = loop[i]
                    found[n_found, 2] = loop[k]
                    found[n_found, 3] = loop[j]
                    found[n_found + 1, 0] = b
                    found[n_found + 1, 1] = loop[i]
                    found[n_found + 1, 2] = loop[j]
                    found[n_found + 1, 3] = loop[k]
                    n_found += 2
                    stack[height, 0] = i
                    stack[height, 1] = k
                    stack[height + 1, 0] = k
                    stack[height + 1, 1] = j
                    height += 2
            else:
                p = cells[c, e - 6]
                f0 = cells[c, (e - 5) % 4]
                f1 = cells[c, (e - 4) % 4]
                f2 = cells[c, (e - 3) % 4]
                if _tetrahedron(points, f0, f1, f2, p) < 0.0:
                    f1, f2 = f2, f1
                across = -1
                for place in range(ring_ptr[f0], ring_ptr[f0 + 1]):
                    t = ring[place]
                    if t == c:
                        continue
                    count = 0
                    o = -1
                    for v in range(4):
                        if cells[t, v] == f1 or cells[t, v] == f2:
                            count += 1
                        elif cells[t, v] != f0:
                            o = cells[t, v]
                    if count == 2:
                        across = t
                        break
                if across < 0 or removed[across]:
                    continue
                around[0] = c
                around[1] = across
                n = 2
                old = min(quality[c], quality[across])
                for s in range(3):
                    u = f0 if s == 0 else (f1 if s == 1 else f2)
                    w = f1 if s == 0 else (f2 if s == 1 else f0)
                    new = min(new, _tetrahedron(points, o, p, u, w))
                    found[s, 0] = o
                    found[s, 1] = p
                    found[s, 2] = u
                    found[s, 3] = w
                n_found = 3
                if new - old <= gain:
                    continue
            gain = new - old
            n_chosen = n_found
            n_gone = n
            for s in range(n_found):
                for v in range(4):
                    chosen[s, v] = found[s, v]
            for s in range(n):
                gone[s] = around[s]
        for s in range(n_gone):
            removed[gone[s]] = True
        for s in range(n_chosen):
            for v in range(4):
                made[n_made, v] = chosen[s, v]
            n_made += 1
    return n_made
