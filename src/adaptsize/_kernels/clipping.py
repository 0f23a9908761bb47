"""Area or volume that two triangles in the plane, or two tetrahedra, have in common.

One of them is cut by the sides of the other.  In the plane what is left is a convex polygon.
In space it is kept as a list of tetrahedra, because a plane cuts a tetrahedron into tetrahedra
and prisms, and a prism is three of them.  Coordinates are taken relative to a corner of the
simplex that is cut, so that none is larger than the two cells.
"""

import math

from adaptsize._kernels.compiling import inner

# A triangle cut three times has at most six corners.
MAX_CORNERS = 8

# A tetrahedron cut by a plane leaves at most three, and so for each of four planes.
MAX_PIECES = 81

# Where corners lie from a plane.
_BEHIND, _ACROSS, _BEFORE = -1, 0, 1


@inner
def triangles_overlap(old_points, old_cells, k, new_points, new_cells, c, here, there):
    """Return the area that old cell k and new cell c have in common.

    ``here`` and ``there`` are float64[8, 2], scratch; the other arguments are those of
    `adaptsize._kernels.overlap.fill_overlaps`.
    """
    x0, y0 = new_points[new_cells[c, 0], 0], new_points[new_cells[c, 0], 1]
    n = 3
    for v in range(3):
        here[v, 0] = new_points[new_cells[c, v], 0] - x0
        here[v, 1] = new_points[new_cells[c, v], 1] - y0
    i, j, m = old_cells[k, 0], old_cells[k, 1], old_cells[k, 2]
    turn = (old_points[j, 0] - old_points[i, 0]) * (old_points[m, 1] - old_points[i, 1]) - (
        old_points[j, 1] - old_points[i, 1]
    ) * (old_points[m, 0] - old_points[i, 0])
    if turn == 0.0:
        return 0.0
    if turn < 0.0:
        j, m = m, j
    for _ in range(3):
        # The side from i to j; what lies to its left is kept.
        ax, ay = old_points[i, 0] - x0, old_points[i, 1] - y0
        ex, ey = old_points[j, 0] - old_points[i, 0], old_points[j, 1] - old_points[i, 1]
        left = 0
        px, py = here[n - 1, 0], here[n - 1, 1]
        before = ex * (py - ay) - ey * (px - ax)
        for v in range(n):
            qx, qy = here[v, 0], here[v, 1]
            after = ex * (qy - ay) - ey * (qx - ax)
            if (before >= 0.0) != (after >= 0.0):
                t = before / (before - after)
                there[left, 0] = px + t * (qx - px)
                there[left, 1] = py + t * (qy - py)
                left += 1
            if after >= 0.0:
                there[left, 0] = qx
                there[left, 1] = qy
                left += 1
            px, py, before = qx, qy, after
        if left < 3:
            return 0.0
        n = left
        here, there = there, here
        i, j, m = j, m, i
    twice = 0.0
    for v in range(1, n - 1):
        twice += (here[v, 0] - here[0, 0]) * (here[v + 1, 1] - here[0, 1]) - (
            here[v, 1] - here[0, 1]
        ) * (here[v + 1, 0] - here[0, 0])
    return 0.5 * abs(twice)


@inner
def _between(pieces, p, i, j, t, corners, v):
    """Set row v of ``corners`` to the point at fraction t from corner i to j of a piece."""
    for d in range(3):
        corners[v, d] = pieces[p, i, d] + t * (pieces[p, j, d] - pieces[p, i, d])


@inner
def _add_prism(prism, pieces, n):
    """Append the three tetrahedra of a prism; return the new number of pieces.

    Parameters
    ----------
    prism : float64[6, 3]
        Corners of one triangle, then the corresponding ones of the other.
    pieces : float64[81, 4, 3]
        In/Out.
    n : int
    """
    for t in range(3):
        for v in range(4):
            for d in range(3):
                pieces[n + t, v, d] = prism[t + v, d]
    return n + 3


@inner
def _cut(pieces, n, normal, origin, kept, prism, height, order):
    """Cut tetrahedra by a half space; return how many are left.

    Parameters
    ----------
    pieces : float64[81, 4, 3]
    n : int
    normal, origin : float64[3]
        What has ``(x - origin) . normal >= 0`` is kept.
    kept : float64[81, 4, 3]
        Out.
    prism : float64[6, 3]
        Scratch, as are height, float64[4], and order, int64[4].
    """
    m = 0
    n0, n1, n2 = normal[0], normal[1], normal[2]
    o0, o1, o2 = origin[0], origin[1], origin[2]
    for p in range(n):
        # Corners that are kept come first in ``order``.
        n_in = 0
        n_out = 0
        for v in range(4):
            above = (
                (pieces[p, v, 0] - o0) * n0
                + (pieces[p, v, 1] - o1) * n1
                + (pieces[p, v, 2] - o2) * n2
            )
            height[v] = above
            if above >= 0.0:
                order[n_in] = v
                n_in += 1
            else:
                n_out += 1
                order[4 - n_out] = v
        if n_in == 0:
            continue
        if n_in == 4:
            for v in range(4):
                for d in range(3):
                    kept[m, v, d] = pieces[p, v, d]
            m += 1
            continue
        if n_in == 1:
            i = order[0]
            for d in range(3):
                kept[m, 0, d] = pieces[p, i, d]
            for v in range(1, 4):
                j = order[v]
                t = height[i] / (height[i] - height[j])
                for d in range(3):
                    kept[m, v, d] = pieces[p, i, d] + t * (pieces[p, j, d] - pieces[p, i, d])
            m += 1
            continue
        if n_in == 3:  # the tip is cut off
            o = order[3]
            for v in range(3):
                i = order[v]
                for d in range(3):
                    prism[v, d] = pieces[p, i, d]
                _between(pieces, p, i, o, height[i] / (height[i] - height[o]), prism, 3 + v)
        else:  # an edge is cut off
            for v in range(2):
                i = order[v]
                for d in range(3):
                    prism[3 * v, d] = pieces[p, i, d]
                for w in range(2):
                    j = order[2 + w]
                    t = height[i] / (height[i] - height[j])
                    _between(pieces, p, i, j, t, prism, 3 * v + 1 + w)
        m = _add_prism(prism, kept, m)
    return m


@inner
def _six_volumes(x, a, b, c, d):
    """Return (b - a) x (c - a) . (d - a) of four rows of x, float64[.., 3]."""
    e0, e1, e2 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    f0, f1, f2 = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    g0, g1, g2 = x[d, 0] - x[a, 0], x[d, 1] - x[a, 1], x[d, 2] - x[a, 2]
    return g0 * (e1 * f2 - e2 * f1) + g1 * (e2 * f0 - e0 * f2) + g2 * (e0 * f1 - e1 * f0)


@inner
def _set_plane(corners, v, normal, origin):
    """Set the plane of the side opposite to corner v of four, its normal towards the corner."""
    a, b, c = (v + 1) % 4, (v + 2) % 4, (v + 3) % 4
    e0, e1, e2 = (
        corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1], corners[b, 2] - corners[a, 2]
    )  # fmt: skip
    f0, f1, f2 = (
        corners[c, 0] - corners[a, 0], corners[c, 1] - corners[a, 1], corners[c, 2] - corners[a, 2]
    )  # fmt: skip
    normal[0] = e1 * f2 - e2 * f1
    normal[1] = e2 * f0 - e0 * f2
    normal[2] = e0 * f1 - e1 * f0
    side = 0.0
    for d in range(3):
        origin[d] = corners[a, d]
        side += (corners[v, d] - corners[a, d]) * normal[d]
    if side < 0.0:
        for d in range(3):
            normal[d] = -normal[d]


@inner
def _side_of(normal, origin, corners):
    """Return if four corners, float64[4, 3], lie all behind a plane (or in it), before, or both."""
    lowest = math.inf
    highest = -math.inf
    for w in range(4):
        height = (
            (corners[w, 0] - origin[0]) * normal[0]
            + (corners[w, 1] - origin[1]) * normal[1]
            + (corners[w, 2] - origin[2]) * normal[2]
        )
        lowest = min(lowest, height)
        highest = max(highest, height)
    if highest <= 0.0:
        return _BEHIND
    return _BEFORE if lowest >= 0.0 else _ACROSS


@inner
def set_planes(corners, normals, origins):
    """Set the planes of the four sides of a tetrahedron, float64[4, 3] each, normals inwards."""
    for v in range(4):
        _set_plane(corners, v, normals[v], origins[v])


@inner
def tetrahedra_overlap(
    old_points, old_cells, k, start, cut, sides, corners, normals, origins, here, there, prism,
    height, order, where,
):  # fmt: skip
    """Return the volume that old cell k and a new cell have in common.

    Parameters
    ----------
    old_points, old_cells, k
        As in `adaptsize._kernels.overlap.fill_overlaps`.
    start : float64[3]
        First corner of the new cell, from which coordinates are taken.
    cut : float64[4, 3]
        Corners of the new cell.
    sides : float64[2, 4, 3]
        Normals and origins of its planes.
    corners, normals, origins, here, there, prism, height, order, where
        Scratch: float64[4, 3] three times, float64[81, 4, 3] twice; as in `_cut`; int64[4].
    """
    for v in range(4):
        for d in range(3):
            corners[v, d] = old_points[old_cells[k, v], d] - start[d]
    # A side of one cell that has all of the other beyond it: nothing to be cut.
    for v in range(4):
        if _side_of(sides[0, v], sides[1, v], corners) == _BEHIND:
            return 0.0
    if _six_volumes(corners, 0, 1, 2, 3) == 0.0:
        return 0.0
    set_planes(corners, normals, origins)
    for v in range(4):
        where[v] = _side_of(normals[v], origins[v], cut)
        if where[v] == _BEHIND:
            return 0.0
    n = 1
    for v in range(4):
        for d in range(3):
            here[0, v, d] = cut[v, d]
    for v in range(4):
        if where[v] == _BEFORE:
            continue
        n = _cut(here, n, normals[v], origins[v], there, prism, height, order)
        if n == 0:
            return 0.0
        here, there = there, here
    total = 0.0
    for p in range(n):
        total += abs(_six_volumes(here[p], 0, 1, 2, 3))
    return total / 6.0
