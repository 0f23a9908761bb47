"""Better sources near the one that a node has: descent over edges and triangles of the mesh."""

import numpy as np

from adaptsize._kernels.compiling import inner
from adaptsize._kernels.local import distance, minimum_on_edge
from adaptsize._kernels.source import (
    NONE,
    ascending,
    drop_zero_weights,
    has_own_bound,
    put_foot,
    source_of,
    value_from,
)

# A source must be better by more than rounding.
BETTER = 1.0 - 1e-13


@inner
def _slope_towards(state, axes, h0, g, j, h_foot, w):
    """Return the slope of the candidate of node j from the foot of its source towards node w.

    The change of h0 plus g times the distance to j, times the distance of w; the foot is
    the last row of ``state``.
    """
    foot = state.shape[0] - 1
    to_j = distance(state, axes, foot, j)
    if to_j == 0.0:
        return 0.0
    along = 0.0
    for d in range(len(axes)):
        along += (state[j, d] - state[foot, d]) * (state[w, d] - state[foot, d])
    return h0[w] - h_foot - g * along / to_j


@inner
def _face_with(axes, nbr_ptr, nbr, cells, ring_ptr, ring, p, q, w):
    """Tell whether w, a neighbour of p, is one of q as well, in space in a cell of all three."""
    if len(axes) == 2:
        found = 0
        for entry in range(nbr_ptr[q], nbr_ptr[q + 1]):
            found += nbr[entry] == w
        return found > 0
    for place in range(ring_ptr[p], ring_ptr[p + 1]):
        c = np.int64(ring[place])
        found = 0
        for v in range(cells.shape[1]):
            if cells[c, v] == q or cells[c, v] == w:
                found += 1
        if found == 2:
            return True
    return False


@inner
def polish(state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, source, j, most):
    """Move the source of node j over neighbouring edges and triangles while that lowers j.

    Only where all nodes have their own ``h0``: there the data are linear.

    Parameters
    ----------
    state, axes
        See source.py.
    nbr_ptr, nbr, cells, ring_ptr, ring
        Neighbours of the nodes, and cells around them (in space only); see track.py.
    h0 : float64[n]
    g : float64
    source : int32[n, dim]
        The sources of the nodes.
    j : int
        A node.
    most : int
        Most moves.

    Returns
    -------
    value : float64
        The size that the best source found allows.
    p, q, r : int
        That source, ascending.
    l1, l2 : float64
        Weights of q and r.
    """
    p, q, r = source_of(source, axes, j)
    value = state[j, len(axes)]
    l1 = l2 = 0.0
    if r != NONE:
        if r < 0 or not has_own_bound(state, axes, h0, r):
            return value, p, q, r, l1, l2
        if not (has_own_bound(state, axes, h0, p) and has_own_bound(state, axes, h0, q)):
            return value, p, q, r, l1, l2
        value, l1, l2 = value_from(state, axes, g, j, p, q, r, h0[p], h0[q], h0[r])
    elif q >= 0 and has_own_bound(state, axes, h0, q):
        value, l1 = minimum_on_edge(state, axes, j, p, q, h0[p], h0[q], g)
    for _ in range(most):
        p, q, r, l1, l2 = drop_zero_weights(p, q, r, l1, l2)
        put_foot(state, axes, p, q, r, l1, l2)
        if r >= 0 or not has_own_bound(state, axes, h0, p):
            break
        if q >= 0 and not has_own_bound(state, axes, h0, q):
            break
        h_foot = h0[p]
        if q >= 0:
            h_foot += l1 * (h0[q] - h0[p])
        best, s0, s1, s2, m1, m2 = value, p, q, r, l1, l2
        for entry in range(nbr_ptr[p], nbr_ptr[p + 1]):
            w = np.int64(nbr[entry])
            if w == q or not has_own_bound(state, axes, h0, w):
                continue
            if _slope_towards(state, axes, h0, g, j, h_foot, w) >= 0.0:
                continue
            if q >= 0 and not _face_with(axes, nbr_ptr, nbr, cells, ring_ptr, ring, p, q, w):
                continue
            # In the plane the minimum over the triangle p, q, w is on its edges at w.
            turns = 2 if len(axes) == 2 and q >= 0 else 1
            for turn in range(turns):
                a, b, d = p if turn == 0 else q, w, NONE
                if len(axes) == 3 and q >= 0:
                    b, d = q, w
                a, b, d = ascending(a, b, d)
                h_d = h0[d] if d >= 0 else 0.0
                lower, n1, n2 = value_from(state, axes, g, j, a, b, d, h0[a], h0[b], h_d)
                if lower < best:
                    best, s0, s1, s2, m1, m2 = lower, a, b, d, n1, n2
        if not best < value * BETTER:
            break
        value, p, q, r, l1, l2 = best, s0, s1, s2, m1, m2
    return value, p, q, r, l1, l2
