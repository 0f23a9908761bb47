"""Which simplex of an octree's conforming subdivision a point lies in, found by descent."""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.octree import find_node, has_halved_edge


@inner
def _coordinate(index, count, lower, upper):
    """Return the coordinate of a lattice plane, by the very operations of `Octree.points`."""
    share = index / count
    return lower * (1.0 - share) + upper * share


@kernel
def fill_places(points, lower, upper, counts, places, distances):
    """Fill lattice coordinates of the closest points of the box, and the distances to them.

    Coordinates of lattice planes, as `_coordinate` gives them, become whole numbers, so that
    a point on a face or at a node lies there exactly.

    Parameters
    ----------
    points : float64[n, dim]
    lower, upper : float64[dim]
    counts : int64[dim]
        Number of intervals of the lattice.
    places : float64[n, dim]
        Out: from 0 to ``counts``.
    distances : float64[n]
        Out: 0 in the box.
    """
    dim = points.shape[1]
    for q in range(points.shape[0]):
        distance = 0.0
        for d in range(dim):
            x = min(max(points[q, d], lower[d]), upper[d])
            distance = math.hypot(distance, points[q, d] - x)
            place = (x - lower[d]) / (upper[d] - lower[d]) * counts[d]
            nearest = np.int64(place + 0.5)
            if _coordinate(nearest, counts[d], lower[d], upper[d]) == x:
                place = np.float64(nearest)
            places[q, d] = min(place, np.float64(counts[d]))
        distances[q] = distance


@inner
def _on_edge(keys, numbers, base, step, size, u):
    """Return the nodes and weights around place u on an edge of the square, halved or not."""
    while size > 1 and find_node(keys, numbers, base + (size >> 1) * step) >= 0:
        size >>= 1
        if u >= size:
            u -= size
            base += size * step
    share = min(max(u / size, 0.0), 1.0)
    first = find_node(keys, numbers, base)
    second = find_node(keys, numbers, base + size * step)
    return first, second, 1.0 - share, share


@inner
def _in_square(tables, base, a, b, size, odd, u, v):
    """Return the triangle around a place in a square, cut as by `_cut_square`: nodes, weights.

    ``u`` and ``v`` are coordinates along the axes with strides ``a`` and ``b``, 0 to size.
    """
    keys, numbers, centre_keys, centre_numbers = tables
    half = size >> 1
    while half > 0 and find_node(keys, numbers, base + half * (a + b)) >= 0:
        right, up = u >= half, v >= half
        if right:
            u -= half
            base += half * a
        if up:
            v -= half
            base += half * b
        odd = 1 if right != up else 0
        size = half
        half >>= 1
    if has_halved_edge(keys, numbers, base, a, b, size):
        centre = find_node(centre_keys, centre_numbers, base + half * (a + b))
        du, dv = u - half, v - half
        far = max(abs(du), abs(dv))
        if far == 0.0:
            return centre, centre, centre, 1.0, 0.0, 0.0
        # From the centre through the place to the edge.
        out = far / half
        across_a = abs(du) >= abs(dv)
        step = b if across_a else a
        if (du if across_a else dv) > 0.0:
            base += size * (a if across_a else b)
        along = (dv if across_a else du) / out + half
        p, q, w_p, w_q = _on_edge(keys, numbers, base, step, size, along)
        out = min(out, 1.0)
        return centre, p, q, 1.0 - out, w_p * out, w_q * out
    # In coordinates from the even corner, the diagonal is u == v.
    u, v = u / size, v / size
    if odd:
        u = 1.0 - u
        base += size * a
        a = -a
    first = find_node(keys, numbers, base)
    side = find_node(keys, numbers, base + size * (a if u >= v else b))
    last = find_node(keys, numbers, base + size * (a + b))
    u, v = max(u, v), min(u, v)
    return first, side, last, 1.0 - u, u - v, v


@inner
def _in_plain_leaf(corners, leaf, even, u, nodes, weights, q):
    """Fill nodes and weights in a leaf cut as by `_cut_along_diagonals`.

    The place ``u`` (float64[3], 0 to 1, measured from corner ``even``; scratch) is sorted:
    the path from corner to corner takes the axis of the largest coordinate first.
    """
    dim = nodes.shape[1] - 1
    corner = even
    nodes[q, 0] = corners[leaf, corner]
    before = 1.0
    for step in range(dim):
        axis = 0
        for d in range(1, dim):
            if u[d] > u[axis]:
                axis = d
        weights[q, step] = before - u[axis]
        before = u[axis]
        u[axis] = -1.0
        corner ^= 1 << (dim - 1 - axis)
        nodes[q, step + 1] = corners[leaf, corner]
    weights[q, dim] = before


@kernel
def fill_weights(
    places, leaves, indices, levels, strides, corners, hanging, leaf_centres, tables, nodes, weights
):
    """Fill the nodes of the simplex that holds each place, and its barycentric coordinates.

    Parameters
    ----------
    places : float64[n, dim]
        Lattice coordinates.
    leaves : int32[n]
        Leaf that holds each place.
    indices, levels, strides, corners, hanging, tables
        As in `adaptsize._kernels.octree.cut_leaves`.
    leaf_centres : int32[n_leaves]
        Node at the centre of each leaf of an octree with hanging nodes.
    nodes : int32[n, dim + 1]
        Out.
    weights : float64[n, dim + 1]
        Out: >= 0.
    """
    dim = places.shape[1]
    u = np.empty(3)
    for q in range(places.shape[0]):
        leaf = leaves[q]
        size = np.int64(1) << levels[leaf]
        base = np.int64(0)
        even = np.int64(0)
        for d in range(dim):
            base += indices[leaf, d] * strides[d]
            even = (even << 1) | ((indices[leaf, d] >> levels[leaf]) & 1)
            u[d] = min(max(places[q, d] - indices[leaf, d], 0.0), np.float64(size))
        if not hanging[leaf]:
            for d in range(dim):
                u[d] /= size
                if (even >> (dim - 1 - d)) & 1:
                    u[d] = 1.0 - u[d]
            _in_plain_leaf(corners, leaf, even, u, nodes, weights, q)
            continue
        axis = 2  # a quadtree's leaf counts as a face across a third axis
        out = 1.0
        if dim == 3:
            # From the centre through the place to a face.
            half = size >> 1
            for d in range(2):
                if abs(u[d] - half) > abs(u[axis] - half):
                    axis = d
            out = min(abs(u[axis] - half) / half, 1.0)
            if u[axis] > half:
                base += size * strides[axis]
            for d in range(3):
                place = (u[d] - half) / out + half if out > 0.0 else np.float64(half)
                u[d] = min(max(place, 0.0), np.float64(size))
            nodes[q, 3] = leaf_centres[leaf]
            weights[q, 3] = 1.0 - out
        i, j = (axis + 1) % 3, (axis + 2) % 3
        odd = ((even >> (dim - 1 - i)) ^ (even >> (dim - 1 - j))) & 1
        n_0, n_1, n_2, w_0, w_1, w_2 = _in_square(
            tables, base, strides[i], strides[j], size, odd, u[i], u[j]
        )
        nodes[q, 0], nodes[q, 1], nodes[q, 2] = n_0, n_1, n_2
        weights[q, 0], weights[q, 1], weights[q, 2] = w_0 * out, w_1 * out, w_2 * out
