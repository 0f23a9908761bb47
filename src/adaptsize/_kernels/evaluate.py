"""Sizes at any point, straight from the sources that nodes carry."""

import math

from numba import njit

from adaptsize._kernels.bends import over_crease
from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle


@njit(cache=True, nogil=True)
def evaluate_sources(points, axes, queries, carriers, source, sizes, bent, g, one_source, value):
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
    bent : float64[n, 4] or float64[0, 4]
        Where paths over creases come from, nan for other sources (see bends.py).
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
                same = True
                for v in range(source.shape[1]):
                    same = same and source[i, v] == source[first, v]
                if not same and i < bent.shape[0]:  # over two edges of one crease
                    same = True
                    for v in range(4):
                        same = same and bent[i, v] == bent[first, v]
                if not same:
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
            elif len(axes) == 3 and i < bent.shape[0] and not math.isnan(bent[i, 3]):
                found = over_crease(
                    points, x, a, b, bent[i, 0], bent[i, 1], bent[i, 2], bent[i, 3], g
                )[0]
            elif c < 0:
                found = minimum_on_edge(points, axes, x, a, b, sizes[i, 0], sizes[i, 1], g)[0]
            else:
                found = minimum_on_triangle(
                    points, axes, x, a, b, c, sizes[i, 0], sizes[i, 1], sizes[i, 2], g, True
                )[0]
            if found < least:
                least = found
        value[q] = least
