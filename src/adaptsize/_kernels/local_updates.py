r"""The size of one node from the opposite side of one simplex (Hopf-Lax updates).

For node k and a simplex whose opposite side F carries the linear sizes h, the
largest size that the slope g allows at k is

    min over y in F of  h(y) + g |x_k - y|,

a convex problem with a closed form [1]_.  It holds for any angle of the simplex
and any embedding dimension.

``axes`` is a tuple of which only the length counts, the embedding dimension: its
length is known when a kernel is compiled, so that the loops over it are unrolled.
With the star layout of fast_marching.py this halved the time of marching.

References
----------
.. [1] F. Bornemann, C. Rasch, "Finite-element discretization of static
   Hamilton-Jacobi equations based on a local variational principle",
   Comput. Vis. Sci. 9 (2006) 57-69.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean_kernel

# Kernels are compiled once more for each literal that is an argument, so these are none.

#: ``axes`` in the plane and in space.
PLANE = (np.int64(0), np.int64(0))
SPACE = (*PLANE, np.int64(0))

#: Values of ``with_bc``.
WITH_BC, WITHOUT_BC = np.bool_(True), np.bool_(False)


@lean_kernel
def distance(points, axes, i, j):
    """Return the distance of points i and j of float64[n, dim]."""
    total = 0.0
    for d in range(len(axes)):
        total += (points[i, d] - points[j, d]) ** 2
    return math.sqrt(total)


@lean_kernel
def minimum_on_edge(points, axes, k, ends, sizes, g):
    """Return the largest size at node k allowed by linear sizes on the edge (a, b), and where.

    With y(t) = x_a + t (x_b - x_a), the minimum over 0 <= t <= 1 of

        h_a + t (h_b - h_a) + g |x_k - y(t)|.

    With L the length of the edge, f its fraction at the foot of x_k, D the height
    over it and s = (h_b - h_a)/(g L), the stationary point is
    t = f - s D / (L sqrt(1 - s^2)), and the value there
    h_a + f (h_b - h_a) + g D sqrt(1 - s^2).

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    k : int
        Node to update.
    ends, sizes : tuple of 2 int, tuple of 2 float64
        Ends a and b of the opposite edge, which may coincide, and the finite sizes there.
    g : float64
        Gradient limit, >= 0.

    Returns
    -------
    value, t : float64
    """
    (a, b), (h_a, h_b) = ends, sizes
    length2 = 0.0
    dot = 0.0
    for d in range(len(axes)):
        e = points[b, d] - points[a, d]
        length2 += e * e
        dot += e * (points[k, d] - points[a, d])
    rise = h_b - h_a
    slack2 = g * g * length2 - rise * rise
    scale2 = length2 * slack2
    # Also g = 0, an edge whose length is 0 or whose squares underflow, and a rise whose square
    # overflows, so that scale2 is NaN if the length is 0.
    if not scale2 > 0.0:
        if rise >= 0.0:
            return h_a + g * distance(points, axes, k, a), 0.0
        return h_b + g * distance(points, axes, k, b), 1.0
    foot = dot / length2
    # Subtract vectors, not squares: this keeps the height of a sliver accurate.
    height2 = 0.0
    for d in range(len(axes)):
        height2 += (points[k, d] - points[a, d] - foot * (points[b, d] - points[a, d])) ** 2
    ratio = math.sqrt(height2 / scale2)  # D / (g L^2 sqrt(1 - s^2))
    t = foot - rise * ratio
    if t <= 0.0:
        return h_a + g * distance(points, axes, k, a), 0.0
    if t >= 1.0:
        return h_b + g * distance(points, axes, k, b), 1.0
    return h_a + foot * rise + ratio * slack2, t


@lean_kernel
def minimum_on_triangle(points, axes, k, corners, sizes, g, with_bc):
    """Return the largest size at node k allowed by linear sizes on the triangle (a, b, c).

    The point of the triangle's plane with barycentric coordinates
    (1 - l1 - l2, l1, l2) is stationary for l = p - D q / sqrt(g^2 - |q|^2), where p
    is the projection of x_k, D its distance from the plane, and q the gradient of
    the sizes, both in the basis of the two edges at a.  The value there is
    h_a + p.(h_b - h_a, h_c - h_a) + D sqrt(g^2 - |q|^2).  If it lies outside the
    triangle, the minimum of the convex function is on an edge that separates it
    from the triangle.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    k : int
        Node to update.
    corners, sizes : tuple of 3 int, tuple of 3 float64
        The opposite triangle a, b, c, which may be degenerate, and the finite sizes there.
    g : float64
        Gradient limit, >= 0.
    with_bc : bool
        False leaves out the edge (b, c), for callers that have evaluated it before.

    Returns
    -------
    value, l1, l2 : float64
        Size, and weights of b and c at the minimum; the size is inf if the minimum
        is on the edge (b, c) and that is left out.
    """
    (a, b, c), (h_a, h_b, h_c) = corners, sizes
    a11 = a12 = a22 = w1 = w2 = 0.0
    for d in range(len(axes)):
        e1 = points[b, d] - points[a, d]
        e2 = points[c, d] - points[a, d]
        w = points[k, d] - points[a, d]
        a11 += e1 * e1
        a12 += e1 * e2
        a22 += e2 * e2
        w1 += e1 * w
        w2 += e2 * w
    dh1 = h_b - h_a
    dh2 = h_c - h_a
    det = a11 * a22 - a12 * a12
    l0 = l1 = l2 = -1.0  # a degenerate triangle: all its edges
    if det > 1e-14 * a11 * a22:
        q1 = (a22 * dh1 - a12 * dh2) / det
        q2 = (a11 * dh2 - a12 * dh1) / det
        slack2 = g * g - (q1 * dh1 + q2 * dh2)
        if slack2 > 0.0:
            p1 = (a22 * w1 - a12 * w2) / det
            p2 = (a11 * w2 - a12 * w1) / det
            height2 = 0.0
            for d in range(len(axes)):
                e1 = points[b, d] - points[a, d]
                e2 = points[c, d] - points[a, d]
                height2 += (points[k, d] - points[a, d] - p1 * e1 - p2 * e2) ** 2
            ratio = math.sqrt(height2 / slack2)
            l1 = p1 - ratio * q1
            l2 = p2 - ratio * q2
            l0 = 1.0 - l1 - l2
            if l0 >= 0.0 and l1 >= 0.0 and l2 >= 0.0:
                return h_a + p1 * dh1 + p2 * dh2 + ratio * slack2, l1, l2
        else:  # the sizes fall without end along -q; 0 for equal sizes and g = 0: any edge
            l1 = -q1
            l2 = -q2
            l0 = q1 + q2

    least = math.inf
    least_1 = least_2 = 0.0
    if l2 <= 0.0:
        least, least_1 = minimum_on_edge(points, axes, k, (a, b), (h_a, h_b), g)
    if l1 <= 0.0:
        value, t = minimum_on_edge(points, axes, k, (a, c), (h_a, h_c), g)
        if value < least:
            least, least_1, least_2 = value, 0.0, t
    if l0 < 0.0 and with_bc:
        value, t = minimum_on_edge(points, axes, k, (b, c), (h_b, h_c), g)
        if value < least:
            least, least_1, least_2 = value, 1.0 - t, t
    return least, least_1, least_2
