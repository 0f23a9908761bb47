"""Paths over reflex edges that are extended by one more edge, and boxes around paths."""

import math

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.vectors import cross, dot, minus, norm, triple, without

#: Angles between a path and the faces of an edge below this are zero.
GRAZING = 1e-9


@lean
def _at(edges, e, t):
    """Return the point at place t of edge e."""
    start, along = triple(edges.start, e, 0), triple(edges.along, e, 0)
    return (start[0] + t * along[0], start[1] + t * along[1], start[2] + t * along[2])


@lean
def _unit_without(vector, along):
    """Return a vector without its part along a unit vector: its length, and its direction."""
    rest = without(vector, dot(vector, along), along)
    far = norm(rest)
    scale = max(far, 1e-300)
    return far, (rest[0] / scale, rest[1] / scale, rest[2] / scale)


@lean
def _turned(paths, w, x):
    """Return the base of path w, rotated about its last edge to the side opposite to x."""
    e = paths.edge[w]
    start, along = triple(paths.edges.start, e, 0), triple(paths.edges.along, e, 0)
    across = _unit_without(minus(x, start), along)[1]
    f, r = paths.image[w, 0], paths.image[w, 1]
    return (
        start[0] + f * along[0] - r * across[0],
        start[1] + f * along[1] - r * across[1],
        start[2] + f * along[2] - r * across[2],
    )


@lean
def _fill_sector(edges, e, ahead, obstacle, sector):
    """Fill where a path over edge e acts, with its directions from both ends of the edge before.

    If it passes the obstacle on one side from one end and on the other side from the other end,
    it may act everywhere.

    Returns whether the inside lies straight ahead from one of these; else it is not shortest there.
    """
    along, sides, is_inside = triple(edges.along, e, 0), (-1, -1), False
    for end in range(2):
        first = dot(triple(edges.normals[e], 0, 0), ahead[end])
        second = dot(triple(edges.normals[e], 1, 0), ahead[end])
        sides = (sides[1], 0 if first <= second else 1)
        is_inside = is_inside or min(first, second) <= GRAZING
        sideways = cross(ahead[end], along)
        sign = -1.0 if dot(sideways, obstacle) < 0.0 else 1.0
        for d in range(3):
            sector[3 + 3 * end + d] = sign * sideways[d]
            sector[d] = edges.normals[e, sides[1], d]
    if sides[0] != sides[1]:
        sector[:] = 0.0
    return is_inside


@lean_kernel
def extend_paths(paths, obstacles, given, starts, slack, found):
    """Fill paths that are extended over one more edge.

    Parameters
    ----------
    paths : Paths
    obstacles : float64[e, 3]
        Direction from each edge to the outside.
    given : tuple of int32[k], int32[k], int32[k], float64[k, 2]
        For each new path its last edge, the path before, its base, and the part of the edge.
    starts : tuple of float64[k, 3], float64[k]
        The points of the bases where paths to the middles of the parts start, and the sizes at the
        images of straight ones.
    slack : float64
        Smaller distances are zero.
    found : tuple of float64[k, 2], float64[k], float64[k, 9], bool[k], bool[k]
        Out: image, offset, sector, skew as in `Paths`, and whether the path may be shortest.
    """
    edges, (edge, parent, base, part), (foot, size) = paths.edges, given, starts
    image, offset, sector, skew, ok = found
    for k in range(edge.shape[0]):
        e, w = edge[k], parent[k]
        last, several = paths.edge[w], paths.bases.counts[base[k]] > 1
        start, along = triple(edges.start, e, 0), triple(edges.along, e, 0)
        origin = one = other = triple(foot, k, 0)
        offset[k] = size[k]
        skew[k] = paths.skew[w] or several
        if last >= 0:
            origin = _turned(paths, w, _at(edges, e, 0.5 * (part[k, 0] + part[k, 1])))
            # The previous piece starts at any point of a part of an edge.
            one, other = _at(edges, last, paths.part[w, 0]), _at(edges, last, paths.part[w, 1])
            offset[k] = paths.offset[w]
            apart = minus(start, triple(edges.start, last, 0))
            volume = dot(cross(triple(edges.along, last, 0), along), apart)
            skew[k] = skew[k] or abs(volume) > slack
        away = minus(origin, start)
        image[k, 0] = dot(away, along)
        image[k, 1] = norm(without(away, image[k, 0], along))
        far, ahead = _unit_without(minus(start, one), along)
        far_too, ahead_too = _unit_without(minus(start, other), along)
        nil, nil_too = far <= 10.0 * slack, far_too <= 10.0 * slack
        both = (ahead_too if nil else ahead, ahead if nil_too else ahead_too)
        is_inside = _fill_sector(edges, e, both, triple(obstacles, e, 0), sector[k])
        ok[k] = several or (is_inside and not (nil and nil_too))
        if several:  # it may start elsewhere on its edge or face
            sector[k] = 0.0


@lean_kernel
def bound_paths(paths, which, g, lower, upper, middle, value):
    """Fill boxes around the last bends of paths, or their bases, their middles and least sizes.

    Parameters
    ----------
    paths : Paths
    which : int32[k]
    g : float64
    lower, upper, middle : float64[k, 3]
        Out.
    value : float64[k]
        Out.
    """
    table, edges = paths.bases.table, paths.edges
    for k in range(which.shape[0]):
        w = which[k]
        b, e = paths.base[w], paths.edge[w]
        if e >= 0:
            low, high, place = paths.part[w, 0], paths.part[w, 1], paths.image[w, 0]
            beyond = place - min(max(place, low), high)
            value[k] = paths.offset[w] + g * math.hypot(beyond, paths.image[w, 1])
            first, last = _at(edges, e, low), _at(edges, e, high)
            for d in range(3):
                lower[k, d], upper[k, d] = min(first[d], last[d]), max(first[d], last[d])
        else:
            value[k] = min(table[b, 9], table[b, 10], table[b, 11])
            for d in range(3):
                lower[k, d] = min(table[b, d], table[b, 3 + d], table[b, 6 + d])
                upper[k, d] = max(table[b, d], table[b, 3 + d], table[b, 6 + d])
        for d in range(3):
            middle[k, d] = 0.5 * (lower[k, d] + upper[k, d])
