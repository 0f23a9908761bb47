"""The distance between features of a boundary that do not meet, through the domain."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.distance import closest_on_facet, place_on_facet
from adaptsize._kernels.rays import ALONG, holds, is_blocked
from adaptsize._kernels.trees import DEPTH, Stack, Tree, cells_of_leaf, nearest_leaf
from adaptsize._kernels.vectors import cross, dot, minus, norm, triple, without

#: Numbers of a sector: two unit vectors along its sides, its unit outward normal, and its angle.
SECTOR = 10

# Lengths of unit vectors that differ by less are equal.
_EQUAL = 1e-9


class Elements(NamedTuple):
    """Corners (k = 1), segments of curves or triangles of faces.

    Parameters
    ----------
    tree : Tree
    owner : int32[m]
        The corner, curve or face of each.
    touched : int32[n_owners + 1], int32[...]
        Corners of each curve or face, ascending.
    """

    tree: Tree
    owner: np.ndarray
    touched: tuple[np.ndarray, np.ndarray]


class Queries(NamedTuple):
    """Points on features.

    Parameters
    ----------
    places : float64[n, 3]
    skipped : int32[n + 1], int32[...]
        Owners that are incident to the feature of each, ascending.
    ends : int32[n, 2]
        Corners at the ends of the curve of each, or -1.
    end_places : float64[n, 2, 3]
        Their places.
    sine : float
        An owner that touches one of the ends counts only below this share of the distance
        from that end.
    first_sector : int32[n + 1]
        The sectors of the facets around query r are ``first_sector[r]`` to ``first_sector[r
        + 1] - 1``.
    sectors : float64[..., SECTOR]
    """

    places: np.ndarray
    skipped: tuple[np.ndarray, np.ndarray]
    ends: np.ndarray
    end_places: np.ndarray
    sine: float
    first_sector: np.ndarray
    sectors: np.ndarray


@inner
def _side_of(queries, r, way):
    """Return on which side of the sectors around a query a direction lies: below 0 inside, 0 along.

    The closest point of the sectors, as infinite cones, decides: with the normal of its sector, or
    with the sum of the normals of those that share it, at the apex weighted by angles [1]_.

    References
    ----------
    .. [1] J. A. Baerentzen, H. Aanaes, "Signed distance computation using the angle weighted
       pseudonormal", IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253.
    """
    sectors = queries.sectors
    best, side = math.inf, 0.0
    for s in range(queries.first_sector[r], queries.first_sector[r + 1]):
        a, b, normal = triple(sectors, s, 0), triple(sectors, s, 3), triple(sectors, s, 6)
        height = dot(way, normal)
        p = without(way, height, normal)
        turn = dot(normal, cross(a, b))
        if (
            turn != 0.0
            and dot(p, p) > _EQUAL * _EQUAL
            and turn * dot(normal, cross(a, p)) >= 0.0
            and turn * dot(normal, cross(p, b)) >= 0.0
        ):
            if abs(height) < best - _EQUAL:
                best, side = abs(height), 0.0
            if abs(height) <= best + _EQUAL:
                side += height
            continue
        for k in range(2):
            along, weight = dot(way, triple(sectors, s, 3 * k)), 1.0
            if along <= _EQUAL:
                along, weight = 0.0, sectors[s, 9]
            q = without(way, along, triple(sectors, s, 3 * k))
            length = norm(q)
            if length < best - _EQUAL:
                best, side = length, 0.0
            if length <= best + _EQUAL:
                side += weight * dot(q, normal)
    return 0.0 if best <= ALONG else side


@inner
def _counts(elements, queries, r, t, x, length):
    """Return whether element t, at a distance from query r, belongs to no feature at its ends.

    Or else is so near that the features form no corner there.
    """
    for e in range(2):
        corner = queries.ends[r, e]
        if corner >= 0 and holds(elements.touched, np.int64(elements.owner[t]), corner):
            away = minus(queries.end_places[r, e], x)
            if not length < queries.sine * norm(away):
                return False
    return True


@kernel
def lower_separations(elements, queries, walls, part, distances):
    """Lower distances to those of features that are closer, and seen through the domain.

    Parameters
    ----------
    elements : Elements
    queries : Queries
    walls : FacetTree
    part : tuple of 2 int
        First and last (exclusive) of the queries to process.
    distances : float64[n]
        In/Out.
    """
    tree = elements.tree
    stack, node_stack = Stack(np.empty(DEPTH, np.int64), np.empty(DEPTH)), np.empty(DEPTH, np.int64)
    for r in range(part[0], part[1]):
        x = triple(queries.places, r, 0)
        stack.box[0], stack.bound[0] = 1, 0.0
        height = np.int64(1)
        while height > 0:
            limit = distances[r] * distances[r]
            leaf, height = nearest_leaf(tree.boxes, stack, height, limit, x)
            for t in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
                if holds(queries.skipped, r, elements.owner[t]):
                    continue
                weights = closest_on_facet(tree.points, tree.cells, t, x)[1]
                y = place_on_facet(tree.points, tree.cells, t, weights)
                length = norm(minus(y, x))
                if not walls.slack < length < distances[r]:
                    continue
                if not _counts(elements, queries, r, t, x, length):
                    continue
                way = ((y[0] - x[0]) / length, (y[1] - x[1]) / length, (y[2] - x[2]) / length)
                if _side_of(queries, r, way) > 0.0:
                    continue
                if not is_blocked(walls, x, way, length, node_stack):
                    distances[r] = length
