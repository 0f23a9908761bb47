"""Principal curvatures of a level set function on a grid.

Grids have three axes here, of one node where there are fewer, and nodes are numbered row by
row, the last axis fastest.
"""

import math

from adaptsize._kernels.compiling import kernel
from adaptsize._kernels.curvature import frame, restrict


@kernel
def fill_level_set_curvature(fields, grid, nodes, choice, kappa):
    """Fill the principal curvatures of the level sets through nodes, by central differences.

    Parameters
    ----------
    fields : tuple of two float64[n]
        Values phi, flat, not finite where unknown; and the signed distance, which is phi or what
        phi was before it was smoothed.
    grid : tuple of float64[3], int64[3]
        Spacing and shape.
    nodes : int64[m]
        Flat indices.
    choice : tuple of float, bool
        Where ``abs(abs(grad distance) - 1)`` is larger than the first there is no value.  The
        second is whether to divide by ``1 - kappa distance``.
    kappa : float64[m, dim - 1]
        Out: positive where {phi <= level} is convex, the larger one first; NaN on the border
        of the grid, where phi is unknown in the stencil, by the tolerance, and at and beyond
        centres of curvature of the boundary.
    """
    (phi, distance), (spacing, shape), (tolerance, at_boundary) = fields, grid, choice
    dim = kappa.shape[1] + 1
    ny, nz = shape[1], shape[2]
    sx, sy, sz = ny * nz, nz, 1
    rx, ry, rz = 0.5 / spacing[0], 0.5 / spacing[1], 0.5 / spacing[2]
    for row in range(kappa.shape[0]):
        at = nodes[row]
        kappa[row, :] = math.nan
        i, j, k = at // sx, at // sy % ny, at % nz
        if i < 1 or i > shape[0] - 2 or j < 1 or j > ny - 2:
            continue
        if dim == 3 and (k < 1 or k > nz - 2):
            continue
        fx = rx * (distance[at + sx] - distance[at - sx])
        fy = ry * (distance[at + sy] - distance[at - sy])
        fz = rz * (distance[at + sz] - distance[at - sz]) if dim == 3 else 0.0
        # Written so that a gradient that is not finite fails.
        if not abs(math.sqrt(fx * fx + fy * fy + fz * fz) - 1.0) <= tolerance:
            continue
        f = 2.0 * phi[at]
        fx = rx * (phi[at + sx] - phi[at - sx])
        fy = ry * (phi[at + sy] - phi[at - sy])
        fz = rz * (phi[at + sz] - phi[at - sz]) if dim == 3 else 0.0
        norm = math.sqrt(fx * fx + fy * fy + fz * fz)
        if not norm > 0.0:
            continue
        per = 1.0 / norm
        fx, fy, fz = per * fx, per * fy, per * fz
        fxx = 4.0 * rx * rx * (phi[at + sx] - f + phi[at - sx])
        fyy = 4.0 * ry * ry * (phi[at + sy] - f + phi[at - sy])
        fxy = rx * ry * (
            phi[at + sx + sy] - phi[at + sx - sy] - phi[at - sx + sy] + phi[at - sx - sy]
        )  # fmt: skip
        if dim == 2:
            larger = per * (fxx * fy * fy - 2.0 * fx * fy * fxy + fyy * fx * fx)
            smaller = larger
        else:
            fzz = 4.0 * rz * rz * (phi[at + sz] - f + phi[at - sz])
            fxz = rx * rz * (
                phi[at + sx + sz] - phi[at + sx - sz] - phi[at - sx + sz] + phi[at - sx - sz]
            )  # fmt: skip
            fyz = ry * rz * (
                phi[at + sy + sz] - phi[at + sy - sz] - phi[at - sy + sz] + phi[at - sy - sz]
            )  # fmt: skip
            u, v = frame((fx, fy, fz))
            a, b, c = restrict((fxx, fyy, fzz, fyz, fxz, fxy), u, v)
            # H and sqrt(H^2 - G), without the rounding of two nearly equal numbers.
            mean, half = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
            larger, smaller = per * (mean + half), per * (mean - half)
        if at_boundary:
            beyond, before = 1.0 - larger * distance[at], 1.0 - smaller * distance[at]
            if not (beyond > 0.0 and before > 0.0):
                continue
            larger, smaller = larger / beyond, smaller / before
        if math.isfinite(larger) and math.isfinite(smaller):
            kappa[row, 0] = larger
            kappa[row, dim - 2] = smaller
