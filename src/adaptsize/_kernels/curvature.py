"""Normals and curvature tensors at the sectors of triangulated surfaces in space."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.sectors import normalise
from adaptsize._kernels.vectors import (
    between,
    cross,
    dot,
    frame,
    minus,
    restrict,
    triple,
    unit,
    without,
)


@kernel
def fill_sector_normals(surface, sectors, normals):
    """Fill the normal of each sector with the weights of Max (1999).

    The weights, sin(angle) / (|a| |b|) for the two edges of a corner, make the
    normal exact at closed fans on a sphere and at fans on a cylinder cut into strips.

    Parameters
    ----------
    surface : Surface
    sectors : Sectors
    normals : float64[n_sectors, 3]
        Out: unit vectors; zero where all triangles of the sector are degenerate.
    """
    points, cells, areas, face_normals = (
        surface.points, surface.cells, surface.areas, surface.normals,
    )  # fmt: skip
    sign, fan, fan_ptr = sectors.sign, sectors.fan, sectors.fan_ptr
    for s in range(normals.shape[0]):
        normals[s, :] = 0.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c, v = fan[k] // 3, fan[k] % 3
            if areas[c] == 0.0:
                continue
            squares = 1.0
            for turn in range(1, 3):
                edge = between(points, cells[c, v], cells[c, (v + turn) % 3])
                squares *= dot(edge, edge)
            for d in range(3):
                normals[s, d] += sign[fan[k]] * areas[c] * face_normals[c, d] / squares
        normalise(normals[s])


@inner
def is_known(normals, s):
    """Return whether sector s has a normal."""
    return normals[s, 0] != 0.0 or normals[s, 1] != 0.0 or normals[s, 2] != 0.0


@inner
def _chord_sums(surface, sectors, s, normals, frame):
    """Return the normal equations of the chord condition over the edges of the fan of a sector.

    The chord between two points of a sphere or a cylinder is at right angles to the
    sum of the normals there, on other surfaces up to the cube of its length.  The
    normal n + s u + t v is to meet this in the sense of least squares, with weights
    1 / length^4 so that the misfits are curvatures.

    The result are the sums uu, uv, vv, and the right-hand sides of u and v.
    """
    (u, v), points, cells, sector = frame, surface.points, surface.cells, sectors.sector
    uu, uv, vv, right_u, right_v = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(sectors.fan_ptr[s], sectors.fan_ptr[s + 1]):
        corner = sectors.fan[k]
        c, w = corner // 3, corner % 3
        for turn in range(1, 3):
            there = 3 * c + (w + turn) % 3
            agree = sectors.sign[corner] * sectors.sign[there]
            gap = between(points, cells[c, w], cells[c, (w + turn) % 3])
            squared, along_u, along_v = dot(gap, gap), dot(gap, u), dot(gap, v)
            other = triple(normals, sector[there], 0)
            off = dot(gap, without(triple(normals, s, 0), -agree, other))
            if squared == 0.0 or not is_known(normals, np.int64(sector[there])):
                continue
            weight = 1.0 / (squared * squared)
            uu += weight * along_u * along_u
            uv += weight * along_u * along_v
            vv += weight * along_v * along_v
            right_u -= weight * along_u * off
            right_v -= weight * along_v * off
    return uu, uv, vv, right_u, right_v


@kernel
def correct_open_normals(surface, sectors, angles, choice, normals, corrected):
    """Correct the normals of open fans, which lean towards the side where the faces are.

    A fan at a feature edge contains the surface on one side only.  Its mean normal is that of a
    point half an edge away, so that the curvature across the feature edge would have half its
    value.  The chord condition with the neighbours corrects the normal.
    Fans of less than 150 degrees are one-sided in both directions, others across
    the feature edge only.

    Parameters
    ----------
    surface : Surface
    sectors : Sectors
    angles : float64[n_sectors]
        Of the fans, in radians.
    choice : tuple of bool, float
        Whether to correct the fans of less than 150 degrees, or else the others; and the largest
        tangent of the tilt.
    normals : float64[n_sectors, 3]
    corrected : float64[n_sectors, 3]
        In/Out: the same normals; those of the chosen fans are corrected.
    """
    (corners, limit), ends = choice, sectors.ends
    for s in range(normals.shape[0]):
        is_corner = angles[s] < 150.0 / 180.0 * math.pi
        if ends[s, 0] < 0 or ends[s, 0] == ends[s, 1] or is_corner != corners:
            continue
        if not is_known(normals, s):
            continue
        corner = sectors.fan[sectors.fan_ptr[s]]
        i = surface.cells[corner // 3, corner % 3]
        # Tangents across the line between the ends of the fan, v, and along it.
        a, b = between(surface.points, i, ends[s, 0]), between(surface.points, i, ends[s, 1])
        v = unit(cross(normals[s], minus(unit(a), unit(b))))
        u = cross(v, normals[s])
        uu, uv, vv, right_u, right_v = _chord_sums(surface, sectors, s, normals, (u, v))
        # Negligible for regular fans; avoids a division by zero for a fan of needles.
        damp = 1e-6 * (uu + vv)
        if damp == 0.0:
            continue
        uu, vv = uu + damp, vv + damp
        tilt_u, tilt_v = 0.0, right_v / vv
        if is_corner:
            det = uu * vv - uv * uv
            tilt_u = (vv * right_u - uv * right_v) / det
            tilt_v = (uu * right_v - uv * right_u) / det
        shrink = min(1.0, limit / max(math.hypot(tilt_u, tilt_v), 1e-300))
        for d in range(3):
            corrected[s, d] += shrink * (tilt_u * u[d] + tilt_v * v[d])
        normalise(corrected[s])


@inner
def _face_tensor(x, n, normal):
    """Return the shape operator of one triangle from the normals at its corners.

    Least squares (Rusinkiewicz 2004): the symmetric [[a, b], [b, c]] that takes
    each edge to the difference of the normals at its ends, in the plane of the
    triangle.  With u along the longest edge the elimination is stable for slivers.

    Parameters
    ----------
    x, n : tuple of 3 vectors
        Corners and the normals there.
    normal : float64[3]
        Unit normal of the triangle.

    Returns
    -------
    tuple of 3 vectors
        The frame u, v, and a, b, c.
    """
    longest, best = 0, -1.0
    u = (0.0, 0.0, 0.0)
    for k in range(3):
        edge = minus(x[(k + 2) % 3], x[(k + 1) % 3])
        if dot(edge, edge) > best:
            longest, best, u = k, dot(edge, edge), edge
    u = unit(u)
    v = cross(normal, u)
    xx, xy, yy, xp, yq, mixed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        edge, turn = minus(x[j], x[i]), minus(n[j], n[i])
        ex, p, q = dot(edge, u), dot(turn, u), dot(turn, v)
        ey = 0.0 if k == longest else dot(edge, v)  # by choice of u
        xx += ex * ex
        xy += ex * ey
        yy += ey * ey
        xp += ex * p
        yq += ey * q
        mixed += ey * p + ex * q
    b = (mixed - xy * (xp / xx + yq / yy)) / (xx + yy - xy * xy * (1.0 / xx + 1.0 / yy))
    return u, v, ((xp - b * xy) / xx, b, (yq - b * xy) / yy)


@inner
def _normal_at(sectors, normals, corner, face):
    """Return the normal at a corner; the tip of a cone is as flat as the face."""
    s, sign = np.int64(sectors.sector[corner]), sectors.sign[corner]
    if not is_known(normals, s):
        return face
    return sign * normals[s, 0], sign * normals[s, 1], sign * normals[s, 2]


@inner
def _turn_into(a, b, w):
    """Return w turned by the smallest rotation that takes unit a to unit b."""
    # w + (a x b) x w + (a x b) x ((a x b) x w) / (1 + a.b); opposite a, b never meet here
    # but for folded sheets, where any turn is as good: the denominator is kept off zero.
    axis = cross(a, b)
    once = cross(axis, w)
    twice = cross(axis, once)
    below = max(1.0 + dot(a, b), 1e-8)
    return (
        w[0] + once[0] + twice[0] / below,
        w[1] + once[1] + twice[1] / below,
        w[2] + once[2] + twice[2] / below,
    )


@inner
def _add_turned(normal, tensor, weight, target, sum_tensor):
    """Add the tensor a uu + b (uv + vu) + c vv, turned from one normal to another.

    Parameters
    ----------
    normal, target : vectors
        Unit normals from and to.
    tensor : tuple of 3 vectors
        u, v, and a, b, c.
    weight : float
    sum_tensor : float64[6]
        In/Out: xx, yy, zz, yz, xz, xy.
    """
    u, v, shape = tensor
    tu, tv = _turn_into(normal, target, u), _turn_into(normal, target, v)
    a, b, c = weight * shape[0], weight * shape[1], weight * shape[2]
    for d in range(3):
        sum_tensor[d] += a * tu[d] * tu[d] + 2.0 * b * tu[d] * tv[d] + c * tv[d] * tv[d]
        i, j = (d + 1) % 3, (d + 2) % 3
        sum_tensor[3 + d] += (
            a * tu[i] * tu[j] + b * (tu[i] * tv[j] + tu[j] * tv[i]) + c * tv[i] * tv[j]
        )


@kernel
def fill_tensors(surface, sectors, normals, tensors):
    """Fill the curvature tensor of each sector: mean over its triangles, by area.

    Parameters
    ----------
    surface : Surface
    sectors : Sectors
    normals : float64[n_sectors, 3]
    tensors : float64[n_sectors, 6]
        In/Out: zeros on entry; xx, yy, zz, yz, xz, xy, positive where the surface bends
        away from the normal.
    """
    points, areas, sector, sign = surface.points, surface.areas, sectors.sector, sectors.sign
    weights = np.zeros(tensors.shape[0])
    for c in range(areas.shape[0]):
        if areas[c] == 0.0:
            continue
        i, j, k = surface.cells[c, 0], surface.cells[c, 1], surface.cells[c, 2]
        x = (triple(points, i, 0), triple(points, j, 0), triple(points, k, 0))
        face, first = triple(surface.normals, c, 0), np.int64(3 * c)
        n = (
            _normal_at(sectors, normals, first, face),
            _normal_at(sectors, normals, first + 1, face),
            _normal_at(sectors, normals, first + 2, face),
        )
        tensor = _face_tensor(x, n, face)
        for v in range(3):
            s = np.int64(sector[first + v])
            if not is_known(normals, s):
                continue
            # The tensor changes sign with the normal, the sum is in the sector's orientation.
            _add_turned(face, tensor, sign[first + v] * areas[c], n[v], tensors[s])
            weights[s] += areas[c]
    for s in range(tensors.shape[0]):
        for d in range(6):
            tensors[s, d] /= max(weights[s], 1e-300)  # all zero where there is no area


@kernel
def smooth_tensors(surface, sectors, normals, tensors, smoothed):
    """Fill the mean, by area, of the tensors at all corners of the triangles of each sector.

    Parameters
    ----------
    surface : Surface
    sectors : Sectors
    normals : float64[n_sectors, 3]
    tensors : float64[n_sectors, 6]
    smoothed : float64[n_sectors, 6]
        Out.
    """
    areas, sign, fan, fan_ptr = surface.areas, sectors.sign, sectors.fan, sectors.fan_ptr
    for s in range(tensors.shape[0]):
        smoothed[s, :] = 0.0
        total = 0.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c = fan[k] // 3
            for w in range(3):
                corner = 3 * c + w
                t = np.int64(sectors.sector[corner])
                if not is_known(normals, t):
                    continue
                turn = sign[fan[k]] * sign[corner]
                source = (turn * normals[t, 0], turn * normals[t, 1], turn * normals[t, 2])
                u, v = frame(normals[t])
                tensor = (u, v, restrict(tensors[t], u, v))
                _add_turned(source, tensor, turn * areas[c], normals[s], smoothed[s])
                total += areas[c]
        for d in range(6):
            smoothed[s, d] /= max(total, 1e-300)
