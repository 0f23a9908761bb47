"""Fast marching again after some bounds have changed: what to take back, where to begin.

The sizes before satisfy every local update.  Lower bounds need nothing but a place in the
heap.  Where a bound rose, the nodes whose size came from there have lost their *support*: no side
of a cell, without such nodes, allows as little as they have.  They are looked for in
waves, much as in dynamic shortest paths [1]_, put back to their bounds, and marched anew from
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
from adaptsize._kernels.heap import push_or_decrease
from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle
from adaptsize._kernels.source import BEND

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
    lost,
    found,
    count,
    suspect,
    waiting,
    ends,
    most,
):
    """Find the nodes that no bound and no node that is not lost supports.

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
    lost : bool[n]
        In/Out: the nodes found.
    found : int32[n]
        In/Out: their list.
    count : int
        Its length before.
    suspect : int32[n]
        In/Out: nodes to look at, in a circle; first those whose bounds rose, by size.
    waiting : bool[n]
        In/Out: whether a node is among them.
    ends : int64[2]
        In/Out: the first of them, and how many there are.
    most : int
        Return after that many, so that the caller can report and be interrupted.

    Returns
    -------
    int
        Length of the list; ``ends[1]`` is 0 at the end.
    """
    n = suspect.shape[0]
    looked = 0
    first, left = ends
    while left > 0 and looked < most:
        k = suspect[first]
        first = first + 1 if first + 1 < n else 0
        left -= 1
        looked += 1
        waiting[k] = False
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
                if not lost[i] and not waiting[i] and h[i] < h0[i]:
                    waiting[i] = True
                    last = first + left
                    suspect[last if last < n else last - n] = i
                    left += 1
    ends[0] = first
    ends[1] = left
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
    key, node, place, size
        In/Out: the heap (see heap.py).
    found : int32[m]
        The lost nodes.
    others
        As for `find_lost`; ``h`` is In/Out.
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


@kernel
def find_dependents(source, bent, changed, fate):
    """Find the nodes whose tracked size goes back to a changed bound.

    Parameters
    ----------
    source : int32[n, dim]
        Sources, as in `adaptsize._kernels.track.track`.
    bent : float64[n, 7] or float64[1, 7]
    changed : bool[n]
        Whether the bound of a node is another one.
    fate : uint8[n]
        In/Out: 0 before; then 2 if the size goes back to a changed bound, else 1.
    """
    n, width = source.shape
    for k in range(n):
        # Along single nodes, which are bends, to a bound, an edge, a face or what is known.
        i = k
        found = 2
        for _ in range(n):
            if fate[i] > 0:
                found = fate[i]
                break
            p = source[i, 0]
            q = source[i, 1] if width > 1 else -1
            r = source[i, 2] if width > 2 else -1
            if r == BEND:
                p, q, r = int(bent[i, 4]), int(bent[i, 5]), int(bent[i, 6])
            if q < 0 and p != i:
                i = p
                continue
            hit = changed[p] or (q >= 0 and changed[q]) or (r >= 0 and changed[r])
            found = 2 if hit else 1
            break
        last = i
        i = k
        fate[last] = found
        while i != last:
            fate[i] = found
            p = source[i, 0]
            if width > 2 and source[i, 2] == BEND:
                p = int(bent[i, 4])
            i = p


@kernel
def find_served_from(source, marks, fate, found):
    """List the nodes whose source has a marked node; without those of fate 2.

    Parameters
    ----------
    source, fate
        As in `find_dependents`.
    marks : bool[n]
    found : int32[n]
        Out.

    Returns
    -------
    int
        Their number.
    """
    count = 0
    for k in range(source.shape[0]):
        if fate[k] == 2 or source[k, 0] == k:
            continue
        hit = False
        for v in range(source.shape[1]):
            hit = hit or (source[k, v] >= 0 and marks[source[k, v]])
        if hit:
            found[count] = k
            count += 1
    return count


@kernel
def cells_around(ring_ptr, ring, nodes, cell_marks, node_marks, cells, near):
    """List the cells around nodes, and mark the nodes of these cells.

    Parameters
    ----------
    ring_ptr, ring : int64[n + 1], int32[...]
        Cells around each node.
    nodes : int32[m]
    cell_marks, node_marks : bool[n_cells], bool[n]
        In/Out: set for the cells and their nodes.
    cells : int32[n_cells, k]
    near : int32[n_cells]
        Out: the cells that were not marked before.

    Returns
    -------
    int
        Their number.
    """
    count = 0
    for index in range(nodes.shape[0]):
        for place in range(ring_ptr[nodes[index]], ring_ptr[nodes[index] + 1]):
            c = ring[place]
            if not cell_marks[c]:
                cell_marks[c] = True
                near[count] = c
                count += 1
                for v in range(cells.shape[1]):
                    node_marks[cells[c, v]] = True
    return count


@kernel
def queue_behind_lowered(state, axes, g, source, fell, keep, key, node, place, size):
    """Lower and queue the nodes whose source, a node, has a lower size than it handed on.

    Parameters
    ----------
    state, axes, g, source
        As in `adaptsize._kernels.track.track`.
    fell : bool[n]
        The nodes that may have been lowered.
    keep : float
    key, node, place, size
        In/Out: the heap (see heap.py).
    """
    dim = len(axes)
    for k in range(source.shape[0]):
        p = source[k, 0]
        if not fell[p] or p == k or source[k, 1] >= 0:
            continue
        value = state[p, dim] + g * distance(state, axes, k, p)
        if value < state[k, dim] * keep:
            state[k, dim] = value
            push_or_decrease(key, node, place, size, k, value)
