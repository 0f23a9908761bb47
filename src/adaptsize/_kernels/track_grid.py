"""Source tracking on Cartesian grids: sizes straight from where they come from.

Every node carries its *source*: a node, or a segment between two corners of a box with
the linear interpolant of ``h0``.  It hands the source on to its neighbours along the axes, and
their candidate is the Hopf-Lax value of the source itself, however far away that is.

Nodes are numbered, padded and queued as in march_grid.py.  ``source`` is int32[n], ``end``
int32[n] (or int32[1] if there are nodes only): the nodes of the source, ``end`` negative
where it is one node, -1 if segments begin there that may be better, -2 if not.  A node as a
source has its present size, a segment the bounds ``h0``.
"""

import math

import numpy as np
from numba import njit

from adaptsize._kernels.visibility_grid import is_certain, is_visible

# A weight below this is rounding: the end is no part of the source.
_NO_WEIGHT = 1e-12

# A polished source must be better by more than rounding.
_BETTER = 1.0 - 1e-13


@njit(cache=True, nogil=True)
def coordinates(i, strides, per_stride):
    """Return the coordinates of a padded node as integers, 0 for missing axes.

    ``per_stride`` are the reciprocals: quotients below 2^31 are exact with the half added.
    """
    c0 = int((i + 0.5) * per_stride[0])
    rest = i - c0 * strides[0]
    if len(strides) == 2:
        return c0, rest, 0
    c1 = int((rest + 0.5) * per_stride[1])
    return c0, c1, rest - c1 * strides[1]


@njit(cache=True, nogil=True)
def minimum_on_segment(wx, wy, wz, ex, ey, ez, h_a, rise, g):
    """Return min over 0 <= t <= 1 of  h_a + t rise + g |w - t e|, and t.

    w is the node seen from the first end of the segment, e the other end; see
    `adaptsize._kernels.local.minimum_on_edge`.
    """
    length2 = ex * ex + ey * ey + ez * ez
    slack2 = g * g * length2 - rise * rise
    if slack2 <= 0.0:
        t = 0.0 if rise >= 0.0 else 1.0
    else:
        foot = (ex * wx + ey * wy + ez * wz) / length2
        px = wx - foot * ex
        py = wy - foot * ey
        pz = wz - foot * ez
        ratio = math.sqrt((px * px + py * py + pz * pz) / (length2 * slack2))
        t = foot - rise * ratio
        if 0.0 < t < 1.0:
            return h_a + foot * rise + ratio * slack2, t
        t = 0.0 if t <= 0.0 else 1.0
    px = wx - t * ex
    py = wy - t * ey
    pz = wz - t * ez
    return h_a + t * rise + g * math.sqrt(px * px + py * py + pz * pz), t


@njit(cache=True, nogil=True)
def polish(
    u,
    h0,
    strides,
    per_stride,
    steps,
    offsets,
    partners,
    spacing,
    g,
    clear,
    hidden,
    j,
    p,
    q,
    value,
    most,
):
    """Move a source over neighbouring segments while that lowers the candidate of node j.

    Parameters
    ----------
    u, h0, strides, per_stride, steps, offsets, partners, spacing, g, clear, hidden
        As in `track_grid`.
    j, p, q : int
        A node and its source, q negative if that is one node; ``h0`` is finite there.
    value : float
        Its candidate.
    most : int
        Most moves.

    Returns
    -------
    value : float
    p, q : int
    """
    j0, j1, j2 = coordinates(j, strides, per_stride)
    m = -1  # the step from p to q
    t = 0.0
    if q >= 0:
        p0, p1, p2 = coordinates(p, strides, per_stride)
        q0, q1, q2 = coordinates(q, strides, per_stride)
        m = partners[9 * (q0 - p0 + 1) + 3 * (q1 - p1 + 1) + q2 - p2 + 1, 0]
    for move in range(most + 1):
        p0, p1, p2 = coordinates(p, strides, per_stride)
        wx = (j0 - p0) * spacing[0]
        wy = (j1 - p1) * spacing[1]
        wz = (j2 - p2) * spacing[2]
        h_p = h0[p]
        if m >= 0:
            ex, ey, ez = offsets[m, 0], offsets[m, 1], offsets[m, 2]
            lower, t = minimum_on_segment(wx, wy, wz, ex, ey, ez, h_p, h0[p + steps[m]] - h_p, g)
            if move == 0:
                value = lower
            if t >= 1.0 - _NO_WEIGHT:  # the end takes over
                p += steps[m]
                p0, p1, p2 = coordinates(p, strides, per_stride)
                wx -= ex
                wy -= ey
                wz -= ez
                h_p = h0[p]
                m = -1
            elif t <= _NO_WEIGHT:
                m = -1
        if move == most:
            break
        # From the foot, the candidate falls along f if the sizes rise by less than f . slope.
        h_foot = h_p
        fx = fy = fz = 0.0
        row = 27
        if m >= 0:
            fx, fy, fz = t * offsets[m, 0], t * offsets[m, 1], t * offsets[m, 2]
            h_foot += t * (h0[p + steps[m]] - h_p)
            row = 28 + m
        dx = wx - fx
        dy = wy - fy
        dz = wz - fz
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        if away == 0.0:
            break
        pull = g / away
        best, new_p, new_m = value * _BETTER, -1, -1
        for place in range(1, partners[row, 0] + 1):
            n = partners[row, place]
            w = p + steps[n]
            h_w = h0[w]
            if not h_w < math.inf:
                continue
            ex, ey, ez = offsets[n, 0], offsets[n, 1], offsets[n, 2]
            along = (ex - fx) * dx + (ey - fy) * dy + (ez - fz) * dz
            if h_w - h_foot >= pull * along:
                continue
            lower, s = minimum_on_segment(wx, wy, wz, ex, ey, ez, h_p, h_w - h_p, g)
            if lower < best and _is_open(
                u, h0, clear, strides, per_stride, hidden, j, j0, j1, j2, p, w, s
            ):
                best, new_p, new_m = lower, p, n
            if m >= 0:
                q = p + steps[m]
                gx, gy, gz = offsets[m, 0], offsets[m, 1], offsets[m, 2]
                lower, s = minimum_on_segment(
                    wx - gx, wy - gy, wz - gz, ex - gx, ey - gy, ez - gz, h0[q], h_w - h0[q], g
                )
                if lower < best and _is_open(
                    u, h0, clear, strides, per_stride, hidden, j, j0, j1, j2, q, w, s
                ):
                    best, new_p = lower, q
                    q0, q1, q2 = coordinates(q, strides, per_stride)
                    w0, w1, w2 = coordinates(w, strides, per_stride)
                    new_m = partners[9 * (w0 - q0 + 1) + 3 * (w1 - q1 + 1) + w2 - q2 + 1, 0]
        if new_p < 0:
            break
        value, p, m = best, new_p, new_m
    return value, p, p + steps[m] if m >= 0 else -1


@njit(cache=True, nogil=True)
def _is_open(u, h0, clear, strides, per_stride, hidden, j, j0, j1, j2, p, q, t):
    """Tell whether the segment (p, q) is a source and node j sees its point t.

    A diagonal is one if all corners of its face or box have finite bounds, or no others: where
    the data turn a corner it would be a short cut.
    """
    p0, p1, p2 = coordinates(p, strides, per_stride)
    q0, q1, q2 = coordinates(q, strides, per_stride)
    corners = 0
    finite = 0
    for corner in range(1 << len(strides)):
        node = p
        differs = True
        for a in range(len(strides)):
            if (corner >> a) & 1:
                d = q0 - p0 if a == 0 else (q1 - p1 if a == 1 else q2 - p2)
                differs = differs and d != 0
                node += d * strides[a]
        if differs:
            corners += 1
            if h0[node] < math.inf:
                finite += 1
    if 2 < finite < corners:
        return False
    if not hidden:
        return True
    d0, d1, d2 = float(q0 - p0), float(q1 - p1), float(q2 - p2)
    if not is_visible(u, clear, strides, p, d0, d1, d2):
        return False
    d0, d1, d2 = p0 - j0 + t * d0, p1 - j1 + t * d1, p2 - j2 + t * d2
    return is_visible(u, clear, strides, j, d0, d1, d2)


@njit(cache=True, nogil=True)
def slide_bend(u, strides, per_stride, steps, n_axes, spacing, g, clear, j, p, most):
    """Move the node p at which the path to node j bends to a neighbour while that lowers j.

    Returns the best candidate found (inf: none below ``u[j]``) and its node.
    """
    j0, j1, j2 = coordinates(j, strides, per_stride)
    best = u[j] * _BETTER
    found = False
    for _ in range(most):
        better = -1
        for m in range(n_axes):
            w = p + steps[m]
            if u[w] < best:
                w0, w1, w2 = coordinates(w, strides, per_stride)
                x = (j0 - w0) * spacing[0]
                y = (j1 - w1) * spacing[1]
                z = (j2 - w2) * spacing[2]
                value = u[w] + g * math.sqrt(x * x + y * y + z * z)
                if value < best and is_visible(
                    u, clear, strides, j, float(w0 - j0), float(w1 - j1), float(w2 - j2)
                ):
                    best = value
                    better = w
        if better < 0:
            break
        p = better
        found = True
    return (best, p) if found else (math.inf, p)


@njit(cache=True, nogil=True)
def offer_around(
    u, strides, per_stride, shape, spacing, g, sources, reach, source, clear, hidden, keep
):
    """Offer sources to all nodes within ``reach`` steps along each axis.

    A source that another one nearly outdoes serves a region so thin that no neighbour may lie in
    it, though it widens farther on.

    Parameters
    ----------
    shape : tuple of length dim
        Nodes along the axes, without the border.
    sources : int32[m]
        Nodes with finite sizes, by increasing size.
    reach : int
    others
        As in `track_grid`.
    """
    for i in range(sources.shape[0]):
        p = np.int64(sources[i])
        if source[p] != p:
            continue
        p0, p1, p2 = coordinates(p, strides, per_stride)
        low = high = 0
        if len(strides) == 3:
            low, high = max(p2 - reach, 1), min(p2 + reach, shape[2])
        for k0 in range(max(p0 - reach, 1), min(p0 + reach, shape[0]) + 1):
            for k1 in range(max(p1 - reach, 1), min(p1 + reach, shape[1]) + 1):
                for k2 in range(low, high + 1):
                    k = k0 * strides[0] + k1 * strides[1] + k2
                    if not u[k] > u[p]:
                        continue
                    x = (k0 - p0) * spacing[0]
                    y = (k1 - p1) * spacing[1]
                    z = (k2 - p2) * spacing[2]
                    value = u[p] + g * math.sqrt(x * x + y * y + z * z)
                    if value >= u[k] * keep:
                        continue
                    if hidden and not is_visible(
                        u, clear, strides, k, float(p0 - k0), float(p1 - k1), float(p2 - k2)
                    ):
                        continue
                    u[k] = value
                    source[k] = p


@njit(cache=True, nogil=True)
def start_grid(
    u,
    h0,
    strides,
    per_stride,
    steps,
    offsets,
    partners,
    n_axes,
    n_near,
    spacing,
    g,
    source,
    end,
    clear,
    hidden,
    keep,
    least_distance,
):
    """Give every node the best source among its neighbours, all from ``h0``.

    Nodes that only a segment may lower keep their size, and get the neighbour as a hint.

    Parameters
    ----------
    least_distance : float
        Of a node from a segment between its neighbours.
    others
        As in `track_grid`.
    """
    for k in range(strides[0], u.shape[0] - strides[0]):
        h_k = h0[k]
        if not h_k > -math.inf:
            continue
        best = math.inf
        lowest = math.inf
        p = -1
        for m in range(steps.shape[0]):
            h = h0[k + steps[m]]
            if h < h_k:
                lowest = min(lowest, h)
                # Across a box with inactive corners there is no straight way.
                if m < n_axes or not hidden:
                    value = h + g * offsets[m, 3]
                    if value < best:
                        best = value
                        p = k + steps[m]
        if best < h_k * keep:
            u[k] = best
        elif p < 0 or end.shape[0] == 1 or not lowest + g * least_distance < h_k:
            continue
        # Otherwise a segment at p may lower the node: that is seen when it is accepted.
        source[k] = p
        if end.shape[0] > 1:
            end[k] = end[p] if source[p] == p else -1


@njit(cache=True, nogil=True)
def track_grid(
    u,
    h0,
    strides,
    per_stride,
    steps,
    offsets,
    partners,
    n_axes,
    n_near,
    spacing,
    g,
    source,
    end,
    clear,
    hidden,
    moves,
    keep,
    seeds,
    origin,
    width,
    first,
    following,
    previous,
    bucket,
    state,
    max_accepted,
):
    """Accept nodes bucket by bucket and hand their sources on.

    Parameters
    ----------
    u, h0 : float64[n]
        Padded sizes (In/Out) and bounds; NaN where no active node is.
    strides : tuple of length dim, 2 or 3
    per_stride : tuple of length dim
        1 / strides.
    steps : int64[m]
        Steps to the neighbours: along the axes first, then across faces and boxes.
    offsets : float64[m, 4]
        The same as vectors, and their lengths.
    partners : int64[28 + m, m + 1]
        Row ``9 (a + 1) + 3 (b + 1) + c + 1``: which step leads by (a, b, c).  Row 27: m
        and all steps.  Row 28 + s: how many steps lead to a node in one box with both ends of
        step s, and which.
    n_axes : int
        So many of ``steps`` lead along axes.
    n_near : int
        Isolated sources are handed on along so many of ``steps``, others along axes.
    spacing : tuple of length 3
        1 for missing axes.
    g : float
    source, end
        In/Out.
    clear : uint8[n]
        See visibility_grid.py; uint8[1] if nothing is hidden.
    hidden : bool
        Whether straight lines may leave the domain.
    moves : int
        Most moves in polishing and in sliding bends.
    keep : float
        A candidate counts if it is below ``keep`` times the present size.
    seeds, origin, width, first, following, previous, bucket, state, max_accepted
        As in `adaptsize._kernels.march_grid.march_grid`.

    Returns
    -------
    int
        Number of nodes accepted; less than ``max_accepted`` at the end.
    """
    segments = end.shape[0] > 1
    here, waiting, taken = state
    ring = first.shape[0] - 1
    per_width = 1.0 / width
    accepted = 0
    q = np.int64(-2)
    q0 = q1 = q2 = 0
    ex = ey = ez = 0.0
    rise = 0.0
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
                bucket[k] = slot
                previous[k] = -1
                following[k] = first[slot]
                if first[slot] >= 0:
                    previous[first[slot]] = k
                first[slot] = k
                waiting += 1
            taken += 1
        if waiting == 0:
            break
        j = np.int64(first[here & ring])
        if j < 0:
            here += 1
            continue
        first[here & ring] = following[j]
        if following[j] >= 0:
            previous[following[j]] = -1
        bucket[j] = -1
        waiting -= 1
        accepted += 1

        p = np.int64(source[j])
        if segments:
            q = np.int64(end[j])
        if moves > 0 and p != j:
            if q >= 0 or u[p] == h0[p]:
                if segments and q != -2:
                    value, s, e = polish(
                        u,
                        h0,
                        strides,
                        per_stride,
                        steps,
                        offsets,
                        partners,
                        spacing,
                        g,
                        clear,
                        hidden,
                        j,
                        p,
                        q,
                        u[j],
                        moves,
                    )
                    if value < u[j] * _BETTER:
                        u[j] = value
                        source[j] = s
                        end[j] = e
                        p = s
                        q = e
            elif hidden:
                value, s = slide_bend(
                    u, strides, per_stride, steps, n_axes, spacing, g, clear, j, p, moves
                )
                if value < u[j]:
                    u[j] = value
                    source[j] = s
                    p = s
                    q = -2
                    if segments:
                        end[j] = -2
        u_j = u[j]
        if u_j == h0[j] and p != j:  # what `start_grid` hoped for did not come true
            source[j] = j
            p = j
            q = np.int64(-2)
            if segments:
                end[j] = -2
        u_p = u[p]
        # Nodes have the same candidate already; one at which paths bend may have been lowered.
        unchanging = q >= 0 or source[p] == p
        j0, j1, j2 = coordinates(j, strides, per_stride)
        p0, p1, p2 = coordinates(p, strides, per_stride)
        wx = (j0 - p0) * spacing[0]
        wy = (j1 - p1) * spacing[1]
        wz = (j2 - p2) * spacing[2]
        if q >= 0:
            q0, q1, q2 = coordinates(q, strides, per_stride)
            ex = (q0 - p0) * spacing[0]
            ey = (q1 - p1) * spacing[1]
            ez = (q2 - p2) * spacing[2]
            u_p = h0[p]
            rise = h0[q] - u_p
        # Dense data reach every node along the axes.
        for m in range(n_near if q == -2 else n_axes):
            k = j + steps[m]
            u_k = u[k]
            if not u_k > u_j:
                continue
            if unchanging and source[k] == p and (not segments or end[k] == q):
                continue
            x = wx + offsets[m, 0]
            y = wy + offsets[m, 1]
            z = wz + offsets[m, 2]
            t = 0.0
            if q < 0:
                value = u_p + g * math.sqrt(x * x + y * y + z * z)
            else:
                value, t = minimum_on_segment(x, y, z, ex, ey, ez, u_p, rise, g)
            if value >= u_k * keep:
                continue
            s = p
            e = q
            if hidden and (p != j or m >= n_axes):
                k0, k1, k2 = coordinates(k, strides, per_stride)
                d0 = float(p0 - k0)
                d1 = float(p1 - k1)
                d2 = float(p2 - k2)
                if q >= 0:
                    d0 += t * (q0 - p0)
                    d1 += t * (q1 - p1)
                    d2 += t * (q2 - p2)
                if (
                    q >= 0 or not is_certain(u, source, end, strides, k, p, d0, d1, d2)
                ) and not is_visible(u, clear, strides, k, d0, d1, d2):
                    # The path bends at j, if k is seen from there.
                    value = u_j + g * offsets[m, 3]
                    if value >= u_k * keep:
                        continue
                    if m >= n_axes:  # in the plane only
                        lowest = k - (j0 < k0) * strides[0] - (j1 < k1) * strides[1]
                        if clear[lowest] == 0:
                            continue
                    s = j
                    e = -2
            u[k] = value
            source[k] = s
            if segments:
                end[k] = e
            slot = max(int((value - origin) * per_width), here) & ring
            old = bucket[k]
            if old == slot:
                continue
            if old >= 0:
                if previous[k] >= 0:
                    following[previous[k]] = following[k]
                else:
                    first[old] = following[k]
                if following[k] >= 0:
                    previous[following[k]] = previous[k]
            else:
                waiting += 1
            bucket[k] = slot
            previous[k] = -1
            following[k] = first[slot]
            if first[slot] >= 0:
                previous[first[slot]] = k
            first[slot] = k
    state[0] = here
    state[1] = waiting
    state[2] = taken
    return accepted
