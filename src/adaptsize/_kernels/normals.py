"""Normals of the sectors of triangulated surfaces in space."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.sectors import cross, dot, normalise


@kernel
def fill_sector_normals(points, cells, areas, face_normals, sign, fan, fan_ptr, normals):
    """Fill the normal of each sector with the weights of Max (1999).

    The weights, sin(angle) / (|a| |b|) for the two edges of a corner, make the
    normal exact at closed fans on a sphere and at fans on a cylinder cut into strips.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    areas : float64[m]
        Zero where degenerate.
    face_normals : float64[m, 3]
    sign : float64[3 m]
    fan : int32[3 m]
    fan_ptr : int32[n_sectors + 1]
    normals : float64[n_sectors, 3]
        Out: unit vectors; zero where all triangles of the sector are degenerate.
    """
    for s in range(normals.shape[0]):
        for d in range(3):
            normals[s, d] = 0.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c, v = fan[k] // 3, fan[k] % 3
            if areas[c] == 0.0:
                continue
            squares = 1.0
            for turn in range(1, 3):
                squared = 0.0
                for d in range(3):
                    gap = points[cells[c, (v + turn) % 3], d] - points[cells[c, v], d]
                    squared += gap * gap
                squares *= squared
            for d in range(3):
                normals[s, d] += sign[fan[k]] * areas[c] * face_normals[c, d] / squares
        normalise(normals[s])


@kernel
def drop_conical_normals(areas, face_normals, sign, fan, fan_ptr, limit, normals):
    """Set to zero the normal of each sector that has a triangle too oblique to it.

    Such a sector is the tip of a cone, whose triangles meet at small angles: it has
    no normal and no curvature.

    Parameters
    ----------
    areas : float64[m]
    face_normals : float64[m, 3]
    sign : float64[3 m]
    fan : int32[3 m]
    fan_ptr : int32[n_sectors + 1]
    limit : float
        Smallest cosine of the angle between the normals.
    normals : float64[n_sectors, 3]
        In/Out.
    """
    for s in range(normals.shape[0]):
        least = 1.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c = fan[k] // 3
            if areas[c] > 0.0:
                least = min(least, sign[fan[k]] * dot(normals[s], face_normals[c]))
        if least < limit:
            for d in range(3):
                normals[s, d] = 0.0


@kernel
def fill_fan_angles(points, cells, fan, fan_ptr, angles):
    """Fill the sum of the corner angles of each sector, in radians.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    fan : int32[3 m]
    fan_ptr : int32[n_sectors + 1]
    angles : float64[n_sectors]
        Out.
    """
    a, b, normal = np.empty(3), np.empty(3), np.empty(3)
    for s in range(angles.shape[0]):
        angles[s] = 0.0
        for k in range(fan_ptr[s], fan_ptr[s + 1]):
            c, v = fan[k] // 3, fan[k] % 3
            for d in range(3):
                a[d] = points[cells[c, (v + 1) % 3], d] - points[cells[c, v], d]
                b[d] = points[cells[c, (v + 2) % 3], d] - points[cells[c, v], d]
            cross(a, b, normal)
            angles[s] += math.atan2(math.sqrt(dot(normal, normal)), dot(a, b))


@inner
def _open_frame(points, i, ends, normal, u, v):
    """Fill tangents at a node: v across the line between the ends of its fan, u along it.

    Parameters
    ----------
    points : float64[n, 3]
    i : int
        The node.
    ends : int32[2]
        Far nodes of the feature edges that bound the fan.
    normal, u, v : float64[3]
        Out: u and v.
    """
    for d in range(3):
        u[d] = points[ends[0], d] - points[i, d]
        v[d] = points[ends[1], d] - points[i, d]
    normalise(u)
    normalise(v)
    for d in range(3):
        u[d] -= v[d]
    cross(normal, u, v)
    normalise(v)
    cross(v, normal, u)


@inner
def is_known(normals, s):
    """Return whether sector s has a normal."""
    return normals[s, 0] != 0.0 or normals[s, 1] != 0.0 or normals[s, 2] != 0.0


@inner
def _chord_sums(points, cells, fan, first, last, sector, sign, normals, u, v, sums):
    """Sum up the normal equations of the chord condition over the edges of one fan.

    The chord between two points of a sphere or a cylinder is at right angles to the
    sum of the normals there, on other surfaces up to the cube of its length.  The
    normal n + s u + t v is to meet this in the sense of least squares, with weights
    1 / length^4 so that the misfits are curvatures.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    fan : int32[3 m]
        The corners of this fan are ``fan[first:last]``.
    sector, sign : int32[3 m], float64[3 m]
    normals : float64[n_sectors, 3]
    u, v : float64[3]
        Tangents.
    sums : float64[5]
        Out: uu, uv, vv, and the right-hand sides of u and v.
    """
    for k in range(5):
        sums[k] = 0.0
    s = np.int64(sector[fan[first]])
    for k in range(first, last):
        corner = fan[k]
        c, w = corner // 3, corner % 3
        for turn in range(1, 3):
            there = 3 * c + (w + turn) % 3
            agree = sign[corner] * sign[there]
            squared, along_u, along_v, off = 0.0, 0.0, 0.0, 0.0
            for d in range(3):
                gap = points[cells[c, (w + turn) % 3], d] - points[cells[c, w], d]
                squared += gap * gap
                along_u += gap * u[d]
                along_v += gap * v[d]
                off += gap * (normals[s, d] + agree * normals[sector[there], d])
            if squared == 0.0 or not is_known(normals, np.int64(sector[there])):
                continue
            weight = 1.0 / (squared * squared)
            sums[0] += weight * along_u * along_u
            sums[1] += weight * along_u * along_v
            sums[2] += weight * along_v * along_v
            sums[3] -= weight * along_u * off
            sums[4] -= weight * along_v * off


@kernel
def correct_open_normals(
    points, cells, fan, fan_ptr, ends, sector, sign, angles, corners, limit, normals, corrected
):
    """Correct the normals of open fans, which lean towards the side where the faces are.

    A fan at a feature edge contains the surface on one side only.  Its mean normal is that of a
    point half an edge away, so that the curvature across the feature edge would have half its
    value.  The chord condition with the neighbours corrects the normal.
    Fans of less than 150 degrees are one-sided in both directions, others across
    the crease only.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    fan : int32[3 m]
    fan_ptr : int32[n_sectors + 1]
    ends : int32[n_sectors, 2]
    sector, sign : int32[3 m], float64[3 m]
    angles : float64[n_sectors]
        Of the fans, in radians.
    corners : bool
        Correct the fans of less than 150 degrees, or else the others.
    limit : float
        Largest tangent of the tilt.
    normals : float64[n_sectors, 3]
    corrected : float64[n_sectors, 3]
        In/Out: the same normals; those of the chosen fans are corrected.
    """
    u, v, sums = np.empty(3), np.empty(3), np.empty(5)
    for s in range(normals.shape[0]):
        is_corner = angles[s] < 150.0 / 180.0 * math.pi
        if ends[s, 0] < 0 or ends[s, 0] == ends[s, 1] or is_corner != corners:
            continue
        if not is_known(normals, s):
            continue
        corner = fan[fan_ptr[s]]
        _open_frame(points, cells[corner // 3, corner % 3], ends[s], normals[s], u, v)
        first, last = fan_ptr[s], fan_ptr[s + 1]
        _chord_sums(points, cells, fan, first, last, sector, sign, normals, u, v, sums)
        # Negligible for regular fans; avoids a division by zero for a fan of needles.
        damp = 1e-6 * (sums[0] + sums[2])
        if damp == 0.0:
            continue
        uu, vv = sums[0] + damp, sums[2] + damp
        tilt_u, tilt_v = 0.0, sums[4] / vv
        if is_corner:
            det = uu * vv - sums[1] * sums[1]
            tilt_u = (vv * sums[3] - sums[1] * sums[4]) / det
            tilt_v = (uu * sums[4] - sums[1] * sums[3]) / det
        shrink = min(1.0, limit / max(math.hypot(tilt_u, tilt_v), 1e-300))
        for d in range(3):
            corrected[s, d] += shrink * (tilt_u * u[d] + tilt_v * v[d])
        normalise(corrected[s])
