"""Sources of sizes: a node, an edge or a triangle of a mesh with linear sizes.

``state`` is float64[n + 1, dim + 1]: the coordinates of each node and then its size, side by
side because they are needed together; the last row is work space for a point.  The source
(p, q, r) of a node is ascending, with -1 where there are fewer nodes.  That of one node has
the present size of the node; edges and triangles have the linear interpolant of ``h0``, but
for `BEND`.  Weights of a point are those of q and r.

``axes`` is a tuple of which only the length counts, the embedding dimension (see local.py).
"""

import math

import numpy as np
from numba import njit

from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle

# Nodes of less weight are no part of a source: rounding.
_NO_WEIGHT = 1e-14

# In place of r: an edge along which paths bend.  Its sizes are in ``bent``.
BEND = -2


@njit(cache=True, nogil=True)
def drop_zero_weights(p, q, r, l1, l2):
    """Return those nodes of a source whose weights are positive, and the weights of q and r."""
    l0 = 1.0 - l1 - l2
    if q < 0:
        return p, -1, -1, 0.0, 0.0
    if l0 <= _NO_WEIGHT:
        if r < 0 or l2 <= _NO_WEIGHT:
            return q, -1, -1, 0.0, 0.0
        if l1 <= _NO_WEIGHT:
            return r, -1, -1, 0.0, 0.0
        return q, r, -1, l2 / (l1 + l2), 0.0
    if l1 <= _NO_WEIGHT:
        if r < 0 or l2 <= _NO_WEIGHT:
            return p, -1, -1, 0.0, 0.0
        return p, r, -1, l2, 0.0
    if r < 0 or l2 <= _NO_WEIGHT:
        return p, q, -1, l1, 0.0
    return p, q, r, l1, l2


@njit(cache=True, nogil=True)
def ascending(p, q, r):
    """Return the nodes of a source in ascending order, -1 last."""
    if q >= 0 and q < p:
        p, q = q, p
    if r >= 0 and r < q:
        q, r = r, q
        if q < p:
            p, q = q, p
    return p, q, r


@njit(cache=True, nogil=True)
def set_source(source, k, p, q, r):
    source[k, 0] = p
    if source.shape[1] > 1:
        source[k, 1] = q
    if source.shape[1] > 2:
        source[k, 2] = r


@njit(cache=True, nogil=True)
def value_from(state, axes, g, k, p, q, r, u_p, u_q, u_r):
    """Return the size at node k allowed by linear sizes on (p, q, r), and the weights of q, r."""
    if q < 0:
        return u_p + g * distance(state, axes, k, p), 0.0, 0.0
    if r < 0:
        value, t = minimum_on_edge(state, axes, k, p, q, u_p, u_q, g)
        return value, t, 0.0
    return minimum_on_triangle(state, axes, k, p, q, r, u_p, u_q, u_r, g, True)


@njit(cache=True, nogil=True)
def put_foot(state, axes, p, q, r, l1, l2):
    """Write the point of weights l1 at q and l2 at r into the last row of ``state``."""
    foot = state.shape[0] - 1
    for d in range(len(axes)):
        x = state[p, d]
        if q >= 0:
            x += l1 * (state[q, d] - state[p, d])
        if r >= 0:
            x += l2 * (state[r, d] - state[p, d])
        state[foot, d] = x


@njit(cache=True, nogil=True)
def has_own_bound(state, axes, h0, i):
    """Tell whether node i keeps a finite bound."""
    return h0[i] < math.inf and state[i, len(axes)] == h0[i]


@njit(cache=True, nogil=True)
def sizes_of(state, axes, h0, bent, j, p, q, r):
    """Return the sizes at the nodes of the source (p, q, r) of node j."""
    if q < 0:
        return state[p, len(axes)], 0.0, 0.0
    if r == BEND:
        return bent[j, 0], bent[j, 1], 0.0
    return h0[p], h0[q], h0[r] if r >= 0 else 0.0


@njit(cache=True, nogil=True)
def source_of(source, axes, j):
    """Return the source of node j."""
    # One type of integer everywhere: each combination would be compiled anew.
    p = np.int64(source[j, 0])
    q = np.int64(source[j, 1])
    r = np.int64(source[j, 2]) if len(axes) > 2 else np.int64(-1)
    return p, q, r
