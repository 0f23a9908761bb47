"""The order of metrics: by how much one is above or below another one.

A metric P^-1 = (S S^T)^-1 is compared with another one, M, by the eigenvalues of S^T M S.  Where
all are at most 1, M is nowhere above P^-1; where all are at least 1, it is nowhere below.
"""

import math

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.metrics import column_norm, rotate_columns

# Bound of the share by which the formula for the eigenvalues of matrices of size 3 is wrong where
# two of them are equal.
_LOOSE = 1.0 + 1e-7


@lean
def _top_eigenvalue(axes, n):
    """Return a bound of the largest eigenvalue of a symmetric matrix, exact to 1e-7."""
    dim = len(axes)
    if dim == 1:
        return n[0, 0]
    if dim == 2:
        half = 0.5 * (n[0, 0] - n[1, 1])
        return 0.5 * (n[0, 0] + n[1, 1]) + math.sqrt(half * half + n[0, 1] * n[0, 1])
    # The trigonometric solution of the cubic equation.
    mean = (n[0, 0] + n[1, 1] + n[2, 2]) / 3.0
    off = n[0, 1] * n[0, 1] + n[0, 2] * n[0, 2] + n[1, 2] * n[1, 2]
    a, b, c = n[0, 0] - mean, n[1, 1] - mean, n[2, 2] - mean
    p = math.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if not p > 0.0:
        return _LOOSE * mean
    a, b, c = a / p, b / p, c / p
    d, e, f = n[0, 1] / p, n[0, 2] / p, n[1, 2] / p
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    angle = math.acos(min(max(half, -1.0), 1.0)) / 3.0
    return _LOOSE * (mean + 2.0 * p * math.cos(angle))


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
def excess(axes, h, r, more, s, n, row):
    """Return the excess of a metric whose sizes are increased by ``more``, or slightly more."""
    fill_relative(axes, h, r, more, s, n, row)
    return _top_eigenvalue(axes, n)


@lean
def is_above(axes, n):
    """Return whether all eigenvalues of a symmetric matrix exceed 1; n: In/Out, upper triangle."""
    dim = len(axes)
    for i in range(dim):
        n[i, i] -= 1.0
    for j in range(dim):  # Gauss' elimination
        if not n[j, j] > 0.0:
            return False
        for i in range(j + 1, dim):
            share = n[j, i] / n[j, j]
            for k in range(i, dim):
                n[i, k] -= share * n[j, k]
    return True


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
