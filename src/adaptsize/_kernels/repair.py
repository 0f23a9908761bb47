"""Fast marching again after some bounds have changed: what to take back, where to begin.

The sizes before satisfy every local update.  Lower bounds need nothing but a place in the
heap.  Where a bound rose, the nodes whose size came from there have lost their *support*: no side
of a cell, without such nodes, allows as little as they have.  They are looked for in order of
size, as in dynamic shortest paths [1]_, put back to their bounds, and marched anew from
their surroundings.

Meshes come as stars, see march.py; ``axes`` and ``others`` are tuples of which only the length
counts.

References
----------
.. [1] G. Ramalingam, T. Reps, "An incremental algorithm for a generalization of the
   shortest-path problem", J. Algorithms 21 (1996) 267-305.
"""

import math

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle

# A side supports a node whose size exceeds what it allows by rounding at most.
SUPPORTED = 1.0 + 2e-14

# It does so from a smaller size: nodes of one size, at no distance from each other or where
# g is 0, would support each other for ever.
LOWER = 1.0 - 1e-15


@inner
def _offer(points, axes, others, star, entry, k, h, lost, g, edges):
    """Return the size that a star entry allows at node k, and the size at the place it comes from.

    Without the nodes that are ``lost``; inf, inf if none is left that is below node k.
    """
    a = b = d = -1
    below = False
    for v in range(len(others)):
        i = star[entry, v]
        if lost[i] or math.isinf(h[i]):
            continue
        below = below or h[i] < h[k]
        if a < 0:
            a = i
        elif b < 0:
            b = i
        else:
            d = i
    if not below:
        return math.inf, math.inf
    value, least = h[a] + g * distance(points, axes, k, a), h[a]
    if b < 0:
        return value, least
    if edges:
        for i in (b, d):
            if i >= 0 and h[i] + g * distance(points, axes, k, i) < value:
                value, least = h[i] + g * distance(points, axes, k, i), h[i]
        return value, least
    if d < 0:
        value, t = minimum_on_edge(points, axes, k, a, b, h[a], h[b], g)
        return value, h[a] + t * (h[b] - h[a])
    value, s, t = minimum_on_triangle(points, axes, k, a, b, d, h[a], h[b], h[d], g, True)
    return value, h[a] + s * (h[b] - h[a]) + t * (h[d] - h[a])


@kernel
def find_lost(
    points,
    axes,
    others,
    star_ptr,
    star,
    owner,
    h,
    h0,
    g,
    g_step,
    edges,
    key,
    node,
    place,
    size,
    lost,
    found,
    count,
    max_pops,
):
    """Find the nodes that no bound and no node that is not lost supports; at most ``max_pops``.

    Parameters
    ----------
    points : float64[n, dim]
    axes, others : tuples of length dim, k - 1
    star_ptr, star, owner
        See `adaptsize._kernels.march.fill_stars`.
    h : float64[n]
        Sizes before, lowered to ``h0`` where that is below.
    h0 : float64[n]
        Bounds now.
    g, g_step
        Gradient limit per cell, as in `adaptsize._kernels.march.sweep_cells`.
    edges : bool
        Whether sizes go along edges only.
    key, node, place, size
        In/Out: the heap (see heap.py), first with the nodes whose bounds rose, by size.
    lost : bool[n]
        In/Out: the nodes found.
    found : int32[n]
        In/Out: their list.
    count : int
        Its length before.
    max_pops : int
        Return after that many, so that the caller can report and be interrupted.

    Returns
    -------
    int
        Length of the list; the heap is empty at the end.
    """
    pops = 0
    while size[0] > 0 and pops < max_pops:
        k = pop(key, node, place, size)
        pops += 1
        if lost[k] or h0[k] <= h[k]:
            continue
        supported = False
        for entry in range(star_ptr[k], star_ptr[k + 1]):
            g_here = g[owner[entry]] if g_step else g[0]
            value, origin = _offer(points, axes, others, star, entry, k, h, lost, g_here, edges)
            if value <= h[k] * SUPPORTED and origin < h[k] * LOWER:
                supported = True
                break
        if supported:
            continue
        lost[k] = True
        found[count] = k
        count += 1
        for entry in range(star_ptr[k], star_ptr[k + 1]):
            for v in range(len(others)):
                i = star[entry, v]
                # Behind an obtuse angle a node may depend on a larger one.
                if not lost[i] and h[i] < h0[i]:
                    push_or_decrease(key, node, place, size, i, h[i])
    return count


@kernel
def begin_again(
    points,
    axes,
    others,
    star_ptr,
    star,
    owner,
    h,
    h0,
    g,
    g_step,
    edges,
    key,
    node,
    place,
    size,
    lost,
    found,
):
    """Give lost nodes the least that their bounds and the nodes around allow, and queue them.

    Parameters
    ----------
    As for `find_lost`, the heap empty before; ``h`` is In/Out.
    found : int32[m]
        The lost nodes.
    """
    for place_in_list in range(found.shape[0]):
        k = found[place_in_list]
        least = h0[k]
        h[k] = math.inf
        for entry in range(star_ptr[k], star_ptr[k + 1]):
            g_here = g[owner[entry]] if g_step else g[0]
            value = _offer(points, axes, others, star, entry, k, h, lost, g_here, edges)[0]
            least = min(least, value)
        h[k] = least
        if least < math.inf:
            push_or_decrease(key, node, place, size, k, least)


@kernel
def queue(h, nodes, key, node, place, size):
    """Put nodes (int32[m]) of finite size into the heap (see heap.py)."""
    for place_in_list in range(nodes.shape[0]):
        k = nodes[place_in_list]
        if h[k] < math.inf:
            push_or_decrease(key, node, place, size, k, h[k])
