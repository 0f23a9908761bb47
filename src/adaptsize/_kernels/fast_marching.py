"""Label-correcting fast marching on simplices.

A node may be lowered after it has left the heap; it is then inserted again.  Hence no
angle condition is needed: when the heap is empty, every node satisfies every local
update, for cells of any shape.  A candidate is accepted only if it is below ``keep``
times the current size, where ``keep`` is 1 minus rounding or slightly smaller.

The drivers read the mesh as *stars*: for each node, the other vertices of its
cells in one contiguous block.

Meshes and limits are passed as tuples:

mesh : points float64[n, dim], axes, cells int32[m, k]
stars : points, axes, others, ring_ptr, ring, star (see `fill_stars`)
limit : g, g_step
    The gradient limit of cell c is ``g[c * g_step]``; g is float64[m] or float64[1], and g_step 1
    or 0.

``axes`` and ``others`` are tuples of which only the length counts (embedding dimension; vertices of
a star entry), see local_updates.py.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local_updates import (
    WITH_BC,
    WITHOUT_BC,
    distance,
    minimum_on_edge,
    minimum_on_triangle,
)


@lean_kernel
def fill_stars(cells, free, star):
    """List for each node the other vertices of its cells.

    Parameters
    ----------
    cells : int32[m, k]
    free : int32[n + 1]
        In: the first entry of each node, the ``ring_ptr`` of `topology.fill_rings`.  Out: the next.
    star : int32[m * k, k - 1]
        Out: in the order of ``ring``, which has the cells of a node in ascending order.
    """
    k = cells.shape[1]
    for c in range(cells.shape[0]):
        for v in range(k):
            entry = free[cells[c, v]]
            free[cells[c, v]] += 1
            for w in range(k - 1):
                star[entry, w] = cells[c, (v + 1 + w) % k]


@lean
def minimum_in_cell(mesh, c, k, h, g):
    """Return the size at vertex k of cell c allowed by all its other vertices, and its source.

    Parameters
    ----------
    mesh : tuple
    c, k : int
        Cell, and one of its nodes.
    h : float64[n]
        Sizes; vertices with inf are left out.
    g : float64
        Gradient limit in the cell.

    Returns
    -------
    value : float64
        inf if no other vertex is below ``h[k]``: none could lower it.
    i0, i1, i2 : int
        Vertices whose linear interpolant at the minimum is ``value`` less g times
        the distance; -1 where fewer are finite.
    l1, l2 : float64
        Weights of i1 and i2 there.
    """
    points, axes, cells = mesh
    a = b = d = np.int64(-1)  # callees would be compiled for a literal, too
    below = False
    for v in range(cells.shape[1]):
        i = np.int64(cells[c, v])
        if i == k or math.isinf(h[i]):
            continue
        below = below or h[i] < h[k]
        if a < 0:
            a = i
        elif b < 0:
            b = i
        else:
            d = i
    value = math.inf
    l1 = l2 = 0.0
    if below:
        if b < 0:
            value = h[a] + g * distance(points, axes, k, a)
        elif d < 0:
            value, l1 = minimum_on_edge(points, axes, k, (a, b), (h[a], h[b]), g)
        else:
            sizes = (h[a], h[b], h[d])
            value, l1, l2 = minimum_on_triangle(points, axes, k, (a, b, d), sizes, g, WITH_BC)
    return value, a, b, d, l1, l2


@lean_kernel
def sweep_cells(mesh, h, limit, sides, floor):
    """Fill the least candidate of every node over its cells, all from the same sizes.

    Parameters
    ----------
    mesh, limit : tuple
    h : float64[n]
        Sizes, inf allowed.
    sides : None or bool
        None if candidates come along edges only; the code for sides is then not compiled.
    floor : float64[n]
        Out: inf where no neighbour is below.
    """
    (points, axes, cells), (g, g_step) = mesh, limit
    floor[:] = math.inf
    for c in range(cells.shape[0]):
        least = math.inf
        for v in range(cells.shape[1]):
            least = min(least, h[cells[c, v]])
        if math.isinf(least):
            continue
        for v in range(cells.shape[1]):
            k = np.int64(cells[c, v])
            if sides is None:
                for w in range(cells.shape[1]):
                    j = np.int64(cells[c, w])
                    if h[j] < h[k]:
                        value = h[j] + g[c * g_step] * distance(points, axes, k, j)
                        floor[k] = min(floor[k], value)
            elif h[k] > least:
                value = minimum_in_cell(mesh, c, k, h, g[c * g_step])[0]
                floor[k] = min(floor[k], value)


@lean_kernel
def fill_policy(mesh, sizes, limit, value, policy):
    """Fill each node's best local update as a linear equation in the sizes it uses.

    Node k then has  value_k = sum_s weight[k, s] h[source[k, s]] + cost_k.

    Parameters
    ----------
    mesh, limit : tuple
    sizes : tuple of two float64[n]
        Sizes h and their upper bounds h0.
    value : float64[n]
        Out: the least of h0 and all local updates.
    policy : tuple of int32[n, 3], float64[n, 3], float64[n]
        Out: the nodes used, 0 where the weight is 0; the weights, zeros for nodes that keep h0;
        and the costs, g times the distance to the minimum, or h0.
    """
    cells, (h, h0), (g, g_step), (source, weight, cost) = mesh[2], sizes, limit, policy
    for k in range(value.shape[0]):  # array to array would need a copy, for overlaps
        value[k] = cost[k] = h0[k]
    source[:] = 0
    weight[:] = 0.0
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            k = np.int64(cells[c, v])
            found, a, b, d, l1, l2 = minimum_in_cell(mesh, c, k, h, g[c * g_step])
            if found < value[k]:
                value[k] = cost[k] = found
                nodes, shares, used = (a, b, d), (1.0 - l1 - l2, l1, l2), 0.0
                for s in range(3):
                    source[k, s], weight[k, s] = max(nodes[s], 0), shares[s]
                    if nodes[s] >= 0:
                        used += shares[s] * h[nodes[s]]
                cost[k] -= used


@lean
def _is_acute(points, axes, k, j, m):
    """Return whether the angle at k between j and m is below 90 degrees."""
    dot = 0.0
    for d in range(len(axes)):
        dot += (points[j, d] - points[k, d]) * (points[m, d] - points[k, d])
    return dot > 0.0


@lean_kernel
def march(stars, h, limit, sides, heap, stop):
    """Accept nodes in order of size and lower their neighbours.

    Along edges only, the sizes are those of shortest paths in the graph of the mesh.

    Parameters
    ----------
    stars, limit : tuple
    h : float64[n]
        In/Out.
    sides : None or bool
        As in `sweep_cells`.
    heap : Heap
        In/Out.
    stop : tuple of float, float, int
        The share of the size below which a candidate is accepted; nodes of larger size than the
        second number are left in the heap; return after so many nodes, so that the caller can
        report and be interrupted.

    Returns
    -------
    int
        Number of nodes accepted; less than the largest number if the heap is empty.
    """
    (points, axes, others, ring_ptr, ring, star), (g, g_step) = stars, limit
    (keep, until, max_pops), place = stop, heap.place
    pops = 0
    while heap.size[0] > 0 and heap.key[0] <= until and pops < max_pops:
        j = pop(heap)
        h_j = h[j]
        pops += 1
        for entry in range(ring_ptr[j], ring_ptr[j + 1]):
            g_here = g[ring[entry]] if g_step else g[0]
            for v in range(len(others)):
                k = np.int64(star[entry, v])
                h_k = h[k]
                if sides is None:
                    if h_k <= h_j:
                        continue
                    value = h_j + g_here * distance(points, axes, k, j)
                else:
                    # The side opposite to k is j with a and b.  Nodes in the heap are omitted:
                    # the side is processed again when they are accepted.  Parts of it without
                    # j were processed when their last node was accepted.
                    a = b = np.int64(-1)
                    for w in range(1, len(others)):
                        i = np.int64(star[entry, (v + w) % len(others)])
                        if place[i] < 0 and h[i] < math.inf:
                            if a < 0:
                                a = i
                            else:
                                b = i
                    if a < 0:
                        if h_k <= h_j:
                            continue
                        value = h_j + g_here * distance(points, axes, k, j)
                    else:
                        if h_k <= h_j:
                            # A minimum that uses j lies above h_j where the angles at k are acute.
                            if h_k <= h[a] and (b < 0 or h_k <= h[b]):
                                continue
                            if _is_acute(points, axes, k, j, a) and (
                                b < 0 or _is_acute(points, axes, k, j, b)
                            ):
                                continue
                        if b < 0:
                            value = minimum_on_edge(points, axes, k, (j, a), (h_j, h[a]), g_here)[0]
                        else:
                            value = minimum_on_triangle(
                                points, axes, k, (j, a, b), (h_j, h[a], h[b]), g_here, WITHOUT_BC
                            )[0]
                if value < h_k * keep:
                    h[k] = value
                    push_or_decrease(heap, k, value)
    return pops


@lean_kernel
def largest_edge_slope(mesh, h, limit):
    """Return the largest (h_i - h_j) / (g |x_i - x_j|) over the edges of all cells.

    0 counts for 0/0 and for edges without two finite ends.
    """
    (points, axes, cells), (g, g_step) = mesh, limit
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
