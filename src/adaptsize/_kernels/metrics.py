r"""Metrics of two or three dimensions as factors, and the intersection of two.

A metric M = R diag(h^-2) R^T with sizes h along the columns of R is used as its *factor*
K = R diag(1 / h), so that M = K K^T.  Nothing here computes M itself, whose condition number is
the square of that of K: singular values come from Jacobi rotations of columns [1]_, which
find small ones to relative accuracy.

The intersection of two metrics is the largest metric (in the volume of its ellipsoid) that is
nowhere above either: with S^T A S = I, S^T B S = V diag(s^2) V^T, it is

    S^-T V diag(max(1, s^2)) V^T S^-1.

References
----------
.. [1] J. Demmel, K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix Anal.
   Appl. 13 (1992) 1204-1245.
"""

import math

from adaptsize._kernels.compiling import lean


@lean
def rotate_columns(axes, a, b):
    """Rotate pairs of columns of a until all are orthogonal (In/Out).

    The same rotations are applied to b unless that is None.
    """
    dim = len(axes)
    # Sweeps of rotations; matrices of size 3 need at most 8.
    for _ in range(30):
        rotated = False
        for p in range(dim - 1):
            for q in range(p + 1, dim):
                pp, pq, qq = 0.0, 0.0, 0.0
                for i in range(dim):
                    pp += a[i, p] * a[i, p]
                    pq += a[i, p] * a[i, q]
                    qq += a[i, q] * a[i, q]
                # Columns whose cosine is below this count as orthogonal.
                if not abs(pq) > 4e-16 * math.sqrt(pp) * math.sqrt(qq):
                    continue
                rotated = True
                zeta = (qq - pp) / (2.0 * pq)
                t = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = c * t
                for i in range(dim):
                    x, y = a[i, p], a[i, q]
                    a[i, p], a[i, q] = c * x - s * y, s * x + c * y
                if b is not None:
                    for i in range(dim):
                        x, y = b[i, p], b[i, q]
                        b[i, p], b[i, q] = c * x - s * y, s * x + c * y
        if not rotated:
            return


@lean
def column_norm(axes, a, j):
    """Return the Euclidean norm of a column."""
    square = 0.0
    for i in range(len(axes)):
        square += a[i, j] * a[i, j]
    return math.sqrt(square)


@lean
def fill_factor(axes, h, r, k):
    """Fill the factor of a metric with sizes h[dim] and directions r[dim, dim] (Out: k)."""
    dim = len(axes)
    for i in range(dim):
        for j in range(dim):
            k[i, j] = r[i, j] / h[j]


@lean
def sizes_of_factor(axes, k, h, r):
    """Fill the sizes, ascending, and the directions of the metric K K^T (In/Out: k; Out: h, r)."""
    dim = len(axes)
    rotate_columns(axes, k, None)
    for j in range(dim):
        h[j] = 1.0 / column_norm(axes, k, j)
        for i in range(dim):
            r[i, j] = k[i, j] * h[j]
    for j in range(1, dim):  # insertion sort
        for p in range(j, 0, -1):
            if h[p - 1] <= h[p]:
                break
            h[p - 1], h[p] = h[p], h[p - 1]
            for i in range(dim):
                r[i, p - 1], r[i, p] = r[i, p], r[i, p - 1]


@lean
def multiply(axes, a, b, turns, out):
    """Fill the product of two matrices (Out); ``turns``: which of them is transposed."""
    turn_a, turn_b = turns
    for i in range(len(axes)):
        for j in range(len(axes)):
            total = 0.0
            for k in range(len(axes)):
                total += (a[k, i] if turn_a else a[i, k]) * (b[j, k] if turn_b else b[k, j])
            out[i, j] = total


@lean
def copy_metric(axes, source, more, target):
    """Set the sizes and directions of a metric to those of another one, sizes plus ``more``."""
    (h, r), (h_new, r_new) = source, target
    for j in range(len(axes)):
        h_new[j] = h[j] + more
        for i in range(len(axes)):
            r_new[i, j] = r[i, j]


@lean
def relative_factor(axes, a, b, g):
    """Fill G with G^T G = S^T B S for S = R_a diag(h_a) (Out: g)."""
    (h_a, r_a), (h_b, r_b), dim = a, b, len(axes)
    multiply(axes, r_b, r_a, (True, False), g)
    for i in range(dim):
        for j in range(dim):
            g[i, j] *= h_a[j] / h_b[i]


@lean
def intersect_into(axes, a, b, k, g):
    """Replace metric a by its intersection with metric b (In/Out: a).

    If one of the two lies nowhere above the other, the result is this one, bit for bit.

    Parameters
    ----------
    axes : tuple of length dim
    a, b : tuple of float64[dim], float64[dim, dim]
        Sizes and directions.
    k, g : float64[dim, dim]
        Scratch.
    """
    (h_a, r_a), dim = a, len(axes)
    relative_factor(axes, a, b, g)
    fill_factor(axes, h_a, r_a, k)
    rotate_columns(axes, g, k)
    least, largest = math.inf, 0.0
    for j in range(dim):
        s = column_norm(axes, g, j)
        least, largest = min(least, s), max(largest, s)
    if largest <= 1.0:
        return
    if least >= 1.0:
        copy_metric(axes, b, 0.0, a)
        return
    for j in range(dim):
        s = max(1.0, column_norm(axes, g, j))
        for i in range(dim):
            k[i, j] *= s
    sizes_of_factor(axes, k, h_a, r_a)


# The order of metrics: a metric P^-1 = (S S^T)^-1 is compared with another one, M, by the
# eigenvalues of S^T M S.  Where all are at most 1, M is nowhere above P^-1; where all are at least
# 1, it is nowhere below.


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
def is_definite(axes, n, sign, shift):
    """Return whether sign N + shift I is positive definite, for a symmetric N (upper triangle)."""
    a = sign * n[0, 0] + shift
    if len(axes) == 1:
        return a > 0.0
    b, d = sign * n[0, 1], sign * n[1, 1] + shift
    if len(axes) == 2:
        return a > 0.0 and a * d > b * b
    return is_definite_upper((a, b, sign * n[0, 2], d, sign * n[1, 2], sign * n[2, 2] + shift))


@lean
def is_definite_upper(upper):
    """Return whether the matrix with the upper triangle a, b, c; d, e; f is positive definite."""
    a, b, c, d, e, f = upper
    if not a > 0.0:
        return False
    over = 1.0 / a
    d, e, f = d - b * b * over, e - b * c * over, f - c * c * over
    return d > 0.0 and d * f > e * e


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


# Symmetric positive definite matrices, and systems of up to six equations


@lean
def factorise(n, a, c):
    """Fill the lower triangle of the Cholesky factor (Out: c); return whether a is definite.

    a: float64[n, n], lower triangle.
    """
    for j in range(n):
        for i in range(j, n):
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
    if not factorise(len(axes), a, c):
        return False
    invert_lower(axes, c, lower)
    multiply(axes, lower, lower, (True, False), inverse)
    return True


@lean
def sandwich(axes, k, a, transposed, half, out):
    """Fill K A K^T, or K^T A K if ``transposed`` (Out: out); half: scratch."""
    multiply(axes, k, a, (transposed, False), half)
    multiply(axes, half, k, (False, not transposed), out)


@lean
def solve(m, a):
    """Solve m equations with the right-hand side in column 6 (In/Out); lower triangle given."""
    if not factorise(m, a, a):
        return False
    for i in range(m):
        for k in range(i):
            a[i, 6] -= a[i, k] * a[k, 6]
        a[i, 6] /= a[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            a[i, 6] -= a[k, i] * a[k, 6]
        a[i, 6] /= a[i, i]
    return True
