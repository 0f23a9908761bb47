"""The distance between features of a boundary that do not meet, through the domain."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.distance import closest_on_segment, closest_on_triangle
from adaptsize._kernels.interpolate import distance2_to_box
from adaptsize._kernels.rays import ALONG, holds, is_blocked

#: Numbers of a sector: two unit vectors along its sides, its unit outward normal, and its angle.
SECTOR = 10

_STACK = 64
# Lengths of unit vectors that differ by less are equal.
_EQUAL = 1e-9


@inner
def _closest(points, cells, t, x):
    """Return the point of a node, segment or triangle that is closest to x."""
    i = cells[t, 0]
    j, k = i, i
    s, u, v = 1.0, 0.0, 0.0
    if cells.shape[1] == 2:
        j = cells[t, 1]
        _, s, u = closest_on_segment(points, i, j, x)
    elif cells.shape[1] == 3:
        j, k = cells[t, 1], cells[t, 2]
        _, s, u, v = closest_on_triangle(points, i, j, k, x)
    return (
        s * points[i, 0] + u * points[j, 0] + v * points[k, 0],
        s * points[i, 1] + u * points[j, 1] + v * points[k, 1],
        s * points[i, 2] + u * points[j, 2] + v * points[k, 2],
    )


@inner
def _side_of(sectors, begin, end, ux, uy, uz):
    """Return on which side of the sectors around a point a direction lies: below 0 inside, 0 along.

    The closest point of the sectors, as infinite cones, decides: with the normal of its sector, or
    with the sum of the normals of those that share it, at the apex weighted by angles [1]_.

    References
    ----------
    .. [1] J. A. Baerentzen, H. Aanaes, "Signed distance computation using the angle weighted
       pseudonormal", IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253.
    """
    best, side = math.inf, 0.0
    for s in range(begin, end):
        row = sectors[s]
        height = ux * row[6] + uy * row[7] + uz * row[8]
        px, py, pz = ux - height * row[6], uy - height * row[7], uz - height * row[8]
        turn = _turn(row, row[0], row[1], row[2], row[3], row[4], row[5])
        if (
            turn != 0.0
            and px * px + py * py + pz * pz > _EQUAL * _EQUAL
            and turn * _turn(row, row[0], row[1], row[2], px, py, pz) >= 0.0
            and turn * _turn(row, px, py, pz, row[3], row[4], row[5]) >= 0.0
        ):
            if abs(height) < best - _EQUAL:
                best, side = abs(height), 0.0
            if abs(height) <= best + _EQUAL:
                side += height
            continue
        for k in range(2):
            along = ux * row[3 * k] + uy * row[3 * k + 1] + uz * row[3 * k + 2]
            weight = 1.0
            if along <= _EQUAL:
                along, weight = 0.0, row[9]
            qx, qy, qz = (
                ux - along * row[3 * k], uy - along * row[3 * k + 1], uz - along * row[3 * k + 2],
            )  # fmt: skip
            length = math.sqrt(qx * qx + qy * qy + qz * qz)
            if length < best - _EQUAL:
                best, side = length, 0.0
            if length <= best + _EQUAL:
                side += weight * (qx * row[6] + qy * row[7] + qz * row[8])
    return 0.0 if best <= ALONG else side


@inner
def _turn(row, ax, ay, az, bx, by, bz):
    """Return the component of the cross product of two vectors along the normal of a sector."""
    return (
        row[6] * (ay * bz - az * by) + row[7] * (az * bx - ax * bz) + row[8] * (ax * by - ay * bx)
    )


@kernel
def lower_separations(
    points, cells, boxes, owner, first_touched, touched, queries, first_skipped, skipped, ends,
    places, sine, first_sector, sectors, facets, facet_boxes, slack, begin, end, distances,
):  # fmt: skip
    """Lower distances to those of features that are closer, and seen through the domain.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        Corners (k = 1), segments of curves or triangles of faces, in the order of a tree.
    boxes : float64[2 * n_leaves, 6]
    owner : int32[m]
        The corner, curve or face of each.
    first_touched, touched : int32[n_owners + 1], int32[...]
        Corners of each curve or face, ascending.
    queries : float64[n_queries, 3]
    first_skipped, skipped : int32[n_queries + 1], int32[...]
        Owners that are incident to the feature of each query, ascending.
    ends : int32[n_queries, 2]
        Corners at the ends of the curve of each query, or -1.
    places : float64[n_queries, 2, 3]
        Their places.
    sine : float64
        An owner that touches one of the ends counts only below this share of the distance from
        that end.
    first_sector, sectors : int32[n_queries + 1], float64[..., SECTOR]
        Sectors of the facets around each query.
    facets, facet_boxes
        All facets, as in rays.py.
    slack : float
    begin, end : int
        Only these queries are processed.
    distances : float64[n_queries]
        In/Out.
    """
    n_cells, n_leaves = cells.shape[0], boxes.shape[0] // 2
    stack, inner_stack = np.empty(_STACK, np.int64), np.empty(_STACK, np.int64)
    for r in range(begin, end):
        x = (queries[r, 0], queries[r, 1], queries[r, 2])
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if distance2_to_box(boxes, node, x) >= distances[r] * distances[r]:
                continue
            if node < n_leaves:
                near, far = 2 * node, 2 * node + 1
                if distance2_to_box(boxes, far, x) < distance2_to_box(boxes, near, x):
                    near, far = far, near
                stack[top], stack[top + 1] = far, near
                top += 2
                continue
            leaf = node - n_leaves
            for t in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
                if holds(first_skipped, skipped, r, owner[t]):
                    continue
                qx, qy, qz = _closest(points, cells, t, x)
                dx, dy, dz = qx - x[0], qy - x[1], qz - x[2]
                length = math.sqrt(dx * dx + dy * dy + dz * dz)
                if not slack < length < distances[r]:
                    continue
                counts = True
                for e in range(2):
                    corner = ends[r, e]
                    if corner >= 0 and holds(first_touched, touched, np.int64(owner[t]), corner):
                        ax, ay, az = (
                            places[r, e, 0] - x[0], places[r, e, 1] - x[1], places[r, e, 2] - x[2],
                        )  # fmt: skip
                        counts = counts and length < sine * math.sqrt(ax * ax + ay * ay + az * az)
                if not counts:
                    continue
                ux, uy, uz = dx / length, dy / length, dz / length
                if _side_of(sectors, first_sector[r], first_sector[r + 1], ux, uy, uz) > 0.0:
                    continue
                ray = (x[0], x[1], x[2], ux, uy, uz)
                if not is_blocked(facets, facet_boxes, ray, length, slack, inner_stack):
                    distances[r] = length
