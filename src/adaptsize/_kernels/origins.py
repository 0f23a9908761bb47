"""The sources of sizes that come along edges of a mesh."""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel


@lean
def _is_earlier(by, along, other, before):
    """Return whether one neighbour explains a size better: the least size, then the number."""
    return other < 0 or along < before or (along == before and by < other)


@lean
def _explain(at, by, along, via, least, wave, last):
    """Let a node explain the size at another one if it does so best; return the end of ``wave``."""
    if via[at] < 0:
        wave[last] = at
        last += 1
    if _is_earlier(by, along, via[at], least[at]):
        via[at], least[at] = by, along
    return last


@lean_kernel
def name_along_edges(mesh, sizes, start, known, found, scratch):
    """Name the sources of nodes that are not known, and the last bends of their paths.

    A node takes the source of the node where its path starts, else that of the neighbour that
    allows the smallest size, of these the one of the smallest number.  This is repeated, beginning
    with the nodes of known sources.

    Parameters
    ----------
    mesh : tuple
        Points, cells, and the cells around each node as compressed rows.
    sizes : tuple of float64[n], float, float
        Limited sizes, g, and the share by which a path may exceed a size that it explains.
    start : int32[n]
        The node where the known part of the path starts; -1 if the source is known, or if the path
        runs along edges.
    known : bool[n]
        In/Out.
    found : tuple of int32[n, dim], float64[n, dim]
        In/Out: the nodes of the source, first that of a node that is its own; the last bend, nan if
        the path is straight.
    scratch : tuple of int32[n] four times, float64[n]
        Nodes in the order in which they become known; for each node the one that explains it, the
        first one that starts there, and the next of these; for each node the size that explains it.
    """
    points, cells, ring_ptr, ring = mesh
    (h, g, tie), (nodes, bend) = sizes, found
    wave, via, first, after, least = scratch
    via[:] = -1
    first[:] = -1
    begin, end = np.int64(0), np.int64(0)
    for x in range(h.shape[0]):
        if known[x]:
            wave[end] = x
            end += 1
        elif start[x] >= 0:
            after[x], first[start[x]] = first[start[x]], x
    while begin < end:
        last = end
        for k in range(begin, end):
            by = wave[k]
            x = first[by]
            while x >= 0:
                last = _explain(x, by, h[x], via, least, wave, last)
                x = after[x]
            for r in range(ring_ptr[by], ring_ptr[by + 1]):
                for v in range(cells.shape[1]):
                    x = cells[ring[r], v]
                    if known[x] or start[x] >= 0:
                        continue
                    square = 0.0
                    for d in range(points.shape[1]):
                        square += (points[x, d] - points[by, d]) ** 2
                    along = h[by] + g * math.sqrt(square)
                    if along <= h[x] * (1.0 + tie):
                        last = _explain(x, by, along, via, least, wave, last)
        for k in range(end, last):
            x, by = wave[k], via[wave[k]]
            known[x] = True
            keeps = start[x] >= 0 and not math.isnan(bend[x, 0])
            straight = nodes[by, 0] == by
            for d in range(points.shape[1]):
                if not keeps:
                    # From a node that keeps its bound the path does not bend there.
                    bend[x, d] = bend[by, d] if straight else points[by, d]
                nodes[x, d] = nodes[by, d]
        begin, end = end, last
