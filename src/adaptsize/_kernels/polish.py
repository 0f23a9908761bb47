"""Better sources near the one that a node has: descent over edges and triangles of the mesh."""

import numpy as np
from numba import njit

from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle
from adaptsize._kernels.source import drop_zero_weights, has_own_bound, put_foot, value_from

# A source must be better by more than rounding.
BETTER = 1.0 - 1e-13


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _leave_node(state, axes, nbr_ptr, nbr, h0, g, j, p, value):
    """Return the best of the edges at p for node j: value, other end or -1, its weight."""
    best, end, weight = value, -1, 0.0
    for entry in range(nbr_ptr[p], nbr_ptr[p + 1]):
        w = np.int64(nbr[entry])
        if (
            has_own_bound(state, axes, h0, w)
            and _slope_towards(state, axes, h0, g, j, h0[p], w) < 0.0
        ):
            lower, t = minimum_on_edge(state, axes, j, p, w, h0[p], h0[w], g)
            if lower < best:
                best, end, weight = lower, w, t
    return best, end, weight


@njit(cache=True, nogil=True)
def _leave_edge(state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, j, p, q, t, value):
    """Return the best of the triangles at the edge (p, q) for node j, whose foot is at t.

    Value, its source and weights; in the plane the minimum is on another edge of a triangle.
    """
    best, s0, s1, s2, m1, m2 = value, p, q, -1, t, 0.0
    h_foot = h0[p] + t * (h0[q] - h0[p])
    if len(axes) == 2:
        for entry in range(nbr_ptr[p], nbr_ptr[p + 1]):
            w = np.int64(nbr[entry])
            if w == q or not has_own_bound(state, axes, h0, w):
                continue
            if _slope_towards(state, axes, h0, g, j, h_foot, w) >= 0.0:
                continue
            for other in range(nbr_ptr[q], nbr_ptr[q + 1]):
                if nbr[other] == w:
                    for end in (p, q):
                        lower, m = minimum_on_edge(state, axes, j, end, w, h0[end], h0[w], g)
                        if lower < best:
                            best, s0, s1, m1 = lower, end, w, m
        return best, s0, s1, s2, m1, m2
    for place in range(ring_ptr[p], ring_ptr[p + 1]):
        c = np.int64(ring[place])
        with_q = False
        for v in range(cells.shape[1]):
            with_q = with_q or cells[c, v] == q
        if not with_q:
            continue
        for v in range(cells.shape[1]):
            w = np.int64(cells[c, v])
            if w in (p, q) or not has_own_bound(state, axes, h0, w):
                continue
            if _slope_towards(state, axes, h0, g, j, h_foot, w) < 0.0:
                lower, m, n = minimum_on_triangle(
                    state, axes, j, p, q, w, h0[p], h0[q], h0[w], g, True
                )
                if lower < best:
                    best, s0, s1, s2, m1, m2 = lower, p, q, w, m, n
    return best, s0, s1, s2, m1, m2


@njit(cache=True, nogil=True)
def polish(state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, j, p, q, r, value, most):
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
    j, p, q, r : int
        A node and its source.
    value : float64
        Its size.
    most : int
        Most moves.

    Returns
    -------
    value : float64
    p, q, r : int
        The last row of ``state`` is then the foot.
    l1, l2 : float64
    """
    l1 = l2 = 0.0
    if q >= 0:
        u_r = h0[r] if r >= 0 else 0.0
        value, l1, l2 = value_from(state, axes, g, j, p, q, r, h0[p], h0[q], u_r)
    for _ in range(most):
        p, q, r, l1, l2 = drop_zero_weights(p, q, r, l1, l2)
        put_foot(state, axes, p, q, r, l1, l2)
        if r >= 0 or not has_own_bound(state, axes, h0, p):
            break
        if q < 0:
            best, end, m1 = _leave_node(state, axes, nbr_ptr, nbr, h0, g, j, p, value)
            s0, s1, s2, m2 = p, end, -1, 0.0
        elif has_own_bound(state, axes, h0, q):
            best, s0, s1, s2, m1, m2 = _leave_edge(
                state, axes, nbr_ptr, nbr, cells, ring_ptr, ring, h0, g, j, p, q, l1, value
            )
        else:
            break
        if not best < value * BETTER:
            break
        value, p, q, r, l1, l2 = best, s0, s1, s2, m1, m2
    return value, p, q, r, l1, l2
