"""Symmetric positive definite matrices of two or three rows, and systems of up to six equations."""

import math

from adaptsize._kernels.compiling import lean


@lean
def factorise(axes, a, c):
    """Fill the lower triangle of the Cholesky factor (Out: c); return whether a is definite."""
    dim = len(axes)
    for j in range(dim):
        for i in range(j, dim):
            total = a[i, j]
            for k in range(j):
                total -= c[i, k] * c[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                c[j, j] = math.sqrt(total)
            else:
                c[i, j] = total / c[j, j]
    return True


@lean
def invert_lower(axes, c, inverse):
    """Fill the inverse of a lower triangle, zeros above (Out: inverse)."""
    dim = len(axes)
    for j in range(dim):
        for i in range(dim):
            inverse[i, j] = 0.0
        inverse[j, j] = 1.0 / c[j, j]
        for i in range(j + 1, dim):
            total = 0.0
            for k in range(j, i):
                total -= c[i, k] * inverse[k, j]
            inverse[i, j] = total / c[i, i]


@lean
def invert(axes, a, c, lower, inverse):
    """Fill the inverse of a positive definite matrix (Out); c, lower: scratch."""
    dim = len(axes)
    if not factorise(axes, a, c):
        return False
    invert_lower(axes, c, lower)
    for i in range(dim):
        for j in range(dim):
            total = 0.0
            for k in range(dim):
                total += lower[k, i] * lower[k, j]
            inverse[i, j] = total
    return True


@lean
def sandwich(axes, k, a, transposed, half, out):
    """Fill K A K^T, or K^T A K if ``transposed`` (Out: out); half: scratch."""
    dim = len(axes)
    for i in range(dim):
        for j in range(dim):
            total = 0.0
            for m in range(dim):
                total += (k[m, i] if transposed else k[i, m]) * a[m, j]
            half[i, j] = total
    for i in range(dim):
        for j in range(dim):
            total = 0.0
            for m in range(dim):
                total += half[i, m] * (k[m, j] if transposed else k[j, m])
            out[i, j] = total


@lean
def solve(m, a):
    """Solve m equations with the right-hand side in column 6 (In/Out); lower triangle given."""
    for j in range(m):
        for i in range(j, m):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                a[j, j] = math.sqrt(total)
            else:
                a[i, j] = total / a[j, j]
    for i in range(m):
        for k in range(i):
            a[i, 6] -= a[i, k] * a[k, 6]
        a[i, 6] /= a[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            a[i, 6] -= a[k, i] * a[k, 6]
        a[i, 6] /= a[i, i]
    return True
