"""Sizes at any point, straight from the sources that nodes carry."""

import math

from numba import njit

from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle


@njit(cache=True, nogil=True)
def evaluate_sources(points, axes, queries, carriers, source, sizes, g, one_source, value):
    """Fill the least size that the sources of nearby nodes allow at each query.

    Parameters
    ----------
    points : float64[n + 1, dim]
        Nodes; the last row is work space.
    axes : tuple of length dim
    queries : float64[q, dim]
    carriers : int32[q, c]
        Nodes around each query whose sources are looked at; -1 for none.
    source : int32[n, s]
        Nodes of the source of each node, -1 where there are fewer.
    sizes : float64[n, s]
        Sizes at them.
    g : float64
    one_source : bool
        Leave queries alone (nan) whose carriers have different sources.
    value : float64[q]
        Out: inf without sources.
    """
    x = points.shape[0] - 1
    for q in range(queries.shape[0]):
        for d in range(len(axes)):
            points[x, d] = queries[q, d]
        least = math.inf
        first = -1
        for w in range(carriers.shape[1]):
            i = carriers[q, w]
            if i < 0:
                continue
            if first < 0:
                first = i
            elif one_source:
                for v in range(source.shape[1]):
                    if source[i, v] != source[first, v]:
                        least = math.nan
            a = source[i, 0]
            if a < 0 or math.isinf(sizes[i, 0]):
                continue
            b = c = -1
            if source.shape[1] > 1:
                b = source[i, 1]
            if source.shape[1] > 2:
                c = source[i, 2]
            if b < 0:
                found = sizes[i, 0] + g * distance(points, axes, x, a)
            elif c < 0:
                found = minimum_on_edge(points, axes, x, a, b, sizes[i, 0], sizes[i, 1], g)[0]
            else:
                found = minimum_on_triangle(
                    points, axes, x, a, b, c, sizes[i, 0], sizes[i, 1], sizes[i, 2], g, True
                )[0]
            if found < least:
                least = found
        value[q] = least
