"""Closest point of a segment, a triangle or a tetrahedron.

Points are float64[n, 3] here: planes and lines are padded with zeros, so that one
kernel serves every dimension.  A query point and the vectors are tuples of three
floats, which the compiler keeps in registers.

The weights that come back are barycentric, >= 0 and of sum 1 to rounding.  A simplex
too flat to have a reliable inside is replaced by its faces, down to its
vertices; that moves no closest point by more than its height.
"""

import math

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.vectors import between, cross, dot, mean, offset, without

# |sine| of a corner (solid for tetrahedra) below which a simplex counts as flat: the
# determinant, of relative error 1e-16 / sine, still has three digits there.
_FLAT = 1e-13
# Below this the weights are refined and the signs of the weights are not reliable.
_NEARLY_FLAT = 1e-3
# Squares of lengths below this are near the end of the range of float64.
_TINY = 1e-290

#: What weights are worth: none, refined (signs in doubt), accurate.
NO_WEIGHTS, REFINED, ACCURATE = 0, 1, 2


@inner
def closest_on_segment(points, a, b, x):
    """Return the squared distance of x to a segment, and the weights of its ends there.

    Parameters
    ----------
    points : float64[n, 3]
    a, b : int
        Ends of the segment; they may coincide.
    x : tuple of 3 float64

    Returns
    -------
    float64
        Squared distance; exactly 0 where x lies on the line to the last bit.
    float64, float64
        Weights of a and b.
    """
    e = between(points, a, b)
    r = offset(points, a, x)
    length2 = dot(e, e)
    t = 0.0
    if length2 > _TINY:
        t = min(max(dot(r, e) / length2, 0.0), 1.0)
        if 0.0 < t < 1.0 and _is_zero(cross(r, e)):
            return 0.0, 1.0 - t, t
    rest = offset(points, b, x) if t == 1.0 else without(r, t, e)
    return dot(rest, rest), 1.0 - t, t


@inner
def _is_zero(u):
    return u[0] == 0.0 and u[1] == 0.0 and u[2] == 0.0


@inner
def triangle_weights(points, a, b, c, x):
    """Return the barycentric coordinates of the foot of x in the plane of a triangle.

    With e1 = b - a, e2 = c - a, n = e1 x e2 and r = x - a,

        w_b = (r x e2) . n / |n|^2,    w_c = (e1 x r) . n / |n|^2.

    The cross product keeps the digits of a sliver that the Gram determinant loses;
    refinement by the residual restores those the division loses.

    Parameters
    ----------
    points : float64[n, 3]
    a, b, c : int
    x : tuple of 3 float64

    Returns
    -------
    int
        NO_WEIGHTS (flat triangle), REFINED or ACCURATE.
    float64, float64, float64
        Weights, any sign, of sum 1.
    float64
        Squared distance of x to the plane, 0 where r . n is 0 exactly.
    """
    e1 = between(points, a, b)
    e2 = between(points, a, c)
    r = offset(points, a, x)
    n = cross(e1, e2)
    nn = dot(n, n)
    sides = dot(e1, e1) * dot(e2, e2)
    if nn <= _TINY or nn <= _FLAT * _FLAT * sides:
        return NO_WEIGHTS, 1.0, 0.0, 0.0, 0.0
    w_b = dot(cross(r, e2), n) / nn
    w_c = dot(cross(e1, r), n) / nn
    accuracy = ACCURATE
    rest = without(without(r, w_b, e1), w_c, e2)
    if nn < _NEARLY_FLAT * _NEARLY_FLAT * sides:
        accuracy = REFINED
        for _ in range(2):
            w_b += dot(cross(rest, e2), n) / nn
            w_c += dot(cross(e1, rest), n) / nn
            rest = without(without(r, w_b, e1), w_c, e2)
    height2 = 0.0 if dot(r, n) == 0.0 else dot(rest, rest)
    return accuracy, 1.0 - w_b - w_c, w_b, w_c, height2


@inner
def closest_on_triangle(points, a, b, c, x):
    """Return the squared distance of x to a triangle, and the weights of its corners there.

    Outside, the closest point lies on an edge whose opposite weight is negative.

    Parameters
    ----------
    points : float64[n, 3]
    a, b, c : int
        Corners; they may coincide or lie on a line.
    x : tuple of 3 float64

    Returns
    -------
    float64
        Squared distance.
    float64, float64, float64
        Weights.
    """
    accuracy, w_a, w_b, w_c, height2 = triangle_weights(points, a, b, c, x)
    best = math.inf
    if accuracy != NO_WEIGHTS and min(w_a, w_b, w_c) >= 0.0:
        if accuracy == ACCURATE:
            return height2, w_a, w_b, w_c
        best = height2
    corners = (a, b, c)
    signs = (w_a, w_b, w_c)
    at = (w_a, w_b, w_c)
    for k in range(3):  # one loop body instead of three: it compiles three times as fast
        if accuracy == ACCURATE and signs[k] >= 0.0:
            continue
        i, j = (k + 1) % 3, (k + 2) % 3
        d2, s, t = closest_on_segment(points, corners[i], corners[j], x)
        if d2 < best:
            best = d2
            at = (
                s if i == 0 else (t if j == 0 else 0.0),
                s if i == 1 else (t if j == 1 else 0.0),
                s if i == 2 else (t if j == 2 else 0.0),
            )
    return best, at[0], at[1], at[2]


@inner
def tetrahedron_weights(points, corners, x):
    """Return the barycentric coordinates of x in a tetrahedron (Cramer's rule, refined).

    Parameters
    ----------
    points : float64[n, 3]
    corners : tuple of 4 int
    x : tuple of 3 float64

    Returns
    -------
    int
        NO_WEIGHTS (flat), REFINED or ACCURATE.
    float64, float64, float64, float64
        Weights, any sign, of sum 1.
    """
    a, b, c, d = corners
    e1 = between(points, a, b)
    e2 = between(points, a, c)
    e3 = between(points, a, d)
    r = offset(points, a, x)
    n1 = cross(e2, e3)
    n2 = cross(e3, e1)
    n3 = cross(e1, e2)
    volume = dot(e1, n1)
    sides = math.sqrt(dot(e1, e1) * dot(e2, e2)) * math.sqrt(dot(e3, e3))
    if abs(volume) <= _TINY or abs(volume) <= _FLAT * sides:
        return NO_WEIGHTS, 1.0, 0.0, 0.0, 0.0
    w1 = dot(r, n1) / volume
    w2 = dot(r, n2) / volume
    w3 = dot(r, n3) / volume
    accuracy = ACCURATE
    if abs(volume) < _NEARLY_FLAT * sides:
        accuracy = REFINED
        for _ in range(3):
            rest = without(without(without(r, w1, e1), w2, e2), w3, e3)
            w1 += dot(rest, n1) / volume
            w2 += dot(rest, n2) / volume
            w3 += dot(rest, n3) / volume
    return accuracy, 1.0 - w1 - w2 - w3, w1, w2, w3


@inner
def closest_on_tetrahedron(points, corners, x):
    """Return the squared distance of x to a tetrahedron, and the weights there.

    Outside, the closest point lies on a face whose opposite weight is negative.

    Parameters
    ----------
    points : float64[n, 3]
    corners : tuple of 4 int
        They may coincide or lie in a plane.
    x : tuple of 3 float64

    Returns
    -------
    float64
        Squared distance, 0 inside.
    float64, float64, float64, float64
        Weights.
    """
    accuracy, w_a, w_b, w_c, w_d = tetrahedron_weights(points, corners, x)
    if accuracy != NO_WEIGHTS and min(w_a, w_b, w_c, w_d) >= 0.0:
        return 0.0, w_a, w_b, w_c, w_d
    best = math.inf
    signs = (w_a, w_b, w_c, w_d)
    at = signs
    for k in range(4):
        if accuracy == ACCURATE and signs[k] >= 0.0:
            continue
        # The face without corner k, in the order of the corners.
        face_a = corners[0 if k > 0 else 1]
        face_b = corners[1 if k > 1 else 2]
        face_c = corners[2 if k > 2 else 3]
        d2, s, t, u = closest_on_triangle(points, face_a, face_b, face_c, x)
        if d2 < best:
            best = d2
            at = (
                0.0 if k == 0 else s,
                0.0 if k == 1 else (s if k < 1 else t),
                0.0 if k == 2 else (t if k < 2 else u),
                0.0 if k == 3 else u,
            )
    return best, at[0], at[1], at[2], at[3]


@inner
def closest_on_facet(points, facets, f, x):
    """Return the squared distance of x to facet f, and three weights (0 beyond its corners).

    Parameters
    ----------
    points : float64[n, 3]
    facets : int32[m, k]
        Points, segments or triangles: k = 1, 2 or 3.
    f : int
    x : tuple of 3 float64

    Returns
    -------
    float64
    tuple of 3 float64
    """
    a = facets[f, 0]
    if facets.shape[1] == 3:
        d2, s, t, u = closest_on_triangle(points, a, facets[f, 1], facets[f, 2], x)
        return d2, (s, t, u)
    if facets.shape[1] == 2:
        d2, s, t = closest_on_segment(points, a, facets[f, 1], x)
        return d2, (s, t, 0.0)
    gap = offset(points, a, x)
    return dot(gap, gap), (1.0, 0.0, 0.0)


@inner
def place_on_facet(points, facets, f, weights):
    """Return the point of a facet with given weights."""
    last = facets.shape[1] - 1
    return mean(points, (facets[f, 0], facets[f, min(1, last)], facets[f, last]), weights)


@kernel
def closest_on_cell(points, cells, c, x):
    """Return the squared distance of x to cell c, and four weights (0 beyond its corners).

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        k = 1, 2 or 3.
    c : int
    x : tuple of 3 float64

    Returns
    -------
    float64
    tuple of 4 float64
    """
    if cells.shape[1] < 4:
        d2, (s, t, u) = closest_on_facet(points, cells, c, x)
        return d2, (s, t, u, 0.0)
    corners = (cells[c, 0], cells[c, 1], cells[c, 2], cells[c, 3])
    d2, s, t, u, v = closest_on_tetrahedron(points, corners, x)
    return d2, (s, t, u, v)


@inner
def find_inside(points, cells, c, x):
    """Return whether x lies in cell c (a triangle in its plane, a tetrahedron); four weights.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        k = 2 with all points in the plane z = 0, or k = 3.
    c : int
    x : tuple of 3 float64

    Returns
    -------
    bool
        False for flat cells, which hold no point.
    tuple of 4 float64
    """
    if cells.shape[1] == 3:
        accuracy, s, t, u, _ = triangle_weights(points, cells[c, 0], cells[c, 1], cells[c, 2], x)
        v = 0.0
    else:
        corners = (cells[c, 0], cells[c, 1], cells[c, 2], cells[c, 3])
        accuracy, s, t, u, v = tetrahedron_weights(points, corners, x)
    inside = accuracy != NO_WEIGHTS and min(s, t, u, v) >= 0.0
    return inside, (s, t, u, v)


@kernel
def fill_closest(points, cells, which, queries, weights):
    """Fill the weights of the point of a given cell that is closest to each query.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
    which : int32[n_queries]
        Rows of ``cells``.
    queries : float64[n_queries, 3]
    weights : float64[n_queries, k + 1]
        Out.
    """
    for q in range(which.shape[0]):
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        _, w = closest_on_cell(points, cells, which[q], x)
        for v in range(cells.shape[1]):
            weights[q, v] = w[v]
