"""Edge flips of triangles towards a constrained Delaunay triangulation.

Edges wait in a queue.  One that is flipped keeps its number, and puts the four edges around it into
the queue again.  So triangles and edges know each other at any time, and nothing is sorted.

References
----------
C. L. Lawson, "Software for C1 surface interpolation", in: Mathematical Software III (1977)
161-194.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.vectors import between, cross, dot, norm


@lean
def _angle(points, a, b, c):
    """Return cosine and sine, 0 to 180 degrees, of the angle at a between b and c; or zeros."""
    u, v = between(points, a, b), between(points, a, c)
    scale = math.sqrt(dot(u, u) * dot(v, v))
    return (dot(u, v) / scale, norm(cross(u, v)) / scale) if scale > 0.0 else (0.0, 0.0)


@lean
def _squared(points, a, b):
    edge = between(points, a, b)
    return dot(edge, edge)


@lean
def _smallest_sine(points, a, b, c):
    """Return the sine of the smallest angle of a triangle, exactly the same in any order."""
    if b < a:
        a, b = b, a
    if c < b:
        b, c = c, b
    if b < a:
        a, b = b, a
    # The smallest angle is opposite to the shortest edge.
    ab, bc, ca = _squared(points, a, b), _squared(points, b, c), _squared(points, c, a)
    if ca < bc and ca <= ab:
        a, b, c = b, c, a
    elif ab < bc:
        a, b, c = c, a, b
    return _angle(points, a, b, c)[1]


@lean
def _should_flip(points, c, p, d, q):
    """Return whether cd is better than pq as the edge between the triangles on four nodes.

    The angles opposite to pq exceed 180 degrees, and the smallest angle increases.  In the plane
    the latter follows from the former.  It is what makes an end of the flips certain on any
    surface, in spite of rounding: the sorted list of the smallest angles of all triangles
    increases.
    """
    cosine_c, sine_c = _angle(points, c, p, q)
    cosine_d, sine_d = _angle(points, d, p, q)
    # The opposite angles must exceed 180 degrees by more than rounding (sine of the excess).
    if -(cosine_c * sine_d + sine_c * cosine_d) <= 1e-9:
        return False
    before = min(_smallest_sine(points, c, p, q), _smallest_sine(points, d, p, q))
    after = min(_smallest_sine(points, c, p, d), _smallest_sine(points, c, d, q))
    return after > before


@lean
def _place(i, j, n_places):
    """Return the list of an edge in a hash table of a power of two of lists."""
    key = np.int64(min(i, j)) * 1000003 + np.int64(max(i, j)) * 138122
    return (key ^ (key >> 17)) & (n_places - 1)


@lean
def _add(edges, e, head, link):
    """Add edge e to its list."""
    place = _place(edges[e, 0], edges[e, 1], head.shape[0])
    link[e] = head[place]
    head[place] = e


@lean
def _remove(edges, e, head, link):
    """Remove edge e from its list."""
    place = _place(edges[e, 0], edges[e, 1], head.shape[0])
    if head[place] == e:
        head[place] = link[e]
        return
    other = head[place]
    while link[other] != e:
        other = link[other]
    link[other] = link[e]


@lean
def _exists(edges, i, j, head, link):
    """Return whether an edge of the mesh joins two nodes."""
    e = head[_place(i, j, head.shape[0])]
    while e >= 0:
        if (edges[e, 0] == i and edges[e, 1] == j) or (edges[e, 0] == j and edges[e, 1] == i):
            return True
        e = link[e]
    return False


@lean
def _set_corner(mesh, new, node, e, old):
    """Put a node and the edge opposite to it into a corner; the edge was opposite to ``old``."""
    cells, _, cell_edges, corners, _, _ = mesh
    cells[new // 3, new % 3] = node
    cell_edges[new // 3, new % 3] = e
    for side in range(2):
        if corners[e, side] == old:
            corners[e, side] = new
            return


@lean
def _flip_edge(mesh, e):
    """Replace the triangles (c, p, q) and (d, q, p) at edge e by (c, p, d) and (c, d, q)."""
    cells, edges, cell_edges, corners, head, link = mesh
    at_c, at_d = corners[e, 0], corners[e, 1]
    one, other = at_c // 3, at_d // 3
    at_p, at_q = 3 * one + (at_c + 1) % 3, 3 * one + (at_c + 2) % 3
    beyond_q, beyond_p = 3 * other + (at_d + 1) % 3, 3 * other + (at_d + 2) % 3
    c, d = cells[one, at_c % 3], cells[other, at_d % 3]
    p, q = cells[one, at_p % 3], cells[one, at_q % 3]
    cp, qc = cell_edges[one, at_q % 3], cell_edges[one, at_p % 3]
    dq, pd = cell_edges[other, beyond_p % 3], cell_edges[other, beyond_q % 3]
    _remove(edges, e, head, link)
    edges[e, 0], edges[e, 1] = c, d
    _add(edges, e, head, link)
    _set_corner(mesh, 3 * one, c, pd, beyond_q)
    _set_corner(mesh, 3 * one + 2, d, cp, at_q)
    _set_corner(mesh, 3 * other, c, dq, beyond_p)
    _set_corner(mesh, 3 * other + 1, d, qc, at_p)
    cells[one, 1], cell_edges[one, 1] = p, e
    cells[other, 2], cell_edges[other, 2] = q, e
    corners[e, 0], corners[e, 1] = 3 * one + 1, 3 * other + 2


@lean_kernel
def flip(points, mesh, tags, is_free, scratch):
    """Flip edges until the angles opposite to each free one sum up to at most 180 degrees.

    Edges between triangles of different tags or orientations stay, and so do those whose flip would
    repeat an edge of the mesh.

    Parameters
    ----------
    points : float64[n, 3]
    mesh : tuple
        In/Out: ``cells`` int32[m, 3]; ``edges`` int32[k, 2]; ``cell_edges`` int32[m, 3], the edge
        opposite to each corner.  Scratch: ``corners`` int64[k, 2], the corners opposite to each
        edge; ``head`` int32[a power of two] and ``link`` int32[k], the edges by their nodes.
    tags : int32[m]
    is_free : bool[k]
        Edges of two cells that may be flipped.
    scratch : tuple of int32[k], bool[k]

    Returns
    -------
    int
        Number of flips.
    """
    (cells, edges, cell_edges, corners, head, link), (queue, is_queued) = mesh, scratch
    n_edges = edges.shape[0]
    for place in range(head.shape[0]):
        head[place] = -1
    for e in range(n_edges):
        corners[e, 0] = -1
        corners[e, 1] = -1
        _add(edges, e, head, link)
    for c in range(cells.shape[0]):
        for v in range(3):
            e = cell_edges[c, v]
            corners[e, 0 if corners[e, 0] < 0 else 1] = 3 * c + v
    n_flips, repeat = 0, True
    while repeat:
        first, n_waiting, n_before, n_refused = 0, 0, n_flips, 0
        for e in range(n_edges):
            is_queued[e] = is_free[e]
            if is_free[e]:
                queue[n_waiting] = e
                n_waiting += 1
        while n_waiting > 0:
            e = queue[first]
            first = (first + 1) % n_edges
            n_waiting -= 1
            is_queued[e] = False
            at_c, at_d = corners[e, 0], corners[e, 1]
            one, other = at_c // 3, at_d // 3
            c, d = cells[one, at_c % 3], cells[other, at_d % 3]
            p, q = cells[one, (at_c + 1) % 3], cells[one, (at_c + 2) % 3]
            if c == d or tags[one] != tags[other] or cells[other, (at_d + 1) % 3] != q:
                continue
            if not _should_flip(points, c, p, d, q):
                continue
            if _exists(edges, c, d, head, link):
                n_refused += 1
                continue
            _flip_edge(mesh, e)
            n_flips += 1
            for side in range(2):
                t = corners[e, side] // 3
                for v in range(3):
                    near = cell_edges[t, v]
                    if near != e and is_free[near] and not is_queued[near]:
                        is_queued[near] = True
                        queue[(first + n_waiting) % n_edges] = near
                        n_waiting += 1
        # What was refused may be allowed after later flips.
        repeat = n_refused > 0 and n_flips > n_before
    return n_flips
