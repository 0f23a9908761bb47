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

from adaptsize._kernels.compiling import inner
from adaptsize._kernels.local import distance, minimum_on_edge, minimum_on_triangle

# Nodes of less weight are no part of a source: rounding.
_NO_WEIGHT = 1e-14

# No node; of the type of all node numbers, as each combination of types is compiled anew.
NONE = np.int64(-1)

# In place of r: an edge along which paths bend (see bends.py).
BEND = np.int64(-2)


@inner
def drop_zero_weights(p, q, r, l1, l2):
    """Return those nodes of a source whose weights are positive, and the weights of q and r."""
    l0 = 1.0 - l1 - l2
    if q < 0:
        return p, NONE, NONE, 0.0, 0.0
    if l0 <= _NO_WEIGHT:
        if r < 0 or l2 <= _NO_WEIGHT:
            return q, NONE, NONE, 0.0, 0.0
        if l1 <= _NO_WEIGHT:
            return r, NONE, NONE, 0.0, 0.0
        return q, r, NONE, l2 / (l1 + l2), 0.0
    if l1 <= _NO_WEIGHT:
        if r < 0 or l2 <= _NO_WEIGHT:
            return p, NONE, NONE, 0.0, 0.0
        return p, r, NONE, l2, 0.0
    if r < 0 or l2 <= _NO_WEIGHT:
        return p, q, NONE, l1, 0.0
    return p, q, r, l1, l2


@inner
def ascending(p, q, r):
    """Return the nodes of a source in ascending order, -1 last."""
    if q >= 0 and q < p:
        p, q = q, p
    if r >= 0 and r < q:
        q, r = r, q
        if q < p:
            p, q = q, p
    return p, q, r


@inner
def others_in_cell(cells, c, k, h0):
    """Return the nodes but k of cell c, at most three, that have a bound; ascending, -1 last."""
    p = q = r = NONE
    for v in range(cells.shape[1]):
        j = np.int64(cells[c, v])
        if j == k or h0[j] == math.inf:
            continue
        if p < 0:
            p = j
        elif q < 0:
            q = j
        else:
            r = j
    return ascending(p, q, r)


@inner
def set_source(source, k, p, q, r):
    """Store a source of node k; NONE where it has fewer nodes than the row has places."""
    source[k, 0] = p
    if source.shape[1] > 1:
        source[k, 1] = q
    if source.shape[1] > 2:
        source[k, 2] = r


@inner
def value_from(state, axes, g, k, p, q, r, u_p, u_q, u_r):
    """Return the size at node k allowed by linear sizes on (p, q, r), and the weights of q, r."""
    if q < 0:
        return u_p + g * distance(state, axes, k, p), 0.0, 0.0
    if len(axes) < 3 or r < 0:  # spares compiling the rest for the plane
        value, t = minimum_on_edge(state, axes, k, p, q, u_p, u_q, g)
        return value, t, 0.0
    return minimum_on_triangle(state, axes, k, p, q, r, u_p, u_q, u_r, g, True)


@inner
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


@inner
def has_own_bound(state, axes, h0, i):
    """Tell whether node i keeps a finite bound."""
    return h0[i] < math.inf and state[i, len(axes)] == h0[i]


@inner
def sizes_of(state, axes, h0, p, q, r):
    """Return the sizes at the nodes of the source (p, q, r), which is no crease."""
    if q < 0:
        return state[p, len(axes)], 0.0, 0.0
    return h0[p], h0[q], h0[r] if r >= 0 else 0.0


@inner
def source_of(source, axes, j):
    """Return the source of node j."""
    p = np.int64(source[j, 0])
    q = np.int64(source[j, 1])
    r = np.int64(source[j, 2]) if len(axes) > 2 else NONE
    return p, q, r
