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

# Columns whose cosine is below this count as orthogonal.
_ORTHOGONAL = 4e-16

# Sweeps of rotations; matrices of size 3 need at most 8.
_SWEEPS = 30


@lean
def rotate_columns(axes, a, b):
    """Rotate pairs of columns of a until all are orthogonal (In/Out).

    The same rotations are applied to b unless that is None.
    """
    dim = len(axes)
    for _ in range(_SWEEPS):
        rotated = False
        for p in range(dim - 1):
            for q in range(p + 1, dim):
                pp, pq, qq = 0.0, 0.0, 0.0
                for i in range(dim):
                    pp += a[i, p] * a[i, p]
                    pq += a[i, p] * a[i, q]
                    qq += a[i, q] * a[i, q]
                if not abs(pq) > _ORTHOGONAL * math.sqrt(pp) * math.sqrt(qq):
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
def relative_factor(axes, h_a, r_a, h_b, r_b, g):
    """Fill G with G^T G = S^T B S for S = R_a diag(h_a) (Out: g)."""
    dim = len(axes)
    for i in range(dim):
        for j in range(dim):
            total = 0.0
            for k in range(dim):
                total += r_b[k, i] * r_a[k, j]
            g[i, j] = total * (h_a[j] / h_b[i])


@lean
def intersect_into(axes, h_a, r_a, h_b, r_b, k, g):
    """Replace metric a by its intersection with metric b (In/Out: h_a, r_a).

    If one of the two lies nowhere above the other, the result is this one, bit for bit.

    Parameters
    ----------
    axes : tuple of length dim
    h_a, h_b : float64[dim]
    r_a, r_b : float64[dim, dim]
    k, g : float64[dim, dim]
        Scratch.
    """
    dim = len(axes)
    relative_factor(axes, h_a, r_a, h_b, r_b, g)
    fill_factor(axes, h_a, r_a, k)
    rotate_columns(axes, g, k)
    least, largest = math.inf, 0.0
    for j in range(dim):
        s = column_norm(axes, g, j)
        least, largest = min(least, s), max(largest, s)
    if largest <= 1.0:
        return
    if least >= 1.0:
        for j in range(dim):
            h_a[j] = h_b[j]
            for i in range(dim):
                r_a[i, j] = r_b[i, j]
        return
    for j in range(dim):
        s = max(1.0, column_norm(axes, g, j))
        for i in range(dim):
            k[i, j] *= s
    sizes_of_factor(axes, k, h_a, r_a)
