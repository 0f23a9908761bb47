"""Marching on Cartesian grids.

The grid comes as a *padded* flat array: one more layer of nodes on every side, which
hold NaN, as inactive nodes do.  Every comparison with NaN is False, so that no loop tests
for the border or the mask.  The ``grid`` is a tuple: ``strides`` (steps in the flat array) and
``weights`` (1 / spacing^2) are tuples with one entry per axis, which unrolls the loops over axes;
the gradient limit of node k is ``g[k * g_step]``, with g float64[n] or float64[1], and g_step 1 or
0.

Nodes are accepted bucket by bucket: each bucket holds the nodes whose sizes lie within
one rise over a cell, and is emptied in any order.  A node that is lowered after it
was accepted is inserted again.  The result is that of a heap, in a quarter of the time.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel

# Values of three axes along which there is no neighbour, and their coefficients.
_NONE, _ONES = (math.inf, math.inf, math.inf), (1.0, 1.0, 1.0)


@lean
def upwind_value(f, v, c, g):
    """Return the root h of  sum_a c_a (h - f_a)^2 = g^2  over the axes upwind of it.

    Parameters
    ----------
    f : tuple of 3 float
        ``v`` at first order; extrapolated through two nodes at second.
    v : tuple of 3 float
        Smaller neighbour along each axis; inf: none.  Axes count only while h > v_a.
    c : tuple of 3 float
        1 / spacing^2 at first order, 9/4 of that at second.
    g : float

    Returns
    -------
    float
        inf if there is no neighbour.
    """
    (f0, f1, f2), (v0, v1, v2), (c0, c1, c2) = f, v, c
    if v1 < v0:
        f0, v0, c0, f1, v1, c1 = f1, v1, c1, f0, v0, c0
    if v2 < v1:
        f1, v1, c1, f2, v2, c2 = f2, v2, c2, f1, v1, c1
        if v1 < v0:
            f0, v0, c0, f1, v1, c1 = f1, v1, c1, f0, v0, c0
    if math.isinf(v0):
        return math.inf
    value = f0 + g / math.sqrt(c0)
    if v1 < value:
        # In t = h - f0, so that large sizes cost no digits.
        d = f1 - f0
        both = c0 + c1
        root = both * g * g - c0 * c1 * d * d
        if root >= 0.0:
            t = f0 + (c1 * d + math.sqrt(root)) / both
            if t >= v1 and t >= f1:
                value = t
                if v2 < value:
                    e = f2 - f0
                    all3 = both + c2
                    mixed = c1 * d + c2 * e
                    root = mixed * mixed - all3 * (c1 * d * d + c2 * e * e - g * g)
                    if root >= 0.0:
                        t = f0 + (mixed + math.sqrt(root)) / all3
                        if t >= v2 and t >= f2:
                            value = t
    return value


@lean
def _replaced(values, a, value):
    """Return a tuple of three values with value a replaced."""
    v0, v1, v2 = values
    return value if a == 0 else v0, value if a == 1 else v1, value if a == 2 else v2


@lean
def _smaller_neighbour(u, k, step, u_k):
    """Return the smaller neighbour of node k along an axis, ``u_k`` if none is below."""
    v = u_k
    if u[k - step] < v:
        v = u[k - step]
    if u[k + step] < v:
        v = u[k + step]
    return v


@lean_kernel
def sweep_grid(u, grid, edges, candidate):
    """Fill the first-order update of every node from its neighbours, all from the same sizes.

    Parameters
    ----------
    u : float64[n]
        Padded sizes; inf allowed, NaN where no node is.
    grid : tuple
    edges : bool
        Along edges only, each axis by itself.
    candidate : float64[n]
        Out: inf where no neighbour is below; the border is left inf.
    """
    strides, weights, g, g_step = grid
    candidate[:] = math.inf
    for k in range(strides[0], u.shape[0] - strides[0]):
        u_k = u[k]
        if not u_k > 0.0:
            continue
        v, c = _NONE, _ONES
        for a in range(len(strides)):
            below = _smaller_neighbour(u, k, strides[a], u_k)
            if below < u_k:
                v, c = _replaced(v, a, below), _replaced(c, a, weights[a])
        g_k = g[k * g_step]
        if edges:
            for a in range(3):
                candidate[k] = min(candidate[k], v[a] + g_k / math.sqrt(c[a]))
        else:
            candidate[k] = upwind_value(v, v, c, g_k)


class Buckets(NamedTuple):
    """Nodes that wait, sorted into buckets by their sizes.

    Parameters
    ----------
    seeds : int32[s]
        Nodes to begin with, by increasing size.
    origin : float
    width : float
        Bucket b holds sizes from ``origin + b width``; no update may rise by more than
        ``width (n_buckets - 2)``.
    first : int32[n_buckets]
        First node of each bucket (a power of two, used in a circle), or -1.
    following : int32[n]
        The next node in the bucket of each node.
    previous : int32[n]
        The one before.
    bucket : int32[n]
        Where a node waits, -1 if it does not.
    state : int64[3]
        Present bucket, number of waiting nodes, number of seeds taken.
    """

    seeds: np.ndarray
    origin: float
    width: float
    first: np.ndarray
    following: np.ndarray
    previous: np.ndarray
    bucket: np.ndarray
    state: np.ndarray


@lean
def _put(queue, k, slot):
    """Put node k into a bucket."""
    first, previous = queue.first, queue.previous
    queue.bucket[k] = slot
    previous[k] = -1
    queue.following[k] = first[slot]
    if first[slot] >= 0:
        previous[first[slot]] = k
    first[slot] = k


@lean
def _take_out(queue, k, slot):
    """Take node k out of its bucket, which ``bucket`` still names."""
    following, previous = queue.following, queue.previous
    if previous[k] >= 0:
        following[previous[k]] = following[k]
    else:
        queue.first[slot] = following[k]
    if following[k] >= 0:
        previous[following[k]] = previous[k]


@lean_kernel
def march_grid(u, grid, edges, queue, stop):
    """Accept nodes bucket by bucket and lower their neighbours.

    Parameters
    ----------
    u : float64[n]
        In/Out: padded sizes, those of the seeds lowered already.
    grid, edges
        As in `sweep_grid`.
    queue : Buckets
        In/Out.
    stop : tuple of float, int
        A candidate counts if it is below this share of the present size; return after so many
        nodes, so that the caller can report and be interrupted.

    Returns
    -------
    int
        Number of nodes accepted; less than the largest number at the end.
    """
    (strides, weights, g, g_step), (keep, max_accepted) = grid, stop
    seeds, origin, width, first, following, previous, bucket, state = queue
    here, waiting, taken = state
    ring = first.shape[0] - 1
    per_width = 1.0 / width
    accepted = 0
    while accepted < max_accepted:
        if waiting == 0 and taken < seeds.shape[0]:
            here = max(here, int((u[seeds[taken]] - origin) * per_width))
        # Seeds join when the front reaches them: the ring is too short for all sizes.
        while taken < seeds.shape[0]:
            k = seeds[taken]
            if bucket[k] < 0:
                if int((u[k] - origin) * per_width) > here:
                    break
                slot = here & ring
                _put(queue, k, slot)
                waiting += 1
            taken += 1
        if waiting == 0:
            break
        j = first[here & ring]
        if j < 0:
            here += 1
            continue
        first[here & ring] = following[j]
        if following[j] >= 0:
            previous[following[j]] = -1
        bucket[j] = -1
        waiting -= 1
        accepted += 1

        u_j = u[j]
        for a in range(len(strides)):
            for side in range(2):
                step = strides[a] if side == 1 else -strides[a]
                k = j + step
                u_k = u[k]
                # If the node beyond is smaller, it is that one which counts along the axis.
                if not u_k > u_j or u[k + step] < u_j:
                    continue
                g_k = g[k * g_step]
                v, c, n = (u_j, math.inf, math.inf), (weights[a], 1.0, 1.0), 1
                if not edges:
                    for b in range(len(strides)):
                        if b != a:
                            below = _smaller_neighbour(u, k, strides[b], u_k)
                            if below < u_k:
                                v, c = _replaced(v, n, below), _replaced(c, n, weights[b])
                                n += 1
                value = upwind_value(v, v, c, g_k)
                if value < u_k * keep:
                    u[k] = value
                    slot = max(int((value - origin) * per_width), here) & ring
                    old = bucket[k]
                    if old == slot:
                        continue
                    if old >= 0:
                        _take_out(queue, k, old)
                    else:
                        waiting += 1
                    _put(queue, k, slot)
    state[0], state[1], state[2] = here, waiting, taken
    return accepted


@lean_kernel
def refine_in_order(order, sizes, grid, spacing, u):
    """Recompute sizes with one-sided second differences, upwind ones first.

    Parameters
    ----------
    order : int32[m]
        Nodes by increasing first-order size.
    sizes : tuple of two float64[n]
        First-order sizes, which define the upwind neighbours of a node, and upper bounds.
    grid : tuple
    spacing : tuple of length dim
    u : float64[n]
        In/Out: ``u0``, lowered in the end.

    Notes
    -----
    The second difference reaches through a neighbour only if that one was lowered
    itself: behind a node that keeps its bound the field has a kink.
    """
    (u1, u0), (strides, weights, g, g_step) = sizes, grid
    for here in range(order.shape[0]):
        k = order[here]
        own = u1[k]
        g_k = g[k * g_step]
        f, v, c, most = _NONE, _NONE, _ONES, math.inf
        for a in range(len(strides)):
            below, step = math.inf, 0
            for side in range(-1, 2, 2):
                at = k + side * strides[a]
                if u1[at] < own and u[at] < below:
                    below, step = u[at], side * strides[a]
            if step == 0:
                continue
            f_a, c_a = below, weights[a]
            most = min(most, below + g_k * spacing[a])
            if below < u0[k + step] and u1[k + step + step] < own:
                beyond = u[k + step + step]
                if beyond <= below:
                    f_a, c_a = below + (below - beyond) / 3.0, 2.25 * c_a
            f, v, c = _replaced(f, a, f_a), _replaced(v, a, below), _replaced(c, a, c_a)
        value = upwind_value(f, v, c, g_k)
        u[k] = min(u0[k], value, most)
