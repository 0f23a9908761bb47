"""Sizes that grow along the edges of a mesh only: shortest paths in its graph."""

import math

import numpy as np

from adaptsize._kernels.compiling import lean_kernel
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local_updates import distance


@lean_kernel
def march_edges(
    points,
    axes,
    others,
    star_ptr,
    star,
    owner,
    h,
    g,
    g_step,
    key,
    node,
    place,
    size,
    keep,
    until,
    max_pops,
):
    """Do as `march`, but along edges only: shortest paths in the graph of the mesh.

    Parameters and result as for `march`.
    """
    pops = 0
    while size[0] > 0 and key[0] <= until and pops < max_pops:
        j = pop(key, node, place, size)
        pops += 1
        for entry in range(star_ptr[j], star_ptr[j + 1]):
            g_here = g[owner[entry]] if g_step else g[0]
            for v in range(len(others)):
                k = np.int64(star[entry, v])
                if h[k] > h[j]:
                    value = h[j] + g_here * distance(points, axes, k, j)
                    if value < h[k] * keep:
                        h[k] = value
                        push_or_decrease(key, node, place, size, k, value)
    return pops


@lean_kernel
def sweep_edges(points, axes, cells, h, g, g_step, floor):
    """Do as `sweep_cells`, but along edges only."""
    floor[:] = math.inf
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            k = np.int64(cells[c, v])
            for w in range(cells.shape[1]):
                j = np.int64(cells[c, w])
                if h[j] < h[k]:
                    value = h[j] + g[c * g_step] * distance(points, axes, k, j)
                    floor[k] = min(floor[k], value)


@lean_kernel
def largest_edge_slope(points, axes, cells, h, g, g_step):
    """Return the largest (h_i - h_j) / (g |x_i - x_j|) over the edges of all cells.

    Parameters as for `sweep_cells`.  0 counts for 0/0 and for edges without two finite ends.
    """
    largest = 0.0
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            for w in range(v):
                i = np.int64(cells[c, v])
                j = np.int64(cells[c, w])
                rise = abs(h[i] - h[j])
                if rise > 0.0 and math.isfinite(rise):
                    run = g[c * g_step] * distance(points, axes, i, j)
                    largest = max(largest, rise / run if run > 0.0 else math.inf)
    return largest
