"""Rays from points of a boundary into the domain, and the first wall that each one hits.

Facets are triangles, or segments in the plane z = 0, in the order of a tree of boxes (trees.py).
A facet is a row of 15 numbers: a corner c, the unit outward normal n, two vectors a and b, and
three tolerances, so that a point x of its plane has the weights

    u = a . (x - c),    v = b . (x - c),    1 - u - v,

each of which may be negative by its tolerance: a point may be beside a facet by the same distance
everywhere, however thin the facet is.  Hence no ray escapes between two facets.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.trees import (
    DEPTH,
    Stack,
    cells_of_leaf,
    descent,
    descent_by_bound,
    leaf_within,
)
from adaptsize._kernels.vectors import dot, minus, triple

#: A direction lies in a plane up to this sine of an angle: single precision in files tilts facets.
ALONG = 1e-3


class FacetTree(NamedTuple):
    """The facets of a boundary in a tree.

    Parameters
    ----------
    facets : float64[m, 15]
    boxes : float64[2 * n_leaves, 6]
    slack : float
        Lengths up to this are rounding.
    """

    facets: np.ndarray
    boxes: np.ndarray
    slack: float


class Rule(NamedTuple):
    """Which walls count.

    Parameters
    ----------
    two_sided : bool[m]
        Facets of open sheets, which are walls for rays from both sides.
    face : int32[m]
    meets : int32[n_faces + 1], int32[k]
        Faces that meet each face, ascending (see `holds`).
    limits : float64[2]
        Cosines of the largest angle between the direction and the normal of a wall that
        counts, and of the largest one of a wall on a face that meets that of the start.
    """

    two_sided: np.ndarray
    face: np.ndarray
    meets: tuple[np.ndarray, np.ndarray]
    limits: np.ndarray


class Rays(NamedTuple):
    """Rays from points of a boundary, and what they hit.

    Parameters
    ----------
    starts : float64[n, 3]
    directions : float64[n, 3]
        Unit vectors.
    face : int32[n]
        Face of each start.
    reach : float64[n]
        Hits up to this distance do not count, such as those of the facets there.
    leaves : float64[n], Out
        Distance of the first wall; inf if there is none.
    stops : bool[n], Out
        Whether that wall is an open sheet.
    widths : float64[n], Out
        ``leaves`` if a wall at this distance counts, else inf.
    """

    starts: np.ndarray
    directions: np.ndarray
    face: np.ndarray
    reach: np.ndarray
    leaves: np.ndarray
    stops: np.ndarray
    widths: np.ndarray


@inner
def hit(facets, t, x, way):
    """Return the distance at which a ray crosses facet t, and the cosine of its direction to n.

    The distance is inf if the ray misses the facet or runs along its plane.
    """
    normal = triple(facets, t, 3)
    cosine = dot(way, normal)
    if not abs(cosine) > 1e-9:
        return math.inf, 0.0
    to = minus(triple(facets, t, 0), x)
    along = dot(to, normal) / cosine
    there = minus((along * way[0], along * way[1], along * way[2]), to)
    u, v = dot(triple(facets, t, 6), there), dot(triple(facets, t, 9), there)
    if u >= -facets[t, 12] and v >= -facets[t, 13] and 1.0 - u - v >= -facets[t, 14]:
        return along, cosine
    return math.inf, 0.0


@inner
def inverse(way):
    """Return the inverses of the components of a direction, inf where one is 0."""
    return (
        1.0 / way[0] if way[0] != 0.0 else math.inf,
        1.0 / way[1] if way[1] != 0.0 else math.inf,
        1.0 / way[2] if way[2] != 0.0 else math.inf,
    )


@inner
def _entry(boxes, node, ray):
    """Return the distance at which a ray enters a box, widened by a slack; inf if it misses.

    ``ray``: start, inverse of the direction, slack.
    """
    x, inverse, slack = ray
    low, high = 0.0, math.inf
    for d in range(3):
        # Comparisons are such that nan, from 0 * inf, changes nothing.
        a = (boxes[node, d] - slack - x[d]) * inverse[d]
        b = (boxes[node, 3 + d] + slack - x[d]) * inverse[d]
        if a > b:
            a, b = b, a
        if a > low:
            low = a
        if b < high:
            high = b
    return low if low <= high else math.inf


_leaf_on_ray = descent_by_bound(_entry)


@inner
def holds(lists, row, item):
    """Return whether list ``row``, ascending, has an item.

    ``lists``: ``first`` and ``items``; the list is ``items[first[row] : first[row + 1]]``.
    """
    first, items = lists
    low, high = first[row], first[row + 1]
    while low < high:
        middle = (low + high) // 2
        if items[middle] < item:
            low = middle + 1
        else:
            high = middle
    return low < first[row + 1] and items[low] == item


@kernel
def shoot(walls, rule, rays, begin, end):
    """Find the first wall through which each ray leaves a body.

    Parameters
    ----------
    walls : FacetTree
        Hits as near to each other as the slack are one.
    rule : Rule
    rays : Rays
        In/Out.
    begin, end : int
        Only these rays are shot.
    """
    facets, slack, two_sided = walls.facets, walls.slack, rule.two_sided
    stack = Stack(np.empty(DEPTH, np.int64), np.empty(DEPTH))
    for r in range(begin, end):
        x, way = triple(rays.starts, r, 0), triple(rays.directions, r, 0)
        ray = (x, inverse(way), slack)
        nearest, sheet, counts = math.inf, math.inf, math.inf
        stack.box[0], stack.bound[0], height = 1, 0.0, np.int64(1)
        while height > 0:
            leaf, height = _leaf_on_ray(walls.boxes, stack, height, nearest + slack, ray)
            for t in range(*cells_of_leaf(leaf, walls.boxes, facets.shape[0])):
                along, cosine = hit(facets, t, x, way)
                if not rays.reach[r] < along < math.inf or (cosine < 0.0 and not two_sided[t]):
                    continue
                nearest = min(nearest, along)
                if two_sided[t]:
                    sheet = min(sheet, along)
                cosine = abs(cosine)
                if along >= counts or cosine < rule.limits[0]:
                    continue
                if cosine > rule.limits[1] or not holds(
                    rule.meets, np.int64(rays.face[r]), rule.face[t]
                ):
                    counts = along
        rays.leaves[r], rays.stops[r] = nearest, sheet <= nearest + slack
        rays.widths[r] = counts if counts <= nearest + slack else math.inf


@kernel
def find_entries(walls, two_sided, places, directions, enters):
    """Find whether a body begins at points of the boundary, in given directions.

    Parameters
    ----------
    walls : FacetTree
    two_sided : bool[m]
        As in `Rule`.
    places, directions : float64[n, 3]
        Directions are unit vectors.
    enters : bool[n]
        Out: whether a facet through the point is entered.
    """
    facets, slack = walls.facets, 2.0 * walls.slack
    stack = np.empty(DEPTH, np.int64)
    for r in range(places.shape[0]):
        x, way = triple(places, r, 0), triple(directions, r, 0)
        enters[r] = False
        stack[0], height = 1, np.int64(1)
        while height > 0 and not enters[r]:
            # What is hit is a slack beside a facet at most, and as much along the ray.
            leaf, height = leaf_within(walls.boxes, stack, height, ((x, x), 2.0 * slack * slack))
            for t in range(*cells_of_leaf(leaf, walls.boxes, facets.shape[0])):
                along, cosine = hit(facets, t, x, way)
                if cosine < 0.0 and abs(along) <= slack and not two_sided[t]:
                    enters[r] = True


@inner
def _is_on_way(boxes, node, segment):
    """Return whether a ray enters a box before its end, ``segment``: the ray and its length."""
    return _entry(boxes, node, segment[0]) < segment[1]


leaf_on_segment = descent(_is_on_way)


@inner
def is_blocked(walls, x, way, length, stack):
    """Return whether a facet crosses a ray at more than the slack from both of its ends.

    A ray that runs along a facet, up to the sine `ALONG`, does not cross it.

    Parameters
    ----------
    walls : FacetTree
    x, way : tuple of 3 float64
        Start and unit direction.
    length : float
    stack : int64[DEPTH]
        Scratch.
    """
    facets, slack = walls.facets, walls.slack
    segment = ((x, inverse(way), slack), length)
    stack[0], height = 1, np.int64(1)
    while height > 0:
        leaf, height = leaf_on_segment(walls.boxes, stack, height, segment)
        for t in range(*cells_of_leaf(leaf, walls.boxes, facets.shape[0])):
            along, cosine = hit(facets, t, x, way)
            if slack < along < length - slack and abs(cosine) > ALONG:
                return True
    return False
