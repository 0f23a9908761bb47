"""Source tracking on simplices: sizes straight from where they come from.

Every node carries its *source*, the vertex, edge or triangle of the mesh that bounds
its size (see source.py), and hands it on along the edges of the mesh.  The candidate of the
receiving node is the Hopf-Lax value of the source itself, however far away that is, so that no
error adds up on the way.

``axes`` and ``others`` are tuples of which only the length counts (embedding dimension;
nodes of a cell less one), see local.py.
"""

import math

import numpy as np

from adaptsize._kernels.bends import along_creases, reach
from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local import distance
from adaptsize._kernels.polish import BETTER, polish
from adaptsize._kernels.source import (
    BEND,
    NONE,
    drop_zero_weights,
    others_in_cell,
    set_source,
    sizes_of,
    source_of,
    value_from,
)
from adaptsize._kernels.visibility import sees, sees_past_its_cells


@kernel
def compact_neighbours(others, star_ptr, star, mark, nbr_ptr):
    """Turn the stars of the nodes into lists of different neighbours, in place.

    Parameters
    ----------
    others : tuple of length k - 1
    star_ptr : int64[n + 1]
        Stars (see `adaptsize._kernels.march.fill_stars`).
    star : int32[m * k * (k - 1)]
        In/Out: the star, flat; the neighbours of i are then
        ``star[nbr_ptr[i]:nbr_ptr[i + 1]]``.
    mark : int32[n]
        In/Out: work space, anything negative.
    nbr_ptr : int64[n + 1]
        Out.
    """
    width = len(others)
    free = 0
    for i in range(star_ptr.shape[0] - 1):
        nbr_ptr[i] = free
        for place in range(star_ptr[i] * width, star_ptr[i + 1] * width):
            j = star[place]
            if mark[j] != i:
                mark[j] = i
                star[free] = j  # never ahead of what is still to be read
                free += 1
    nbr_ptr[star_ptr.shape[0] - 1] = free


@kernel
def start_from_cells(axes, cells, h0, g, faces, keep, state, source):
    """Give every node the best source among the vertices and faces of its cells.

    Parameters
    ----------
    axes : tuple of length dim
    cells : int32[m, dim + 1]
    h0 : float64[n]
        Bounds, inf allowed.
    g : float64
    faces : bool
        Whether edges and triangles are sources too, or nodes only.
    keep : float64
        A candidate counts if it is below ``keep`` times the present size.
    state, source
        In/Out: sizes h0 and sources themselves; then lowered.

    Returns
    -------
    bool
        Whether two neighbours have finite bounds: if not, polishing has nothing to try.
    """
    dim = len(axes)
    dense = False
    for c in range(cells.shape[0]):
        least = math.inf
        finite = 0
        for v in range(cells.shape[1]):
            if h0[cells[c, v]] < math.inf:
                finite += 1
                least = min(least, h0[cells[c, v]])
        if finite == 0:
            continue
        dense = dense or finite > 1
        for v in range(cells.shape[1]):
            k = np.int64(cells[c, v])
            if h0[k] <= least:
                continue
            if not faces or finite == 1:
                for w in range(cells.shape[1]):
                    j = np.int64(cells[c, w])
                    if h0[j] < state[k, dim]:
                        value = h0[j] + g * distance(state, axes, k, j)
                        if value < state[k, dim] * keep:
                            state[k, dim] = value
                            set_source(source, k, j, NONE, NONE)
                continue
            p, q, r = others_in_cell(cells, c, k, h0)
            h_q = h0[q] if q >= 0 else 0.0
            h_r = h0[r] if r >= 0 else 0.0
            value, l1, l2 = value_from(state, axes, g, k, p, q, r, h0[p], h_q, h_r)
            if value < state[k, dim] * keep:
                state[k, dim] = value
                p, q, r, l1, l2 = drop_zero_weights(p, q, r, l1, l2)
                set_source(source, k, p, q, r)
    return dense


@kernel
def push_lowered(state, h0, key, node, place, size):
    """Put the nodes whose size is below ``h0`` into the heap (see heap.py)."""
    dim = state.shape[1] - 1
    for k in range(h0.shape[0]):
        if state[k, dim] < h0[k]:
            push_or_decrease(key, node, place, size, k, state[k, dim])


@inner
def _touches(source, axes, k, p, q, r):
    """Tell whether the source of node k has a node in common with (p, q, r)."""
    found = False
    for v in range(len(axes)):
        i = source[k, v]
        found = found or (i >= 0 and (i in (p, q, r)))
    return found


@kernel
def track(
    state,
    axes,
    nbr_ptr,
    nbr,
    cells,
    ring_ptr,
    ring,
    crease_ptr,
    crease,
    patch,
    clearance,
    outward,
    h0,
    g,
    source,
    refused,
    bent,
    key,
    node,
    place,
    size,
    contested,
    hidden,
    straight,
    moves,
    keep,
    max_pops,
):
    """Hand sources on along the edges of the mesh, in order of size; at most ``max_pops`` nodes.

    Parameters
    ----------
    state : float64[n + 1, dim + 1]
        In/Out (see source.py).
    axes : tuple of length dim
    nbr_ptr : int64[n + 1]
    nbr : int32[...]
        Neighbours of the nodes (see `compact_neighbours`).
    cells : int32[m, dim + 1]
    ring_ptr : int64[n + 1]
    ring : int32[m * (dim + 1)]
        Cells around the nodes; used in space, and if something is hidden.
    crease_ptr, crease : int32[n + 1], int32[...]
        For each node the other ends of the reflex edges, in the plane of the edges of the
        boundary; used if something is hidden.
    patch : int32[n]
        Piece of the boundary (see visibility.py); used if something is hidden.
    clearance : float64[n] or float64[0]
        Lower bounds of the distances from the boundary (see visibility.py).
    outward : float64[n, 3]
        At nodes of the boundary the unit vector that halves the outer angle, and the cosine of
        half that angle; 0 at others; used in the plane if something is hidden.
    h0 : float64[n]
    g : float64
    source : int32[n, dim]
        In/Out.
    refused : int32[n + 1, dim]
        In/Out: the last source that each node did not see, and the boundary facet that hid
        the last one (see visibility.py); used if something is hidden.
    bent : float64[n, 7]
        In/Out: where the paths that bend on a crease come from, a point and the size there, and
        the nodes of that source (see bends.py); used as creases are.
    key, node, place, size
        In/Out: the heap (see heap.py).
    contested : uint8[n]
        In/Out: 1 is set for nodes that refused a source because theirs, which does not touch it, is
        better.  2 is set by the caller for nodes in the heap whose sources have been polished.
    hidden : bool
        Whether straight lines may leave the mesh.
    straight : bool
        False hands on no sources: sizes along edges only.
    moves : int
        Most moves in polishing; 0 leaves it out.
    keep : float64
        A candidate counts if it is below ``keep`` times the present size.
    max_pops : int

    Returns
    -------
    int
        Number of nodes taken; less than ``max_pops`` if the heap is empty.
    """
    dim = len(axes)
    pops = 0
    while size[0] > 0 and pops < max_pops:
        j = np.int64(pop(key, node, place, size))
        pops += 1
        if contested[j] >= 2:
            contested[j] -= 2
        elif moves > 0:
            value, p, q, r, l1, l2 = polish(
                state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, source, j, moves
            )
            if value < state[j, dim] * BETTER and (
                not hidden
                or sees(
                    state,
                    axes,
                    cells,
                    ring_ptr,
                    ring,
                    patch,
                    clearance,
                    h0,
                    source,
                    refused,
                    j,
                    p,
                    q,
                    r,
                    l1,
                    l2,
                )
            ):
                state[j, dim] = value
                set_source(source, j, p, q, r)
        h_j = state[j, dim]
        p, q, r = source_of(source, axes, j)
        if not straight:
            p, q, r = j, NONE, NONE
        u_p, u_q, u_r = sizes_of(state, axes, h0, p, q, r)
        # A node below h_j may still be lowered by the source of j, but hardly ever: for
        # one node it is cheap to try, for an edge it is not.
        least = u_p if q < 0 else h_j
        for entry in range(nbr_ptr[j], nbr_ptr[j + 1]):
            k = np.int64(nbr[entry])
            h_k = state[k, dim]
            if h_k <= least:
                continue
            l1 = l2 = 0.0
            s0, s1, s2 = p, q, r
            if q < 0:
                value = u_p + g * distance(state, axes, k, p)
            elif len(axes) == 3 and r == BEND:
                value, s0, s1, l1 = along_creases(
                    state,
                    crease_ptr,
                    crease,
                    k,
                    p,
                    q,
                    bent[j, 0],
                    bent[j, 1],
                    bent[j, 2],
                    bent[j, 3],
                    g,
                )
                if s1 < 0:
                    s2 = NONE
                    value = state[s0, dim] + g * distance(state, axes, k, s0)
            else:
                value, l1, l2 = value_from(state, axes, g, k, p, q, r, u_p, u_q, u_r)
            if value >= h_k * keep:
                if value > h_k and not _touches(source, axes, k, p, q, r):
                    contested[k] |= 1
                continue
            if (
                hidden
                and (p != j or q >= 0)
                and not sees_past_its_cells(
                    state, axes, cells, ring_ptr, ring, patch, h0, source, k, s0, s1, s2, l1, l2
                )
            ):
                value = reach(
                    state,
                    axes,
                    nbr_ptr,
                    nbr,
                    cells,
                    ring_ptr,
                    ring,
                    patch,
                    clearance,
                    outward,
                    crease_ptr,
                    crease,
                    h0,
                    g,
                    source,
                    refused,
                    bent,
                    j,
                    k,
                    s0,
                    s1,
                    s2,
                    l1,
                    l2,
                    value,
                    keep,
                )
                if value >= h_k * keep:
                    continue
            else:
                set_source(source, k, s0, s1, s2)
                if len(axes) == 3 and s2 == BEND:
                    for d in range(7):
                        bent[k, d] = bent[j, d]
            state[k, dim] = value
            contested[k] &= 1
            push_or_decrease(key, node, place, size, k, value)
    return pops


@kernel
def polish_again(
    state,
    axes,
    nbr_ptr,
    nbr,
    cells,
    ring_ptr,
    ring,
    patch,
    clearance,
    h0,
    g,
    source,
    refused,
    key,
    node,
    place,
    size,
    nodes,
    hidden,
    moves,
):
    """Look for better sources next to those of some nodes, and queue the nodes that find one.

    Parameters
    ----------
    nodes : int32[m]
    others
        As for `track`.
    """
    dim = len(axes)
    for index in range(nodes.shape[0]):
        j = np.int64(nodes[index])
        value, p, q, r, l1, l2 = polish(
            state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, source, j, moves
        )
        if value < state[j, dim] * BETTER and (
            not hidden
            or sees(
                state,
                axes,
                cells,
                ring_ptr,
                ring,
                patch,
                clearance,
                h0,
                source,
                refused,
                j,
                p,
                q,
                r,
                l1,
                l2,
            )
        ):
            state[j, dim] = value
            set_source(source, j, p, q, r)
            push_or_decrease(key, node, place, size, j, value)


@kernel
def offer_once_more(
    state,
    axes,
    nbr_ptr,
    nbr,
    cells,
    ring_ptr,
    ring,
    crease_ptr,
    crease,
    patch,
    clearance,
    outward,
    h0,
    g,
    source,
    refused,
    bent,
    key,
    node,
    place,
    size,
    contested,
    hidden,
    keep,
    alone,
):
    """Offer the sources that a node refused to the nodes behind it.

    The nodes served by a source need not be connected by edges: a node in between may
    belong to another source.  So the neighbours of every contested node are offered the
    sources of all its neighbours.  Those that are lowered go into the heap.

    Parameters
    ----------
    As for `track`; ``contested`` is cleared.
    alone : int32[n, dim]
        Every node as its own source; used if something is hidden.  Sources are offered over two
        edges here, so that paths on both sides of a hole would certify that lines go through it.

    Returns
    -------
    int
        Number of times that a node was lowered.
    """
    dim = len(axes)
    lowered = 0
    for i in range(contested.shape[0]):
        if contested[i] == 0:
            continue
        contested[i] = 0
        for entry in range(nbr_ptr[i], nbr_ptr[i + 1]):
            j = np.int64(nbr[entry])
            p, q, r = source_of(source, axes, j)
            offered = _touches(source, axes, i, p, q, r)
            for before in range(nbr_ptr[i], entry):
                m = nbr[before]
                same = source[m, 0] == p and source[m, 1] == q
                offered = offered or (same and (len(axes) == 2 or source[m, 2] == r))
            if offered:
                continue
            if len(axes) == 3 and r == BEND:
                continue
            u_p, u_q, u_r = sizes_of(state, axes, h0, p, q, r)
            for other in range(nbr_ptr[i], nbr_ptr[i + 1]):
                k = np.int64(nbr[other])
                value, l1, l2 = value_from(state, axes, g, k, p, q, r, u_p, u_q, u_r)
                if value >= state[k, dim] * keep:
                    continue
                if not hidden or sees(
                    state,
                    axes,
                    cells,
                    ring_ptr,
                    ring,
                    patch,
                    clearance,
                    h0,
                    alone,
                    refused,
                    k,
                    p,
                    q,
                    r,
                    l1,
                    l2,
                ):
                    set_source(source, k, p, q, r)
                    state[k, dim] = value
                    push_or_decrease(key, node, place, size, k, value)
                    lowered += 1
    return lowered


@kernel
def largest_edge_excess(state, axes, nbr_ptr, nbr, g):
    """Return by how much a size is above what its neighbours allow, relative to it, at most."""
    dim = len(axes)
    largest = 0.0
    for i in range(state.shape[0] - 1):
        h_i = state[i, dim]
        for entry in range(nbr_ptr[i], nbr_ptr[i + 1]):
            j = np.int64(nbr[entry])
            if state[j, dim] < h_i:
                if math.isinf(h_i):
                    return math.inf
                excess = h_i - state[j, dim] - g * distance(state, axes, i, j)
                largest = max(largest, excess / h_i)
    return largest
