"""The largest distance of facets from others, with an upper bound.

The distance from one of the others is convex: in a piece of a facet it is largest at a corner.  So
no point of a piece is farther away than the farthest corner from that one of the others for which
this is least.  A piece with a bound that is more than what has been found is divided.

Triangles are first divided by the shadows of the others (see `shadows`): most of the parts are near
the facet whose shadow they are in.  The others become triangles, for which the facets nearest to
the corners and the centroid are tried.  They are divided where an edge of them leaves the part that
is nearest to one of the others, so that flat pieces above two flat facets are divided once.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.distance import closest_on_facet
from adaptsize._kernels.shadows import (
    Polygons,
    centre_of,
    divide_by_shadow,
    is_in_shadow,
    largest_gap,
    new_polygons,
    normal_of,
    put_corner,
)
from adaptsize._kernels.trees import cells_of_leaf, nearest_leaf
from adaptsize._kernels.vectors import triple

#: Share of the largest distance by which the bound may exceed it.
SHARE = 0.01
#: Coordinates are below 1; distances below this are rounding.
_ROUNDING = 1e-12
#: Largest number of pieces that wait, hence of divisions of a piece.
ROOM = 160
#: Pieces of a facet at most; those that are left then count with their bounds.
_MOST = 1_000_000
#: Every so many divisions, the longest edge is halved: pieces become small whatever is beside them.
_HALVED = 5
_STEPS = 12
#: Shadows are wider by this share of the limit, so that none of what is between two is left.
_WIDER = 0.1
#: Polygons of a facet at most.  Then the rest are triangles.
_MOST_POLYGONS = 100_000


class Pieces(NamedTuple):
    """Pieces of one facet that wait.

    Parameters
    ----------
    at : float64[ROOM, 12]
        Their corners, one after the other, and their distances from the others.
    near : int64[ROOM, 4]
        The nearest of the others at the corners, and the number of divisions.
    polygons : Polygons
        The pieces of a triangle before they are triangles.
    """

    at: np.ndarray
    near: np.ndarray
    polygons: Polygons


def new_pieces() -> Pieces:
    """Return scratch for one thread."""
    return Pieces(np.empty((ROOM, 12)), np.empty((ROOM, 4), np.int64), new_polygons())


@lean
def _corner(pieces, h, v):
    return pieces.at[h, 3 * v], pieces.at[h, 3 * v + 1], pieces.at[h, 3 * v + 2]


@lean
def _gap(tree, c, x):
    """Return the distance of x from one of the others."""
    return math.sqrt(closest_on_facet(tree.points, tree.cells, c, x)[0])


@lean
def _enter(tree, pieces, h, v, x, c, limit, stack):
    """Make x a corner of a piece; c, one of the others, is near it if it is not negative.

    If c is nearer than a limit, no other is looked for, and the distance may be less.
    """
    best = math.inf if c < 0 else closest_on_facet(tree.points, tree.cells, c, x)[0]
    stack.box[0], stack.bound[0] = 1, 0.0
    height = np.int64(1 if best > limit * limit else 0)
    while height > 0:
        leaf, height = nearest_leaf(tree.boxes, stack, height, best, x)
        for other in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
            distance2 = closest_on_facet(tree.points, tree.cells, other, x)[0]
            if distance2 < best:
                best, c = distance2, np.int64(other)
    pieces.at[h, 3 * v], pieces.at[h, 3 * v + 1], pieces.at[h, 3 * v + 2] = x
    pieces.at[h, 9 + v] = math.sqrt(best)
    pieces.near[h, v] = c


@lean
def _bound(tree, pieces, h, k, c):
    """Return the largest distance of the corners of a piece from one of the others, and where."""
    largest, worst = -1.0, 0
    for v in range(k):
        gap = pieces.at[h, 9 + v]
        if pieces.near[h, v] != c:
            gap = _gap(tree, c, _corner(pieces, h, v))
        if gap > largest:
            largest, worst = gap, v
    return largest, worst


@lean
def _between(x, y, t):
    """Return the point at a share t of the way from x to y."""
    return x[0] + t * (y[0] - x[0]), x[1] + t * (y[1] - x[1]), x[2] + t * (y[2] - x[2])


@lean
def _length2(pieces, h, v, w):
    square = 0.0
    for d in range(3):
        square += (pieces.at[h, 3 * v + d] - pieces.at[h, 3 * w + d]) ** 2
    return square


@lean
def _longest_edge(pieces, h, k):
    """Return the ends of the longest edge of a piece."""
    u, w = 0, k - 1
    for v in range(k - 1):
        if _length2(pieces, h, v, v + 1) > _length2(pieces, h, u, w):
            u, w = v, v + 1
    return u, w


@lean
def _share_nearer(tree, x, y, c, other, slack):
    """Return the share of the way from x to y up to where the other is as near as c."""
    low, high = 0.0, 1.0
    at_low = _gap(tree, c, x) - _gap(tree, other, x)
    at_high = _gap(tree, c, y) - _gap(tree, other, y)
    t = 0.5
    for _ in range(_STEPS):  # false position, with halved values at an end that stays
        t = low - at_low * (high - low) / (at_high - at_low)
        z = _between(x, y, t)
        at = _gap(tree, c, z) - _gap(tree, other, z)
        if abs(at) <= slack:
            break
        if at < 0.0:
            low, at_low, at_high = t, at, 0.5 * at_high
        else:
            high, at_high, at_low = t, at, 0.5 * at_low
    return t


@lean
def _are_neighbours(tree, c, other):
    """Return whether two of the others have a node in common."""
    for v in range(tree.cells.shape[1]):
        for w in range(tree.cells.shape[1]):
            if tree.cells[c, v] == tree.cells[other, w]:
                return True
    return False


@lean
def _cut(tree, pieces, h, k, c, worst, slack):
    """Return the edge of a piece to divide, at which share of it, and what is near there.

    c is one of the others, which the worst corner is too far from.
    """
    other = pieces.near[h, worst]
    found, nearer = -1, -slack
    if pieces.near[h, 3] % _HALVED != _HALVED - 1 and _are_neighbours(tree, c, other):
        for v in range(k):
            x = _corner(pieces, h, v)
            difference = _gap(tree, c, x) - _gap(tree, other, x) if v != worst else 0.0
            if difference < nearer:
                found, nearer = v, difference
    if found >= 0:
        x, y = _corner(pieces, h, found), _corner(pieces, h, worst)
        t = _share_nearer(tree, x, y, c, other, 0.1 * slack)
        if 1e-6 < t < 1.0 - 1e-6:
            return found, worst, t, other
    u, w = _longest_edge(pieces, h, k)
    return u, w, 0.5, pieces.near[h, u]


@lean
def _divide(tree, pieces, h, k, cut, limit, stack):
    """Divide a piece in two."""
    u, w, t, other = cut
    x = _between(_corner(pieces, h, u), _corner(pieces, h, w), t)
    pieces.near[h, 3] += 1
    for j in range(12):
        pieces.at[h + 1, j] = pieces.at[h, j]
    for j in range(4):
        pieces.near[h + 1, j] = pieces.near[h, j]
    _enter(tree, pieces, h, w, x, other, limit, stack)
    for j in range(3):
        pieces.at[h + 1, 3 * u + j] = x[j]
    pieces.at[h + 1, 9 + u], pieces.near[h + 1, u] = pieces.at[h, 9 + w], pieces.near[h, w]


@lean
def _keep(pieces, h, v, found, f):
    """Keep a corner of a piece if it is the farthest place so far."""
    if pieces.at[h, 9 + v] > found[f, 3]:
        for d in range(3):
            found[f, d] = pieces.at[h, 3 * v + d]
        found[f, 3] = pieces.at[h, 9 + v]


@lean
def _bounded(tree, pieces, h, k, limit, found, f, stack):
    """Return the bound of a piece, the one of the others for it, and the farthest corner."""
    least, c, worst = math.inf, np.int64(0), 0
    for v in range(k + 1):
        if v == k:
            x = _corner(pieces, h, 0)
            for w in range(1, k):
                x = _between(x, _corner(pieces, h, w), 1.0 / (w + 1.0))
            _enter(tree, pieces, ROOM - 1, 0, x, c, 0.0, stack)
            _keep(pieces, ROOM - 1, 0, found, f)
        other = pieces.near[h, v] if v < k else pieces.near[ROOM - 1, 0]
        if v > 0 and other == c:
            continue
        bound, at = _bound(tree, pieces, h, k, other)
        if bound < least:
            least, c, worst = bound, other, at
        if least <= limit:
            break
    return least, c, worst


@lean
def _limit(found, f, enough):
    """Return what the distance of a piece may be without being looked at further."""
    return max((1.0 + SHARE) * max(found[f, 3], enough), _ROUNDING)


@lean
def _search(tree, pieces, k, enough, found, f, stack):
    """Divide the first piece until all of its parts are near, or no farther than what is found."""
    pieces.near[0, 3] = 0
    h, count = 0, 0
    while h >= 0:
        count += 1
        limit = _limit(found, f, enough)
        bound, c, worst = _bounded(tree, pieces, h, k, limit, found, f, stack)
        if bound <= limit or k == 1 or count > _MOST or h >= ROOM - 3:
            found[f, 4] = max(found[f, 4], bound)
            h -= 1
            continue
        cut = _cut(tree, pieces, h, k, c, worst, 0.1 * SHARE * limit)
        _divide(tree, pieces, h, k, cut, limit, stack)
        if pieces.at[h, 9 + cut[1]] > limit:
            _keep(pieces, h, cut[1], found, f)
        h += 1


@lean
def _search_in_polygon(tree, pieces, h, c, enough, found, f, stack):
    """Search in the triangles of a polygon, of which c is near."""
    for last in range(2, pieces.polygons.n_corners[h]):
        for v in range(3):
            at = 0 if v == 0 else last - 2 + v
            x = triple(pieces.polygons.at, h, 3 * at)
            _enter(tree, pieces, 0, v, x, c, 0.0, stack)
            _keep(pieces, 0, v, found, f)
        _search(tree, pieces, 3, enough, found, f, stack)


@lean
def _search_by_shadows(tree, pieces, enough, found, f, stack):
    """Divide a triangle, the first polygon, by the shadows of what is near."""
    polygons = pieces.polygons
    normal, h, count, c = normal_of(polygons, 0), 0, 0, np.int64(pieces.near[0, 0])
    while h >= 0:
        count += 1
        x = centre_of(polygons, h)
        _enter(tree, pieces, ROOM - 1, 0, x, c, 0.0, stack)
        _keep(pieces, ROOM - 1, 0, found, f)
        c = np.int64(pieces.near[ROOM - 1, 0])
        limit = _limit(found, f, enough)
        if count < _MOST_POLYGONS and is_in_shadow(tree, c, x, normal, _WIDER * limit):
            h = divide_by_shadow(tree, polygons, h, c, normal, _WIDER * limit)
        bound = largest_gap(tree, polygons, h, c)
        if bound <= limit:
            found[f, 4] = max(found[f, 4], bound)
        else:
            _search_in_polygon(tree, pieces, h, c, enough, found, f, stack)
        h -= 1


@lean_kernel
def find_farthest(tree, facets, first, last, enough, stack, pieces, found):
    """Find the place of each facet that is farthest from others.

    Parameters
    ----------
    tree : Tree
        The others: points, segments or triangles, with coordinates below 1.
    facets : float64[n, k, 3]
        Corners of points, segments or triangles.
    first, last : int
        The facets to look at.
    enough : float
        A facet is not looked at further once all its points are nearer than this.
    stack : Stack
    pieces : Pieces
        Scratch.
    found : float64[n, 5]
        Out: the place, its distance, and a bound on the distance of all places of the facet.  It
        exceeds the larger of the distance and ``enough`` by a hundredth of that at most, unless too
        many others are near.
    """
    k = facets.shape[1]
    for f in range(first, last):
        found[f, 3], found[f, 4] = -1.0, 0.0
        near = np.int64(-1)
        for v in range(k):
            x = (facets[f, v, 0], facets[f, v, 1], facets[f, v, 2])
            _enter(tree, pieces, 0, v, x, near, 0.0, stack)
            near = pieces.near[0, v]
            _keep(pieces, 0, v, found, f)
            put_corner(pieces.polygons, 0, v, x)
        if k == 3 and tree.cells.shape[1] == 3:
            pieces.polygons.n_corners[0] = 3
            _search_by_shadows(tree, pieces, enough, found, f, stack)
        else:
            _search(tree, pieces, k, enough, found, f, stack)
