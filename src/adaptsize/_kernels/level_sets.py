"""Principal curvatures of a level set function on a grid.

Grids have three axes here, of one node where there are fewer, and nodes are numbered row by
row, the last axis fastest.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.vectors import frame, norm, restrict


@inner
def _gradient(f, at, steps, per, dim):
    """Return the gradient at a node by central differences; ``per``: 1 over twice the spacing."""
    return (
        per[0] * (f[at + steps[0]] - f[at - steps[0]]),
        per[1] * (f[at + steps[1]] - f[at - steps[1]]),
        per[2] * (f[at + steps[2]] - f[at - steps[2]]) if dim == 3 else 0.0,
    )


@inner
def _second(f, at, step, per):
    """Return the second difference along an axis."""
    return 4.0 * per * per * (f[at + step] - 2.0 * f[at] + f[at - step])


@inner
def _mixed(f, at, one, other, per):
    """Return the mixed second difference along two axes; ``per``: the product of both."""
    return per * (
        f[at + one + other] - f[at + one - other] - f[at - one + other] + f[at - one - other]
    )


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
    steps = (sx, sy, sz) = (ny * nz, nz, np.int64(1))
    per = (rx, ry, rz) = (0.5 / spacing[0], 0.5 / spacing[1], 0.5 / spacing[2])
    for row in range(kappa.shape[0]):
        at = nodes[row]
        kappa[row, :] = math.nan
        i, j, k = at // sx, at // sy % ny, at % nz
        if i < 1 or i > shape[0] - 2 or j < 1 or j > ny - 2:
            continue
        if dim == 3 and (k < 1 or k > nz - 2):
            continue
        # Written so that a gradient that is not finite fails.
        if not abs(norm(_gradient(distance, at, steps, per, dim)) - 1.0) <= tolerance:
            continue
        fx, fy, fz = _gradient(phi, at, steps, per, dim)
        steepness = norm((fx, fy, fz))
        if not steepness > 0.0:
            continue
        flat = 1.0 / steepness
        fx, fy, fz = flat * fx, flat * fy, flat * fz
        fxx, fyy = _second(phi, at, sx, rx), _second(phi, at, sy, ry)
        fxy = _mixed(phi, at, sx, sy, rx * ry)
        if dim == 2:
            larger = flat * (fxx * fy * fy - 2.0 * fx * fy * fxy + fyy * fx * fx)
            smaller = larger
        else:
            fzz = _second(phi, at, sz, rz)
            fxz, fyz = _mixed(phi, at, sx, sz, rx * rz), _mixed(phi, at, sy, sz, ry * rz)
            u, v = frame((fx, fy, fz))
            a, b, c = restrict((fxx, fyy, fzz, fyz, fxz, fxy), u, v)
            # H and sqrt(H^2 - G), without the rounding of two nearly equal numbers.
            mean, half = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
            larger, smaller = flat * (mean + half), flat * (mean - half)
        if at_boundary:
            beyond, before = 1.0 - larger * distance[at], 1.0 - smaller * distance[at]
            if not (beyond > 0.0 and before > 0.0):
                continue
            larger, smaller = larger / beyond, smaller / before
        if math.isfinite(larger) and math.isfinite(smaller):
            kappa[row, 0] = larger
            kappa[row, dim - 2] = smaller
