"""Principal curvatures of the level sets of nodal values on a Cartesian grid."""

import math

from adaptsize._kernels.compiling import inner, kernel


@kernel
def fill_level_set_curvature(phi, distance, shape, spacing, nodes, tolerance, at_boundary, kappa):
    """Fill the principal curvatures of the level sets through nodes, by central differences.

    Parameters
    ----------
    phi : float64[n]
        Values, flat, the last axis fastest; not finite where unknown.
    distance : float64[n]
        Signed distance; ``phi`` or what ``phi`` was before it was smoothed.
    shape, spacing : int64[3], float64[3]
        Of the grid; in the plane ``shape[2]`` is 1.
    nodes : int64[m]
        Flat indices.
    tolerance : float64
        Where ``abs(abs(grad distance) - 1)`` is larger there is no value.
    at_boundary : bool
        Whether to divide by ``1 - kappa distance``.
    kappa : float64[m, dim - 1]
        Out: positive where {phi <= level} is convex, the larger one first; NaN on the border
        of the grid, where phi is unknown in the stencil, by ``tolerance``, and at and beyond
        centres of curvature of the boundary.
    """
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
            mean, half = mean_and_half_difference(fx, fy, fz, fxx, fyy, fzz, fxy, fxz, fyz)
            larger, smaller = per * (mean + half), per * (mean - half)
        if at_boundary:
            beyond, before = 1.0 - larger * distance[at], 1.0 - smaller * distance[at]
            if not (beyond > 0.0 and before > 0.0):
                continue
            larger, smaller = larger / beyond, smaller / before
        if math.isfinite(larger) and math.isfinite(smaller):
            kappa[row, 0] = larger
            kappa[row, dim - 2] = smaller


@inner
def mean_and_half_difference(nx, ny, nz, xx, yy, zz, xy, xz, yz):
    """Return half the sum and half the difference, >= 0, of a tensor's two tangential values.

    In a frame u, v of the tangent plane with a = u.A.u, b = u.A.v, c = v.A.v they are
    (a + c) / 2 and hypot((a - c) / 2, b).  With A the second derivatives over the length of the
    gradient these are the mean curvature H and sqrt(H^2 - G), G the Gaussian curvature, the
    latter without the rounding of two nearly equal numbers.

    Parameters
    ----------
    nx, ny, nz : float64
        Unit normal.
    xx, yy, zz, xy, xz, yz : float64
        The symmetric tensor A.

    Returns
    -------
    float64, float64
    """
    # u is normal to n and to the axis that n is farthest from.
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        ux, uy, uz = 0.0, nz, -ny
    elif abs(ny) <= abs(nz):
        ux, uy, uz = -nz, 0.0, nx
    else:
        ux, uy, uz = ny, -nx, 0.0
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    ax = xx * ux + xy * uy + xz * uz
    ay = xy * ux + yy * uy + yz * uz
    az = xz * ux + yz * uy + zz * uz
    a = ux * ax + uy * ay + uz * az
    b = vx * ax + vy * ay + vz * az
    c = xx * vx * vx + yy * vy * vy + zz * vz * vz
    c += 2.0 * (xy * vx * vy + xz * vx * vz + yz * vy * vz)
    return 0.5 * (a + c), math.sqrt(0.25 * (a - c) ** 2 + b * b)
