"""Paths that bend: at corners in the plane, at corners and on creases in space.

A crease is an edge along which the boundary turns inwards.  A node whose path bends on a
crease (p, q) has the source (p, q, `BEND`), and in ``bent`` a point and the size there, from which
it comes in a straight line up to the crease (see `image_of`), and the numbers of the nodes between
which that point was before it was turned about creases.

``axes`` is a tuple of which only the length counts, the embedding dimension.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner
from adaptsize._kernels.local import distance
from adaptsize._kernels.source import BEND, NONE, put_foot, set_source, source_of, value_from
from adaptsize._kernels.visibility import sees

# Corners or creases that are looked at, at most, to find where a path leaves the boundary.
_CORNERS = 64

# Share of a triangle by which a corner must be inside it.
_CLEARLY = 1e-6

# Lines that start outside by less than this angle may be on the boundary.
_GRAZING = 1e-10

# Sizes that differ by less, relative to them, come the same way.
_SAME = 1.0 - 1e-9


@inner
def is_taut(state, outward, i, j, k):
    """Tell whether a path from node i over node j of the boundary to node k winds around it.

    If not, it can be shortened at j: the domain is on the inner side of the turn.
    """
    ux = state[j, 0] - state[i, 0]
    uy = state[j, 1] - state[i, 1]
    vx = state[k, 0] - state[j, 0]
    vy = state[k, 1] - state[j, 1]
    turn = ux * vy - uy * vx
    before = ux * outward[j, 1] - uy * outward[j, 0]
    after = vx * outward[j, 1] - vy * outward[j, 0]
    return (turn >= 0.0 or (before < 0.0 and after < 0.0)) and (
        turn <= 0.0 or (before > 0.0 and after > 0.0)
    )


@inner
def _hider(state, nbr_ptr, nbr, outward, source, j, k, p):
    """Return a corner that hides p from node k, as a neighbour of k knows; -1 if none does.

    Node j sees p, so that what hides p from k has a corner within the triangle of the three, at
    which the path from p to k winds around it.
    """
    jx = state[j, 0] - state[p, 0]
    jy = state[j, 1] - state[p, 1]
    kx = state[k, 0] - state[p, 0]
    ky = state[k, 1] - state[p, 1]
    whole = jx * ky - jy * kx
    for entry in range(nbr_ptr[k] - 1, nbr_ptr[k + 1]):
        m = nbr[entry] if entry >= nbr_ptr[k] else k  # k itself first
        c = np.int64(source[m, 0])
        if c == p or source[m, 1] >= 0 or source[c, 0] != p or source[c, 1] >= 0:
            continue
        if outward[c, 0] == 0.0 and outward[c, 1] == 0.0:
            continue
        cx = state[c, 0] - state[p, 0]
        cy = state[c, 1] - state[p, 1]
        at_k = (jx * cy - jy * cx) * whole
        at_j = (cx * ky - cy * kx) * whole
        inside = _CLEARLY * whole * whole
        if at_k <= inside or at_j <= inside or at_k + at_j >= whole * whole - inside:
            continue
        if is_taut(state, outward, p, c, k):
            return c
    return NONE


@inner
def _slide(state, axes, outward, crease_ptr, crease, k, p, top):
    """Move a bend at node p along the boundary until the line to node k does not start outside.

    Returns the node where the path leaves the boundary, -1 if that has no size up to ``top``.
    """
    for _ in range(_CORNERS):
        wx = state[k, 0] - state[p, 0]
        wy = state[k, 1] - state[p, 1]
        bx = outward[p, 0]
        by = outward[p, 1]
        if wx * bx + wy * by <= (outward[p, 2] + _GRAZING) * math.sqrt(wx * wx + wy * wy):
            return p
        side = bx * wy - by * wx
        following = NONE
        for place in range(crease_ptr[p], crease_ptr[p + 1]):
            i = np.int64(crease[place])
            along = bx * (state[i, 1] - state[p, 1]) - by * (state[i, 0] - state[p, 0])
            if along * side > 0.0 and state[i, len(axes)] <= top:
                following = i
        if following < 0:
            return NONE
        p = following
    return NONE


@inner
def _pull(
    state,
    axes,
    cells,
    ring_ptr,
    ring,
    patch,
    clearance,
    outward,
    h0,
    source,
    refused,
    k,
    p,
):
    """Pull the path to node k straight where it bends at node p of the boundary, in the plane.

    Returns the last bend or the source that is then left, and whether k is known to see it.
    """
    seen = False
    while outward[p, 0] != 0.0 or outward[p, 1] != 0.0:
        i = np.int64(source[p, 0])
        if i == p or source[p, 1] >= 0 or is_taut(state, outward, i, p, k):
            break
        if not sees(
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
            k,
            i,
            NONE,
            NONE,
            0.0,
            0.0,
        ):
            break
        p = i
        seen = True
    return p, seen


@inner
def _wind(
    state,
    axes,
    cells,
    ring_ptr,
    ring,
    patch,
    clearance,
    outward,
    h0,
    g,
    source,
    refused,
    j,
    k,
    keep,
):
    """Let the path to node k, which does not see the source of j, bend at j or at what hid it.

    That is an edge of the boundary, the last row of ``refused``.  Its nodes have their sizes
    already if these are below that of j.
    """
    dim = len(axes)
    last = refused.shape[0] - 1
    best = state[j, dim] + g * distance(state, axes, k, j)
    found = j
    for _ in range(_CORNERS):
        p = np.int64(refused[last, 0])
        if p < 0:
            break
        value = math.inf
        for end in range(2):
            i = np.int64(refused[last, end])
            if i == j or state[i, dim] > state[j, dim]:
                continue
            over = state[i, dim] + g * distance(state, axes, k, i)
            if over < value:
                value = over
                p = i
        if value >= best:
            break
        p, seen = _pull(
            state,
            axes,
            cells,
            ring_ptr,
            ring,
            patch,
            clearance,
            outward,
            h0,
            source,
            refused,
            k,
            p,
        )
        if seen or sees(
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
            k,
            p,
            NONE,
            NONE,
            0.0,
            0.0,
        ):
            best = state[p, dim] + g * distance(state, axes, k, p)
            found = p
            break
    if best < state[k, dim] * keep:
        set_source(source, k, found, NONE, NONE)
    return best


@inner
def over_crease(state, k, a, b, px, py, pz, u, g):
    """Return the size at node k over the edge (a, b) from size u at point P, and where it bends.

    Turned about the edge into one plane with k, P lies on the other side of the edge, and the
    path is the straight line: with f the fractions of the edge at the feet of the two and r
    the distances from it, it crosses at t = (f_P r_k + f_k r_P) / (r_P + r_k).
    """
    ex = state[b, 0] - state[a, 0]
    ey = state[b, 1] - state[a, 1]
    ez = state[b, 2] - state[a, 2]
    kx = state[k, 0] - state[a, 0]
    ky = state[k, 1] - state[a, 1]
    kz = state[k, 2] - state[a, 2]
    px -= state[a, 0]
    py -= state[a, 1]
    pz -= state[a, 2]
    length2 = ex * ex + ey * ey + ez * ez
    t = 0.0
    if length2 > 0.0:
        f_k = (kx * ex + ky * ey + kz * ez) / length2
        f_p = (px * ex + py * ey + pz * ez) / length2
        r_k = math.sqrt((kx - f_k * ex) ** 2 + (ky - f_k * ey) ** 2 + (kz - f_k * ez) ** 2)
        r_p = math.sqrt((px - f_p * ex) ** 2 + (py - f_p * ey) ** 2 + (pz - f_p * ez) ** 2)
        t = (f_p * r_k + f_k * r_p) / (r_p + r_k) if r_p + r_k > 0.0 else f_k
        t = min(max(t, 0.0), 1.0)
    to_p = math.sqrt((px - t * ex) ** 2 + (py - t * ey) ** 2 + (pz - t * ez) ** 2)
    to_k = math.sqrt((kx - t * ex) ** 2 + (ky - t * ey) ** 2 + (kz - t * ez) ** 2)
    return u + g * (to_p + to_k), t


@inner
def _claim(state, i, px, py, pz, u, g):
    """Return the size that node i has if it sees P, where the size is u."""
    dx = state[i, 0] - px
    dy = state[i, 1] - py
    dz = state[i, 2] - pz
    return u + g * math.sqrt(dx * dx + dy * dy + dz * dz)


@inner
def along_creases(state, crease_ptr, crease, k, a, b, px, py, pz, u, g):
    """Move a bend along the creases, from (a, b) on, to where the path to node k is shortest.

    Creases beyond which P claims a size below that of their node, so that it is hidden there, are
    not followed.  Returns the size, the crease, ascending, and the weight of its second node;
    if the path bends at a node, -1 for the second.
    """
    value, t = over_crease(state, k, a, b, px, py, pz, u, g)
    for _ in range(_CORNERS):
        if 0.0 < t < 1.0:
            break
        end = a if t == 0.0 else b
        other = b if t == 0.0 else a
        following = NONE
        for place in range(crease_ptr[end], crease_ptr[end + 1]):
            i = np.int64(crease[place])
            if i == other:
                continue
            lower, at = over_crease(state, k, end, i, px, py, pz, u, g)
            if (
                at > 0.0
                and lower <= value
                and _claim(state, i, px, py, pz, u, g) >= state[i, 3] * _SAME
            ):
                value = lower
                t = at
                following = i
        if following < 0:
            return value, end, NONE, 0.0
        a = end
        b = following
    if b < a:
        return value, b, a, 1.0 - t
    return value, a, b, t


@inner
def image_of(state, axes, h0, g, source, bent, i):
    """Return the point and the size there from which the size of node i comes in a straight line.

    The place of its source; for a crease, that place turned about the crease into the line
    from the crease to i, so that the whole way lies on it.  The last number is False if node i
    is its own source.
    """
    p, q, r = source_of(source, axes, i)
    if q < 0:
        return state[p, 0], state[p, 1], state[p, 2], state[p, 3], p != i
    if r == BEND:
        value, t = over_crease(state, i, p, q, bent[i, 0], bent[i, 1], bent[i, 2], bent[i, 3], g)
        put_foot(state, axes, p, q, NONE, t, 0.0)
        to_foot = distance(state, axes, i, state.shape[0] - 1)
        if to_foot == 0.0 or g == 0.0:
            return 0.0, 0.0, 0.0, 0.0, False
        stretch = (value - bent[i, 3]) / (g * to_foot)
        foot = state.shape[0] - 1
        return (
            state[i, 0] + stretch * (state[foot, 0] - state[i, 0]),
            state[i, 1] + stretch * (state[foot, 1] - state[i, 1]),
            state[i, 2] + stretch * (state[foot, 2] - state[i, 2]),
            bent[i, 3],
            True,
        )
    u_r = h0[r] if r >= 0 else 0.0
    value, l1, l2 = value_from(state, axes, g, i, p, q, r, h0[p], h0[q], u_r)
    put_foot(state, axes, p, q, r, l1, l2)
    foot = state.shape[0] - 1
    value -= g * distance(state, axes, i, foot)
    return state[foot, 0], state[foot, 1], state[foot, 2], value, True


@inner
def _claims_no_less(
    state,
    axes,
    cells,
    ring_ptr,
    ring,
    patch,
    clearance,
    h0,
    g,
    source,
    refused,
    i,
    a,
    px,
    py,
    pz,
    u,
):
    """Tell whether node a, too, is in sight of what gives node i its size u at P.

    Its own size tells if that is not larger; else it is looked for, if it is a node.
    """
    if _claim(state, a, px, py, pz, u, g) >= state[a, 3] * _SAME:
        return True
    p, q, r = source_of(source, axes, i)
    return q < 0 and sees(
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
        a,
        p,
        q,
        r,
        0.0,
        0.0,
    )


@inner
def _bend(
    state,
    axes,
    cells,
    ring_ptr,
    ring,
    patch,
    clearance,
    crease_ptr,
    crease,
    h0,
    g,
    source,
    refused,
    bent,
    j,
    k,
    keep,
):
    """Let the path to node k, which does not see the source of j, bend at j or on a crease.

    Creases at j and at the facet that hid the source, the last row of ``refused``, are tried.
    Returns the size; the source of k is set if that lowers k.
    """
    best = state[j, 3] + g * distance(state, axes, k, j)
    if best < state[k, 3] * keep:
        set_source(source, k, j, NONE, NONE)
    last = refused.shape[0] - 1
    f0 = np.int64(refused[last, 0])
    f1 = np.int64(refused[last, 1]) if f0 >= 0 else f0
    f2 = np.int64(refused[last, 2]) if f0 >= 0 else f0
    for turn in range(4):
        i = j if turn == 0 else (f0 if turn == 1 else (f1 if turn == 2 else f2))
        if i < 0 or state[i, 3] > state[j, 3] or (turn > 0 and i == j):
            continue
        px, py, pz, u, has_image = image_of(state, axes, h0, g, source, bent, i)
        if not has_image:
            continue
        for place in range(crease_ptr[i], crease_ptr[i + 1]):
            b = np.int64(crease[place])
            value, a, b, t = along_creases(state, crease_ptr, crease, k, i, b, px, py, pz, u, g)
            if b < 0 or value >= best or value >= state[k, 3] * keep:
                continue
            if (
                _claims_no_less(
                    state,
                    axes,
                    cells,
                    ring_ptr,
                    ring,
                    patch,
                    clearance,
                    h0,
                    g,
                    source,
                    refused,
                    i,
                    a,
                    px,
                    py,
                    pz,
                    u,
                )
                and _claims_no_less(
                    state,
                    axes,
                    cells,
                    ring_ptr,
                    ring,
                    patch,
                    clearance,
                    h0,
                    g,
                    source,
                    refused,
                    i,
                    b,
                    px,
                    py,
                    pz,
                    u,
                )
                and sees(
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
                    k,
                    a,
                    b,
                    BEND,
                    t,
                    0.0,
                )
            ):
                best = value
                set_source(source, k, a, b, BEND)
                bent[k, 0] = px
                bent[k, 1] = py
                bent[k, 2] = pz
                bent[k, 3] = u
                r0, r1, r2 = source_of(source, axes, i)
                bends_before = r2 == BEND
                bent[k, 4] = bent[i, 4] if bends_before else r0
                bent[k, 5] = bent[i, 5] if bends_before else r1
                bent[k, 6] = bent[i, 6] if bends_before else r2
    return best


@inner
def reach(
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
    p,
    q,
    r,
    l1,
    l2,
    value,
    keep,
):
    """Give node k the source of j, straight or by a path that bends, past obstacles.

    Returns the size; the source of k is set if that lowers k.
    """
    dim = len(axes)
    seen = False
    if len(axes) == 2 and q < 0:
        over = state[j, dim] + g * distance(state, axes, k, j)
        hider = _hider(state, nbr_ptr, nbr, outward, source, j, k, p)
        if hider >= 0:
            p = hider
        p = _slide(state, axes, outward, crease_ptr, crease, k, p, state[j, dim])
        if p >= 0:
            p, seen = _pull(
                state,
                axes,
                cells,
                ring_ptr,
                ring,
                patch,
                clearance,
                outward,
                h0,
                source,
                refused,
                k,
                p,
            )
            value = state[p, dim] + g * distance(state, axes, k, p)
        if p < 0 or value >= over:
            p = j
            value = over
            seen = True
        if value >= state[k, dim] * keep:
            return value
    if seen or sees(
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
        k,
        p,
        q,
        r,
        l1,
        l2,
    ):
        set_source(source, k, p, q, r)
        if len(axes) == 3 and r == BEND:
            for d in range(7):
                bent[k, d] = bent[j, d]
        return value
    if len(axes) == 2:
        return _wind(
            state,
            axes,
            cells,
            ring_ptr,
            ring,
            patch,
            clearance,
            outward,
            h0,
            g,
            source,
            refused,
            j,
            k,
            keep,
        )
    return _bend(
        state,
        axes,
        cells,
        ring_ptr,
        ring,
        patch,
        clearance,
        crease_ptr,
        crease,
        h0,
        g,
        source,
        refused,
        bent,
        j,
        k,
        keep,
    )
