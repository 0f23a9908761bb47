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
from adaptsize._kernels.exact import FLAT, fill_values
from adaptsize._kernels.local_updates import distance
from adaptsize._kernels.vectors import between, cross, dot, norm, without

# Gradients below g by less than this are treated as steep, so that rounding loses no source.
_NEARLY = 1.0 - 1e-9
# Sources along edges count; a literal as argument would compile callees once more.
_EDGES = np.bool_(True)


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
                # What is left of a size when rounding is taken off.
                rise = high * (1.0 - 1e-11) - low
                square = 0.0
                for d in range(len(axes)):
                    square += (points[i, d] - points[j, d]) ** 2
                if rise > 0.0 and rise * rise > g * g * square:
                    return True
    return False


@lean_kernel
def mark_steep(points, axes, cells, h0, g, linear, steep, candidate):
    """Mark steep cells, and their nodes with a bound, which may be sources.

    Cells without any bound are left out; those with bounds at some nodes are steep.  Several
    threads may mark the nodes of different cells.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    h0 : float64[n]
    g : float64
    linear : bool
        Whether bounds count as linear on cells; if not, gentle cells are no better than others.
    steep : bool[m]
        Out: steep cells with two bounds or more.
    candidate : bool[n]
        In/Out: True is entered.
    """
    corners = len(axes) + 1
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
        steep[c] = n_finite > 1


@lean_kernel
def drop_dominated(points, axes, cells, h0, g, margin, steep, candidate):
    """Unmark nodes that a neighbour in a steep cell dominates.

    Parameters
    ----------
    points, axes, cells, h0, g, steep
        As in `mark_steep`.
    margin : float
        A node is dominated if a neighbour allows less than its bound by more than this.
    candidate : bool[n]
        In/Out: False is entered.
    """
    corners = len(axes) + 1
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


@lean_kernel
def keep_undominated(points, axes, rows, h0, source, table, g, faces, block, keep):
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
    table, g, faces, block
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
            fill_values(table, k, axes, block.x, count, g, values, block.share, _EDGES, faces)
            keep[r] = False
            for w in range(count):
                if not values[w] < h0[rows[r, w]]:
                    keep[r] = True


# Slopes, as shares of g, and angles that may be off by so much.
_ROUNDING = 1e-9


@lean
def _rise_from_edge(points, axes, i, j, k, h0):
    """Return how h0 changes, per length, from the line ij across to node k in their plane."""
    length2 = dot = square = 0.0
    for d in range(len(axes)):
        e = points[j, d] - points[i, d]
        length2 += e * e
        dot += e * (points[k, d] - points[i, d])
    t = dot / length2
    for d in range(len(axes)):
        square += (points[k, d] - points[i, d] - t * (points[j, d] - points[i, d])) ** 2
    if square <= FLAT * length2:
        return math.inf
    return (h0[k] - h0[i] - t * (h0[j] - h0[i])) / math.sqrt(square)


@lean
def _turn_about(points, i, j, p, q):
    """Return the angle from the half plane of the edge ij and p to that of q."""
    edge, to_q = between(points, i, j), between(points, i, q)
    n, m = cross(edge, between(points, i, p)), cross(edge, to_q)
    return math.atan2(dot(n, to_q) * norm(edge), dot(n, m))


@lean
def _angle_to(slope, across):
    """Return the smallest angle to a face at which a path may leave an edge; inf if never."""
    if slope >= across:
        return 0.0
    return math.inf if slope < -across else math.acos(slope / across)


@lean_kernel
def list_edges(points, axes, cells, steep, h0, h, g, rows):
    """List the edges of steep cells that may be sources, once for each such cell.

    An edge is out if h0 is as steep as g along it, or if what grows from its ends at their sizes
    h is below h0 all along it: the two cones form a tent with its top where they meet, and h0
    is linear, so that this point decides.  Such paths run along the edge, hence visibly.

    A size that grows from inside an edge leaves it at an angle whose cosine is the slope of h0
    along it over g, and across the edge at the rate r = sqrt(g^2 - slope^2).  It cannot be least if
    h0 falls faster than r into some cell; nor if h0 rises more slowly than r in the cell
    into which it goes.  ``allows`` is 1 if it does not fall so, plus 2 if it rises so.

    Parameters
    ----------
    points, axes, cells, steep, h0, g
        As in `mark_steep`.
    h : float64[n]
        Sizes that are reached, at most h0.
    rows : int32[e, dim + 1]
        Out: the nodes of each, padded with -1, and ``allows``, a sum of 1 and 2; as many as there
        is room for.

    Returns
    -------
    int
        Their number.
    """
    dim = len(axes)
    count = 0
    for c in range(cells.shape[0]):
        if not steep[c]:
            continue
        for v in range(dim + 1):
            for w in range(v):
                i, j = np.int64(cells[c, v]), np.int64(cells[c, w])
                if not (h0[i] < math.inf and h0[j] < math.inf):
                    continue
                length = distance(points, axes, i, j)
                rise = h0[j] - h0[i]
                if abs(rise) >= g * length:
                    continue
                t = 0.5 + 0.5 * min(1.0, max(-1.0, (h[j] - h[i]) / (g * length)))
                if 0.5 * (h[i] + h[j] + g * length) <= h0[i] + t * rise:
                    continue
                across = math.sqrt(g * g - (rise / length) ** 2)
                p = q = 0
                while p in (v, w):
                    p += 1
                if dim == 3:
                    q = 6 - v - w - p
                slope_p = _rise_from_edge(points, axes, i, j, cells[c, p], h0) + _ROUNDING * g
                allows = 1 if slope_p >= -across else 0
                if dim == 2:
                    allows += 2 if slope_p >= across else 0
                else:
                    slope_q = _rise_from_edge(points, axes, i, j, cells[c, q], h0) + _ROUNDING * g
                    allows = allows if slope_q >= -across else 0
                    width = abs(_turn_about(points, i, j, cells[c, p], cells[c, q]))
                    taken = _angle_to(slope_p, across) + _angle_to(slope_q, across)
                    allows += 2 if taken <= width + _ROUNDING else 0
                if count < rows.shape[0]:
                    rows[count, dim - 1] = -1
                    rows[count, 0], rows[count, 1], rows[count, dim] = i, j, allows
                count += 1
    return count


@lean_kernel
def list_faces(points, axes, cells, steep, h0, h, g, rows):
    """List the faces of steep tetrahedra that may be sources, once for each such cell.

    As `list_edges` in space, but a face is out if every point of it has a vertex from which a size
    below all its bounds grows: no point is farther from all vertices than the longest edge over
    sqrt(3).
    """
    count = 0
    for c in range(cells.shape[0]):
        if not steep[c]:
            continue
        for v in range(4):
            i, j, k = cells[c, (v + 1) % 4], cells[c, (v + 2) % 4], cells[c, (v + 3) % 4]
            if not (h0[i] < math.inf and h0[j] < math.inf and h0[k] < math.inf):
                continue
            o = cells[c, v]
            e1, e2, w = between(points, i, j), between(points, i, k), between(points, i, o)
            a11, a12, a22, w1, w2 = dot(e1, e1), dot(e1, e2), dot(e2, e2), dot(e1, w), dot(e2, w)
            r1, r2 = h0[j] - h0[i], h0[k] - h0[i]
            det = a11 * a22 - a12 * a12
            if det <= FLAT * a11 * a22:
                continue  # its edges are listed
            across2 = g * g - (a22 * r1 * r1 - 2.0 * a12 * r1 * r2 + a11 * r2 * r2) / det
            if across2 <= 0.0:
                continue
            longest = math.sqrt(max(a11, a22, a11 + a22 - 2.0 * a12))
            grown = max(h[i], h[j], h[k]) + g * longest / math.sqrt(3.0)
            if grown <= min(h0[i], h0[j], h0[k]):
                continue
            p1, p2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
            height = without(without(w, p1, e1), p2, e2)
            height2 = dot(height, height)
            slope = math.inf
            if height2 > FLAT * (a11 + a22):
                slope = (h0[o] - h0[i] - p1 * r1 - p2 * r2) / math.sqrt(height2) + _ROUNDING * g
            across = math.sqrt(across2)
            allows = (1 if slope >= -across else 0) + (2 if slope >= across else 0)
            if count < rows.shape[0]:
                rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = i, j, k, allows
            count += 1
    return count
