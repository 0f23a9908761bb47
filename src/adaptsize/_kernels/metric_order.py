"""The order of metrics: by how much one is above or below another one.

A metric P^-1 = (S S^T)^-1 is compared with another one, M, by the eigenvalues of S^T M S.  Where
all are at most 1, M is nowhere above P^-1; where all are at least 1, it is nowhere below.
"""

import math

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.metrics import column_norm, rotate_columns


@lean
def _bound_of_eigenvalues(axes, n, limit):
    """Return at least the largest eigenvalue of a symmetric matrix; at most ``limit`` if that is.

    n: the upper triangle, In/Out.  In the plane the result is the eigenvalue itself.
    """
    dim = len(axes)
    if dim == 1:
        return n[0, 0]
    if dim == 2:
        half = 0.5 * (n[0, 0] - n[1, 1])
        return 0.5 * (n[0, 0] + n[1, 1]) + math.sqrt(half * half + n[0, 1] * n[0, 1])
    # The largest of three numbers is their mean plus one or two times p, or between.
    mean = (n[0, 0] + n[1, 1] + n[2, 2]) / 3.0
    square = (n[0, 0] - mean) ** 2 + (n[1, 1] - mean) ** 2 + (n[2, 2] - mean) ** 2
    square += 2.0 * (n[0, 1] * n[0, 1] + n[0, 2] * n[0, 2] + n[1, 2] * n[1, 2])
    p = math.sqrt(square / 6.0)
    if mean + 2.0 * p <= limit or mean + p > limit:
        return mean + 2.0 * p
    for i in range(dim):
        for j in range(i, dim):
            n[i, j] = -n[i, j]
        n[i, i] += limit
    return limit if _is_definite(axes, n) else mean + 2.0 * p


@lean
def _is_definite(axes, n):
    """Return whether a symmetric matrix is positive definite; n: the upper triangle, In/Out."""
    dim = len(axes)
    for j in range(dim):  # Gauss' elimination
        if not n[j, j] > 0.0:
            return False
        for i in range(j + 1, dim):
            share = n[j, i] / n[j, j]
            for k in range(i, dim):
                n[i, k] -= share * n[j, k]
    return True


@lean
def fill_relative(axes, h, r, more, s, n, row):
    """Fill S^T M S for a metric M whose sizes are increased by ``more`` (Out: n).

    row: float64[dim], scratch.
    """
    dim = len(axes)
    for i in range(dim):
        for j in range(dim):
            n[i, j] = 0.0
    for q in range(dim):
        over = 1.0 / (h[q] + more)
        for i in range(dim):
            along = 0.0
            for k in range(dim):
                along += r[k, q] * s[k, i]
            row[i] = along * over
        for i in range(dim):
            for j in range(i, dim):
                n[i, j] += row[i] * row[j]


@lean
def excess(axes, h, r, more, s, n, row, limit):
    """Return at least the largest eigenvalue of S^T M S; at most ``limit`` if that is.

    The sizes of M are those of h increased by ``more``.
    """
    fill_relative(axes, h, r, more, s, n, row)
    return _bound_of_eigenvalues(axes, n, limit)


@lean
def is_above(axes, n):
    """Return whether all eigenvalues of a symmetric matrix exceed 1; n: In/Out, upper triangle."""
    for i in range(len(axes)):
        n[i, i] -= 1.0
    return _is_definite(axes, n)


@lean
def extremes(axes, h, r, more, s, n):
    """Return the least and the largest eigenvalue of S^T M S, to rounding."""
    dim = len(axes)
    for q in range(dim):
        for i in range(dim):
            along = 0.0
            for k in range(dim):
                along += r[k, q] * s[k, i]
            n[q, i] = along / (h[q] + more)
    rotate_columns(axes, n, None)
    least, largest = math.inf, 0.0
    for i in range(dim):
        norm = column_norm(axes, n, i)
        least, largest = min(least, norm), max(largest, norm)
    return least * least, largest * largest
