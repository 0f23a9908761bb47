"""Sizes allowed by edges and triangles with linear bounds, at the points of a block.

The closed forms are those of local_updates.py, and entries those of exact.py.
"""

import math

from adaptsize._kernels.compiling import lean

#: Cells and faces flatter than this (determinant of the Gram matrix over the product of squared
#: lengths) are treated as steep, since their gradients are dominated by rounding.
FLAT = 1e-14


@lean
def fill_edge(table, k, axes, x, count, g, values, share):
    """Fill the sizes that edge k allows at points, inf where the minimum is at an end.

    An end is a separate entry, or dominated.  ``share`` gets the weights of the second end.
    """
    dim = len(axes)
    base = table[k, dim * dim]
    rise = table[k, dim * dim + 1] - base
    length2 = 0.0
    for d in range(dim):
        length2 += (table[k, dim + d] - table[k, d]) ** 2
    slack2 = g * g * length2 - rise * rise
    scale2 = length2 * slack2
    for i in range(count):
        dot = height2 = 0.0
        for d in range(dim):
            dot += (table[k, dim + d] - table[k, d]) * (x[d, i] - table[k, d])
        foot = dot / length2
        for d in range(dim):
            e = table[k, dim + d] - table[k, d]
            height2 += (x[d, i] - table[k, d] - foot * e) ** 2
        ratio = math.sqrt(height2 / scale2) if scale2 > 0.0 else math.inf
        t = foot - rise * ratio
        share[i] = t
        values[i] = base + foot * rise + ratio * slack2 if 0.0 < t < 1.0 else math.inf


@lean
def fill_face(table, k, x, count, g, values):
    """Fill the sizes that triangle k allows at points, inf where the minimum is not inside."""
    ax, ay, az = table[k, 0], table[k, 1], table[k, 2]
    ux, uy, uz = table[k, 3] - ax, table[k, 4] - ay, table[k, 5] - az
    vx, vy, vz = table[k, 6] - ax, table[k, 7] - ay, table[k, 8] - az
    base = table[k, 9]
    r1, r2 = table[k, 10] - base, table[k, 11] - base
    a11 = ux * ux + uy * uy + uz * uz
    a12 = ux * vx + uy * vy + uz * vz
    a22 = vx * vx + vy * vy + vz * vz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    det = nx * nx + ny * ny + nz * nz
    q1 = q2 = scale = 0.0
    slack2 = -1.0
    if det > FLAT * a11 * a22:
        q1, q2 = (a22 * r1 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det
        slack2 = g * g - (q1 * r1 + q2 * r2)
    if slack2 > 0.0:
        scale = 1.0 / math.sqrt(det * slack2)
    for i in range(count):
        wx, wy, wz = x[0, i] - ax, x[1, i] - ay, x[2, i] - az
        w1, w2 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
        p1, p2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
        ratio = abs(nx * wx + ny * wy + nz * wz) * scale
        l1, l2 = p1 - ratio * q1, p2 - ratio * q2
        inside = scale > 0.0 and min(l1, l2) >= 0.0 and l1 + l2 <= 1.0
        values[i] = base + p1 * r1 + p2 * r2 + ratio * slack2 if inside else math.inf
