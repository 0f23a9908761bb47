"""Distances to facets on a grid: exact in a band around each facet, propagated beyond.

A facet is a point, a segment or a triangle.  Grids have three axes here, of one node where
there are fewer, and nodes are numbered row by row, the last axis fastest.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.distance import closest_on_facet, place_on_facet
from adaptsize._kernels.vectors import dot, minus, offset


class Features(NamedTuple):
    """Facets to which distances are measured.

    Parameters
    ----------
    points : float64[n, 3]
    facets : int32[m, k]
        K = 1, 2 or 3.
    corners : int32[m, k]
        The nodes of the facets, nodes at the same place counted as one.
    ring_ptr : int32[n + 1]
    ring : int32[...]
        Facets around each of these nodes; if they are points, the neighbours of each.
    """

    points: np.ndarray
    facets: np.ndarray
    corners: np.ndarray
    ring_ptr: np.ndarray
    ring: np.ndarray


class Nearest(NamedTuple):
    """The nearest facet of each node, as far as it is known.

    Parameters
    ----------
    distance : float64[n_nodes]
    facet : int32[n_nodes]
        -1 where none is known.
    """

    distance: np.ndarray
    facet: np.ndarray


class Queue(NamedTuple):
    """Nodes that wait, in buckets by their distance.

    Parameters
    ----------
    width : float
        Step of distance.
    first : int32[n_buckets]
        First node of each bucket, -1 if none; buckets are used in a circle.
    following : int32[n_nodes]
        Next node of the same bucket, -1 at its end; -2 for nodes not waiting.
    state : int64[2]
        Present bucket, number of waiting nodes; at first -1 and 0.
    """

    width: float
    first: np.ndarray
    following: np.ndarray
    state: np.ndarray


@inner
def _place_of(grid, i, j, k):
    """Return the place of a node."""
    lower, spacing = grid.lower, grid.spacing
    return lower[0] + i * spacing[0], lower[1] + j * spacing[1], lower[2] + k * spacing[2]


@kernel
def scan_facets(features, part, grid, reach, found):
    """Lower the distances of the nodes around each facet.

    Parameters
    ----------
    features : tuple of float64[n, 3], int32[m, k]
        Points and facets.  Short facets are cheapest: all nodes of a box around each are tested.
    part : tuple of 2 int
        First and last (exclusive) of the facets to scan.
    grid : GridFrame
    reach : float
        The largest distance.
    found : Nearest
        In/Out: the distances, at most the largest one, which are lowered; the facets that did so.
    """
    (points, facets), (distance, nearest) = features, found
    lower, spacing, shape = grid
    begin = [0, 0, 0]
    end = [0, 0, 0]
    width = facets.shape[1]
    for f in range(part[0], part[1]):
        radius = 0.0
        centre = [0.0, 0.0, 0.0]
        for v in range(width):
            for d in range(3):
                centre[d] += points[facets[f, v], d] / width
        for v in range(width):
            away2 = 0.0
            for d in range(3):
                away2 += (points[facets[f, v], d] - centre[d]) ** 2
            radius = max(radius, math.sqrt(away2))
        for d in range(3):
            low = high = points[facets[f, 0], d]
            for v in range(1, width):
                low = min(low, points[facets[f, v], d])
                high = max(high, points[facets[f, v], d])
            # Bounded before they become integers: facets may be far away.
            from_low = max((low - reach - lower[d]) / spacing[d], 0.0)
            to_high = min((high + reach - lower[d]) / spacing[d], shape[d] - 1.0)
            begin[d] = math.ceil(min(from_low, 1.0 * shape[d]))
            end[d] = math.floor(max(to_high, -1.0)) + 1
        for i in range(begin[0], end[0]):
            x = lower[0] + i * spacing[0]
            for j in range(begin[1], end[1]):
                y = lower[1] + j * spacing[1]
                across2 = (x - centre[0]) ** 2 + (y - centre[1]) ** 2
                along2 = (radius + reach) ** 2 - across2
                if along2 <= 0.0:
                    continue
                row = (i * shape[1] + j) * shape[2]
                along = math.sqrt(along2) / spacing[2]
                middle = (centre[2] - lower[2]) / spacing[2]
                from_k = max(begin[2], math.ceil(max(middle - along, 0.0)))
                to_k = min(end[2], math.floor(max(middle + along, -1.0)) + 1)
                for k in range(from_k, to_k):
                    z = lower[2] + k * spacing[2]
                    known = distance[row + k]
                    away2 = across2 + (z - centre[2]) ** 2
                    if away2 >= (radius + known) ** 2:
                        continue
                    found2 = closest_on_facet(points, facets, f, (x, y, z))[0]
                    if found2 < known * known:
                        distance[row + k] = math.sqrt(found2)
                        nearest[row + k] = f


@inner
def _nearest_around(features, f, x):
    """Walk from facet f over its neighbours to one of which no neighbour is nearer to x.

    With y the closest point of f, a facet that contains y has a nearer point if and only if
    a corner p of it has  (x - y) . (p - y) > 0.

    Returns
    -------
    int
        A facet.
    float
        Its squared distance.
    """
    points, facets, corners, ring_ptr, ring = features
    width = facets.shape[1]
    if width == 1:
        return _nearest_point_around(points, ring_ptr, ring, f, x)
    best = math.inf
    while True:
        best, (s, t, u) = closest_on_facet(points, facets, f, x)
        if s > 0.0 and t > 0.0 and (u > 0.0 or width == 2):
            return f, best
        y = place_on_facet(points, facets, f, (s, t, u))
        away = minus(x, y)
        # The nodes of f that y lies between: one, or two.
        a = corners[f, 0] if s > 0.0 else (corners[f, 1] if t > 0.0 else corners[f, width - 1])
        b = a
        if s > 0.0 and t > 0.0:
            b = corners[f, 1]
        elif u > 0.0 and s + t > 0.0:
            b = corners[f, 2]
        found = f
        for place in range(ring_ptr[a], ring_ptr[a + 1]):
            other = np.int64(ring[place])
            beside = b == a
            ahead = False
            for v in range(width):
                beside = beside or corners[other, v] == b
                p = facets[other, v]
                descent = away[0] * (points[p, 0] - y[0]) + away[1] * (points[p, 1] - y[1])
                descent += away[2] * (points[p, 2] - y[2])
                ahead = ahead or descent > 0.0
            if not (beside and ahead) or other == f:
                continue
            distance2 = closest_on_facet(points, facets, other, x)[0]
            if distance2 < best * (1.0 - 1e-13):
                best = distance2
                found = other
        if found == f:
            return f, best
        f = found


@inner
def _nearest_point_around(points, ring_ptr, ring, f, x):
    """Walk over points to one of which no neighbour is nearer to x."""
    best = math.inf
    while True:
        found = f
        for place in range(ring_ptr[f] - 1, ring_ptr[f + 1]):
            other = f if place < ring_ptr[f] else ring[place]
            gap = offset(points, other, x)
            distance2 = dot(gap, gap)
            if distance2 < best:
                best = distance2
                found = other
        if found == f:
            return f, best
        f = found


@kernel
def propagate_features(features, grid, found, queue, most):
    """Propagate the nearest facets from node to node.

    Nodes are accepted roughly in order of distance.  An accepted node searches from the facet
    that it received for the nearest facet around it, and passes that to its neighbours along the
    axes.  It is inserted again if a nearer facet reaches it later.

    Parameters
    ----------
    features : Features
    grid : GridFrame
    found : Nearest
        In/Out: the distance is inf where no facet is known.
    queue : Queue
        In/Out.
    most : int
        Return after that many accepted nodes.

    Returns
    -------
    int
        Number of accepted nodes; less than ``most`` at the end.
    """
    points, facets = features.points, features.facets
    shape, (distance, nearest) = grid.shape, found
    width, first, following, state = queue
    n1, n2 = shape[1], shape[2]
    n_buckets = first.shape[0]
    here, waiting = state
    strides = (n1 * n2, n2, 1)
    if here < 0:  # insert all nodes with a neighbour without a facet
        here = 0
        for node in range(distance.shape[0]):
            if nearest[node] < 0:
                continue
            at = (node // (n1 * n2), node // n2 % n1, node % n2)
            alone = False
            for a in range(3):
                alone = alone or (at[a] > 0 and nearest[node - strides[a]] < 0)
                alone = alone or (at[a] < shape[a] - 1 and nearest[node + strides[a]] < 0)
            if alone:
                # Those of a wide band do not fit into the circle of buckets.
                slot = min(int(distance[node] / width), n_buckets - 1)
                following[node] = first[slot]
                first[slot] = node
                waiting += 1
    accepted = 0
    while waiting > 0 and accepted < most:
        node = first[here % n_buckets]
        if node < 0:
            here += 1
            continue
        first[here % n_buckets] = following[node]
        following[node] = -2
        waiting -= 1
        accepted += 1
        at = (node // (n1 * n2), node // n2 % n1, node % n2)
        x = _place_of(grid, at[0], at[1], at[2])
        f, found2 = _nearest_around(features, np.int64(nearest[node]), x)
        reached = min(math.sqrt(found2), distance[node])
        distance[node], nearest[node] = reached, f
        for a in range(3):
            for side in range(-1, 2, 2):
                if at[a] + side < 0 or at[a] + side >= shape[a]:
                    continue
                other = node + side * strides[a]
                known = distance[other]
                if nearest[other] == f or known <= reached:
                    continue
                to = (side if a == 0 else 0, side if a == 1 else 0, side if a == 2 else 0)
                x = _place_of(grid, at[0] + to[0], at[1] + to[1], at[2] + to[2])
                found2 = closest_on_facet(points, facets, f, x)[0]
                if not found2 < known * known * (1.0 - 1e-14):
                    continue
                distance[other], nearest[other] = math.sqrt(found2), f
                if following[other] == -2:
                    slot = min(int(distance[other] / width), here + n_buckets - 1)
                    slot = max(here, slot) % n_buckets
                    following[other] = first[slot]
                    first[slot] = other
                    waiting += 1
    state[0], state[1] = here, waiting
    return accepted
