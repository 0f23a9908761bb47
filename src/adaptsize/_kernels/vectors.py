"""Vectors in space as tuples of three floats, which the compiler keeps in registers.

Arrays of three numbers are taken, too.  A row of a matrix is read by its index, since a view of it
would be counted as a reference.
"""

import math

from adaptsize._kernels.compiling import lean


@lean
def triple(rows, i, k):
    """Return three consecutive numbers of row i, from column k on."""
    return rows[i, k], rows[i, k + 1], rows[i, k + 2]


@lean
def column(rows, i):
    """Return the first three numbers of column i."""
    return rows[0, i], rows[1, i], rows[2, i]


@lean
def between(points, i, j):
    """Return x_j - x_i."""
    return (
        points[j, 0] - points[i, 0],
        points[j, 1] - points[i, 1],
        points[j, 2] - points[i, 2],
    )


@lean
def offset(points, i, x):
    """Return x - x_i."""
    return x[0] - points[i, 0], x[1] - points[i, 1], x[2] - points[i, 2]


@lean
def minus(u, v):
    """Return u - v."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@lean
def without(r, t, e):
    """Return r - t e."""
    return r[0] - t * e[0], r[1] - t * e[1], r[2] - t * e[2]


@lean
def dot(u, v):
    """Return u . v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@lean
def cross(u, v):
    """Return u x v."""
    return (
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    )


@lean
def norm(u):
    """Return the length of a vector."""
    return math.sqrt(dot(u, u))


@lean
def unit(u):
    """Return u / |u|, or zero."""
    length = norm(u)
    if length > 0.0:
        return u[0] / length, u[1] / length, u[2] / length
    return u[0], u[1], u[2]


@lean
def mean(points, nodes, weights):
    """Return the weighted sum of three points."""
    (i, j, k), (s, t, u) = nodes, weights
    return (
        s * points[i, 0] + t * points[j, 0] + u * points[k, 0],
        s * points[i, 1] + t * points[j, 1] + u * points[k, 1],
        s * points[i, 2] + t * points[j, 2] + u * points[k, 2],
    )


@lean
def frame(normal):
    """Return u, v so that (u, v, normal) is an orthonormal frame."""
    least = 0
    for d in range(1, 3):
        if abs(normal[d]) < abs(normal[least]):
            least = d
    axis = (1.0 if least == 0 else 0.0, 1.0 if least == 1 else 0.0, 1.0 if least == 2 else 0.0)
    u = unit(cross(normal, axis))
    return u, cross(normal, u)


@lean
def restrict(tensor, u, v):
    """Return (a, b, c), the components of a symmetric tensor in the frame u, v.

    ``tensor``: six numbers xx, yy, zz, yz, xz, xy.
    """
    a, b, c = 0.0, 0.0, 0.0
    for d in range(3):
        i, j = (d + 1) % 3, (d + 2) % 3
        a += tensor[d] * u[d] * u[d] + 2.0 * tensor[3 + d] * u[i] * u[j]
        b += tensor[d] * u[d] * v[d] + tensor[3 + d] * (u[i] * v[j] + u[j] * v[i])
        c += tensor[d] * v[d] * v[d] + 2.0 * tensor[3 + d] * v[i] * v[j]
    return a, b, c
