"""Curvature tensors at the sectors of triangulated surfaces in space."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.normals import is_known
from adaptsize._kernels.sectors import cross, dot, normalise


@inner
def _face_tensor(x, n, normal, u, v, shape):
    """Fill the shape operator of one triangle from the normals at its corners.

    Least squares (Rusinkiewicz 2004): the symmetric [[a, b], [b, c]] that takes
    each edge to the difference of the normals at its ends, in the plane of the
    triangle.  With u along the longest edge the elimination is stable for slivers.

    Parameters
    ----------
    x, n : float64[3, 3]
        Corners and the normals there.
    normal : float64[3]
        Unit normal of the triangle.
    u, v : float64[3]
        Out: the frame.
    shape : float64[3]
        Out: a, b, c.
    """
    longest, best = 0, -1.0
    for k in range(3):
        for d in range(3):
            v[d] = x[(k + 2) % 3, d] - x[(k + 1) % 3, d]
        if dot(v, v) > best:
            longest, best = k, dot(v, v)
            for d in range(3):
                u[d] = v[d]
    normalise(u)
    cross(normal, u, v)
    xx, xy, yy, xp, yq, mixed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        ex, ey, p, q = 0.0, 0.0, 0.0, 0.0
        for d in range(3):
            e, dn = x[j, d] - x[i, d], n[j, d] - n[i, d]
            ex += e * u[d]
            ey += e * v[d]
            p += dn * u[d]
            q += dn * v[d]
        if k == longest:
            ey = 0.0  # by choice of u
        xx += ex * ex
        xy += ex * ey
        yy += ey * ey
        xp += ex * p
        yq += ey * q
        mixed += ey * p + ex * q
    shape[1] = (mixed - xy * (xp / xx + yq / yy)) / (xx + yy - xy * xy * (1.0 / xx + 1.0 / yy))
    shape[0] = (xp - shape[1] * xy) / xx
    shape[2] = (yq - shape[1] * xy) / yy


@inner
def _turn_into(a, b, w, out):
    """Fill ``out`` with w turned by the smallest rotation that takes unit a to unit b."""
    # w + (a x b) x w + (a x b) x ((a x b) x w) / (1 + a.b); opposite a, b never meet here
    # but for folded sheets, where any turn is as good: the denominator is kept off zero.
    axis = np.empty(3)
    once = np.empty(3)
    twice = np.empty(3)
    cross(a, b, axis)
    cross(axis, w, once)
    cross(axis, once, twice)
    below = max(1.0 + dot(a, b), 1e-8)
    for d in range(3):
        out[d] = w[d] + once[d] + twice[d] / below


@inner
def _add_turned(normal, u, v, shape, weight, target, sum_tensor):
    """Add the tensor a uu + b (uv + vu) + c vv, turned from one normal to another.

    Parameters
    ----------
    normal, target : float64[3]
        Unit normals from and to.
    u, v : float64[3]
        Frame of the tensor.
    shape : float64[3]
        a, b, c.
    weight : float
    sum_tensor : float64[6]
        In/Out: xx, yy, zz, yz, xz, xy.
    """
    tu = np.empty(3)
    tv = np.empty(3)
    _turn_into(normal, target, u, tu)
    _turn_into(normal, target, v, tv)
    a, b, c = weight * shape[0], weight * shape[1], weight * shape[2]
    for d in range(3):
        sum_tensor[d] += a * tu[d] * tu[d] + 2.0 * b * tu[d] * tv[d] + c * tv[d] * tv[d]
        i, j = (d + 1) % 3, (d + 2) % 3
        sum_tensor[3 + d] += (
            a * tu[i] * tu[j] + b * (tu[i] * tv[j] + tu[j] * tv[i]) + c * tv[i] * tv[j]
        )


@kernel
def fill_tensors(points, cells, areas, face_normals, sector, sign, normals, tensors):
    """Fill the curvature tensor of each sector: mean over its triangles, by area.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    areas : float64[m]
    face_normals : float64[m, 3]
    sector : int32[3 m]
    sign : float64[3 m]
    normals : float64[n_sectors, 3]
    tensors : float64[n_sectors, 6]
        In/Out: zeros on entry; xx, yy, zz, yz, xz, xy, positive where the surface bends
        away from the normal.
    """
    x = np.empty((3, 3))
    n = np.empty((3, 3))
    u, v, shape = np.empty(3), np.empty(3), np.empty(3)
    weights = np.zeros(tensors.shape[0])
    for c in range(cells.shape[0]):
        if areas[c] == 0.0:
            continue
        for k in range(3):
            corner = 3 * c + k
            for d in range(3):
                x[k, d] = points[cells[c, k], d]
                n[k, d] = sign[corner] * normals[sector[corner], d]
            if not is_known(normals, np.int64(sector[corner])):
                # The tip of a cone is as flat as the face.
                for d in range(3):
                    n[k, d] = face_normals[c, d]
        _face_tensor(x, n, face_normals[c], u, v, shape)
        for k in range(3):
            corner = 3 * c + k
            s = np.int64(sector[corner])
            if not is_known(normals, s):
                continue
            # The tensor changes sign with the normal, the sum is in the sector's orientation.
            _add_turned(face_normals[c], u, v, shape, sign[corner] * areas[c], n[k], tensors[s])
            weights[s] += areas[c]
    for s in range(tensors.shape[0]):
        for d in range(6):
            tensors[s, d] /= max(weights[s], 1e-300)  # all zero where there is no area


@inner
def _frame(normal, u, v):
    """Fill u, v so that (u, v, normal) is an orthonormal frame."""
    least = 0
    for d in range(1, 3):
        if abs(normal[d]) < abs(normal[least]):
            least = d
    for d in range(3):
        v[d] = 0.0
    v[least] = 1.0
    cross(normal, v, u)
    normalise(u)
    cross(normal, u, v)


@inner
def _restrict(tensor, u, v, shape):
    """Fill (a, b, c), the components of a symmetric tensor float64[6] in the frame u, v."""
    for d in range(3):
        shape[d] = 0.0
    for d in range(3):
        i, j = (d + 1) % 3, (d + 2) % 3
        shape[0] += tensor[d] * u[d] * u[d] + 2.0 * tensor[3 + d] * u[i] * u[j]
        shape[1] += tensor[d] * u[d] * v[d] + tensor[3 + d] * (u[i] * v[j] + u[j] * v[i])
        shape[2] += tensor[d] * v[d] * v[d] + 2.0 * tensor[3 + d] * v[i] * v[j]


@kernel
def smooth_tensors(areas, fan, fan_ptr, sector, sign, normals, tensors, smoothed):
    """Fill the mean, by area, of the tensors at all corners of the triangles of each sector.

    Parameters
    ----------
    areas : float64[m]
    fan : int32[3 m]
    fan_ptr : int32[n_sectors + 1]
    sector : int32[3 m]
    sign : float64[3 m]
    normals : float64[n_sectors, 3]
    tensors : float64[n_sectors, 6]
    smoothed : float64[n_sectors, 6]
        Out.
    """
    u, v, shape, source = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for s in range(tensors.shape[0]):
        for d in range(6):
            smoothed[s, d] = 0.0
        total = 0.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c = fan[k] // 3
            for w in range(3):
                corner = 3 * c + w
                t = np.int64(sector[corner])
                if not is_known(normals, t):
                    continue
                turn = sign[fan[k]] * sign[corner]
                for d in range(3):
                    source[d] = turn * normals[t, d]
                _frame(normals[t], u, v)
                _restrict(tensors[t], u, v, shape)
                _add_turned(source, u, v, shape, turn * areas[c], normals[s], smoothed[s])
                total += areas[c]
        for d in range(6):
            smoothed[s, d] /= max(total, 1e-300)


@kernel
def fill_largest_curvature(normals, tensors, kappa):
    """Fill the larger principal curvature, in modulus, of each sector.

    Parameters
    ----------
    normals : float64[n_sectors, 3]
    tensors : float64[n_sectors, 6]
    kappa : float64[n_sectors]
        Out: >= 0.
    """
    u, v, shape = np.empty(3), np.empty(3), np.empty(3)
    for s in range(tensors.shape[0]):
        _frame(normals[s], u, v)
        _restrict(tensors[s], u, v, shape)
        mean = 0.5 * (shape[0] + shape[2])
        kappa[s] = abs(mean) + math.hypot(0.5 * (shape[0] - shape[2]), shape[1])
