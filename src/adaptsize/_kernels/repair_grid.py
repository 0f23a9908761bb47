"""Marching and tracking again on Cartesian grids after some bounds have changed.

What repair.py does for meshes; arrays are padded and numbered as in march_grid.py.
"""

import math

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.march_grid import upwind_value
from adaptsize._kernels.repair import LOWER, SUPPORTED


@inner
def _offer(u, strides, weights, g_k, edges, lost, k, u_k):
    """Return the size that the neighbours allow at node k, and the least of theirs.

    Without the neighbours that are ``lost`` or not below ``u_k``.
    """
    v0 = v1 = v2 = math.inf
    c0 = c1 = c2 = 1.0
    for a in range(len(strides)):
        v = u_k
        if not lost[k - strides[a]] and u[k - strides[a]] < v:
            v = u[k - strides[a]]
        if not lost[k + strides[a]] and u[k + strides[a]] < v:
            v = u[k + strides[a]]
        if v < u_k:
            if a == 0:
                v0 = v
                c0 = weights[a]
            elif a == 1:
                v1 = v
                c1 = weights[a]
            else:
                v2 = v
                c2 = weights[a]
    least = min(v0, v1, v2)
    if edges:
        along = min(v0 + g_k / math.sqrt(c0), v1 + g_k / math.sqrt(c1))
        return min(along, v2 + g_k / math.sqrt(c2)), least
    return upwind_value(v0, v0, c0, v1, v1, c1, v2, v2, c2, g_k), least


@kernel
def find_lost(
    u, h0, strides, weights, g, g_step, edges, lost, found, count, suspect, waiting, ends, most
):
    """Find the nodes that no bound and no node that is not lost supports.

    Parameters
    ----------
    u : float64[n]
        Padded sizes before, lowered to ``h0`` where that is below.
    h0 : float64[n]
        Bounds now; NaN where no node is.
    strides, weights, g, g_step, edges
        As in `adaptsize._kernels.march_grid.sweep_grid`.
    lost, found, count, suspect, waiting, ends, most
        As in `adaptsize._kernels.repair.find_lost`.

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
        value, least = _offer(u, strides, weights, g[k * g_step], edges, lost, k, u[k])
        if value <= u[k] * SUPPORTED and least < u[k] * LOWER:
            continue
        lost[k] = True
        found[count] = k
        count += 1
        for a in range(len(strides)):
            for side in range(2):
                i = k + strides[a] if side == 1 else k - strides[a]
                # Upwind is below.
                if u[i] > u[k] * LOWER and u[i] < h0[i] and not lost[i] and not waiting[i]:
                    waiting[i] = True
                    last = first + left
                    suspect[last if last < n else last - n] = i
                    left += 1
    ends[0] = first
    ends[1] = left
    return count


@kernel
def begin_again(u, h0, strides, weights, g, g_step, edges, lost, found):
    """Give lost nodes the least that their bounds and the nodes around allow.

    Parameters
    ----------
    As for `find_lost`; ``u`` is In/Out.
    found : int32[m]
        The lost nodes.
    """
    for index in range(found.shape[0]):
        k = found[index]
        value = _offer(u, strides, weights, g[k * g_step], edges, lost, k, math.inf)[0]
        u[k] = min(h0[k], value)


@kernel
def start_at(nodes, u, h0, steps, offsets, n_axes, g, source, end, hidden, keep, least_distance):
    """Give nodes the best source among their neighbours that keep their bounds.

    As `adaptsize._kernels.track_grid.start_grid` does for all nodes.

    Parameters
    ----------
    nodes : int32[m]
    u, source, end
        In/Out; those of the nodes are lowered if that is better than what they have.
    h0, steps, offsets, n_axes, g, hidden, keep, least_distance
        As in `start_grid`.
    """
    for index in range(nodes.shape[0]):
        k = nodes[index]
        u_k = u[k]
        best = math.inf
        lowest = math.inf
        p = -1
        for m in range(steps.shape[0]):
            h = h0[k + steps[m]]
            if h < u_k:
                lowest = min(lowest, h)
                # Across a box with inactive corners there is no straight way.
                if m < n_axes or not hidden:
                    value = h + g * offsets[m, 3]
                    if value < best:
                        best = value
                        p = k + steps[m]
        if best < u_k * keep:
            u[k] = best
        elif p < 0 or end.shape[0] == 1 or source[k] != k or not lowest + g * least_distance < u_k:
            continue
        # Otherwise a segment at p may lower the node: that is seen when it is accepted.
        source[k] = p
        if end.shape[0] > 1:
            end[k] = end[p] if source[p] == p else -1


@kernel
def mark_around(nodes, steps, marks):
    """Mark nodes (int32[m]) and those at some steps from them (In/Out: marks, bool[n])."""
    for index in range(nodes.shape[0]):
        marks[nodes[index]] = True
        for m in range(steps.shape[0]):
            marks[nodes[index] + steps[m]] = True
