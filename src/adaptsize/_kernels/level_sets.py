"""Nodal values of a level set function on a grid: principal curvatures, and reinitialization.

Grids have three axes here, of one node where there are fewer, and nodes are numbered row by
row, the last axis fastest.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.vectors import cross, dot, unit


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
            mean, half = _mean_and_half_difference((fx, fy, fz), (fxx, fyy, fzz, fxy, fxz, fyz))
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
def _mean_and_half_difference(normal, tensor):
    """Return half the sum and half the difference, >= 0, of a tensor's two tangential values.

    In a frame u, v of the tangent plane with a = u.A.u, b = u.A.v, c = v.A.v they are
    (a + c) / 2 and hypot((a - c) / 2, b).  With A the second derivatives over the length of the
    gradient these are the mean curvature H and sqrt(H^2 - G), G the Gaussian curvature, the
    latter without the rounding of two nearly equal numbers.  ``normal``: of unit length;
    ``tensor``: the components xx, yy, zz, xy, xz, yz of A.
    """
    (nx, ny, nz), (xx, yy, zz, xy, xz, yz) = normal, tensor
    # u is normal to n and to the axis that n is farthest from.
    u = (ny, -nx, 0.0)
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        u = (0.0, nz, -ny)
    elif abs(ny) <= abs(nz):
        u = (-nz, 0.0, nx)
    u = unit(u)
    vx, vy, vz = v = cross(normal, u)
    bend = (dot((xx, xy, xz), u), dot((xy, yy, yz), u), dot((xz, yz, zz), u))
    a, b = dot(u, bend), dot(v, bend)
    c = xx * vx * vx + yy * vy * vy + zz * vz * vz
    c += 2.0 * (xy * vx * vy + xz * vx * vz + yz * vy * vz)
    return 0.5 * (a + c), math.sqrt(0.25 * (a - c) ** 2 + b * b)


@inner
def _minmod(a, b):
    """Return the smaller in modulus of two numbers of one sign, else 0."""
    if a * b <= 0.0:
        return 0.0
    return a if abs(a) < abs(b) else b


@inner
def _second_difference(phi, node, at, n, stride):
    """Return phi_{i-1} - 2 phi_i + phi_{i+1} along an axis; 0 at its ends."""
    if at < 1 or at > n - 2:
        return 0.0
    return phi[node - stride] - 2.0 * phi[node] + phi[node + stride]


@kernel
def measure_cuts(values, nodes, shape, cuts):
    """Measure how far along each axis the zero level of a function is.

    Where the sign changes between nodes i and j, the place is the root of the quadratic whose
    second derivative is the smaller one of those at i and j.

    Parameters
    ----------
    values : float64[n_nodes]
    nodes : int64[m]
    shape : int64[3]
    cuts : float64[m, 6]
        Out: in spacings, backward and forward along each axis; 1 where no zero is nearer than
        the next node, 2 where there is no next node.
    """
    strides = (shape[1] * shape[2], shape[2], 1)
    for place in range(nodes.shape[0]):
        node = nodes[place]
        at = (node // strides[0], node // strides[1] % shape[1], node % shape[2])
        f = values[node]
        for a in range(3):
            for side in range(2):
                ahead = at[a] + (1 if side == 1 else -1)
                if ahead < 0 or ahead >= shape[a]:
                    cuts[place, 2 * a + side] = 2.0
                    continue
                other = node + (strides[a] if side == 1 else -strides[a])
                g = values[other]
                cuts[place, 2 * a + side] = 1.0
                if (f > 0.0) == (g > 0.0):
                    continue
                here = _second_difference(values, node, at[a], shape[a], strides[a])
                there = _second_difference(values, other, ahead, shape[a], strides[a])
                bend = _minmod(here, there)
                # f + slope t + bend t^2 / 2 is g at t = 1; the stable form of its root.
                slope = g - f - 0.5 * bend
                root = math.sqrt(max(slope * slope - 2.0 * f * bend, 0.0))
                below = slope + math.copysign(root, slope)
                t = -2.0 * f / below if below != 0.0 else 0.5
                cuts[place, 2 * a + side] = min(max(t, 0.0), 1.0)


class Band(NamedTuple):
    """The nodes that are updated.

    Parameters
    ----------
    positive : bool[n_nodes]
        Signs of all nodes.
    nodes : int64[m]
    cuts : float64[m, 6]
        From `measure_cuts`; differences towards the zero level end there.
    steps : float64[m]
        Time steps.
    """

    positive: np.ndarray
    nodes: np.ndarray
    cuts: np.ndarray
    steps: np.ndarray


@kernel
def relax(phi, band, grid, change):
    """Fill  -dt s (|grad phi| - 1)  with s the sign and one-sided differences of second order.

    Parameters
    ----------
    phi : float64[n_nodes]
    band : Band
    grid : tuple of float64[3], int64[3]
        Spacing and shape.
    change : float64[m]
        Out.
    """
    (positive, nodes, cuts, steps), (spacing, shape) = band, grid
    strides = (shape[1] * shape[2], shape[2], 1)
    for place in range(nodes.shape[0]):
        node = nodes[place]
        at = (node // strides[0], node // strides[1] % shape[1], node % shape[2])
        own = phi[node]
        sign = 1.0 if positive[node] else -1.0
        squares = 0.0
        for a in range(3):
            if shape[a] == 1:
                continue
            h = spacing[a]
            here = _second_difference(phi, node, at[a], shape[a], strides[a])
            steepest = 0.0
            for side in range(2):
                cut = cuts[place, 2 * a + side]
                if cut > 1.0:
                    continue
                stride = strides[a] if side == 1 else -strides[a]
                ahead = at[a] + (1 if side == 1 else -1)
                beyond = _second_difference(phi, node + stride, ahead, shape[a], strides[a])
                end = phi[node + stride] if cut == 1.0 else 0.0
                # Descent towards that side, of |phi|: phi grows away from the zero level.
                slope = (own - end) / (cut * h) + 0.5 * cut * _minmod(here, beyond) / h
                steepest = max(steepest, sign * slope)
            squares += steepest * steepest
        change[place] = -steps[place] * sign * (math.sqrt(squares) - 1.0)
