"""Label-correcting marching over triangles with updates of higher order.

Like `march`, with additional data for each node k:

``gradient[k]`` : of the size, from the update that gave it; zeros where that is not
    known: at sources, and where the ray came from a node which is none.
``source[k]`` : the point source of the size: k itself where its own bound holds, -1
    where it came from no single node.

On surfaces gradients are vectors of the planes of headings.py.  The updates are not
monotone, so that marching could go on lowering nodes by less and less: each time that
a node is lowered it must be by twice as much as the time before, from rounding on, but
for updates straight from a neighbour, of which there are finitely many.
"""

import math

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.heap import pop, push_or_decrease
from adaptsize._kernels.local_updates import distance
from adaptsize._kernels.local_updates_higher import (
    edge_frame,
    gradient_behind,
    minimum_from_source,
    minimum_on_cubic,
    minimum_on_linear,
)

# How far a source reaches: only nodes next to it use it; all behind it do; and edges
# between the regions of two sources use both, each as if it reached beyond its region.
NEXT, BEHIND, BEYOND = 0, 1, 2

# What the gradient limit is given for: everything at once, each cell, each node.
ONE_LIMIT, PER_CELL, PER_NODE = 0, 1, 2

# A node must be lowered by more than rounding the first time, by half a per cent the 40th.
_ROUNDING = 1e-14
_MOST_LOWERINGS = 40

# Square of the cosine of an angle that is clearly acute, 60 degrees.
_CLEARLY_ACUTE = 0.25


@inner
def gradient_at(points, axes, heading, entry, v, k, a, b, s, g_k, g_a, g_b):
    """Return the gradient at node k of a size that came straight from a point of an edge.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    heading : float64[3 m, 2, 2] or float64[0, 2, 2]
        See `fill_headings`; empty in the plane.
    entry, v : int
        The entry in the star of k, and the place of a in it.
    k, a, b : int
        Node, and ends of the edge.
    s : float
        The point, as a fraction of the edge from a to b.
    g_k, g_a, g_b : float

    Returns
    -------
    x, y : float
    """
    frame = edge_frame(points, axes, k, a, b)
    length2, foot, height2 = frame
    along, across = gradient_behind(frame, s, g_k, g_a, g_b)
    if length2 <= 0.0:
        return 0.0, 0.0
    length = math.sqrt(length2)
    height = math.sqrt(height2)
    if len(axes) == 2:
        e_x = (points[b, 0] - points[a, 0]) / length
        e_y = (points[b, 1] - points[a, 1]) / length
        if e_x * (points[k, 1] - points[a, 1]) < e_y * (points[k, 0] - points[a, 0]):
            across = -across
        return along * e_x - across * e_y, along * e_y + across * e_x
    # Seen from k, node a lies at (-foot length, -height): turn from its heading.
    far = math.sqrt(foot * foot * length2 + height2)
    if far <= 0.0:
        return 0.0, 0.0
    cosine = -(along * foot * length + across * height) / far
    sine = (along * height - across * foot * length) / far
    h_x = heading[entry, v, 0]
    h_y = heading[entry, v, 1]
    if h_x * heading[entry, 1 - v, 1] < h_y * heading[entry, 1 - v, 0]:
        sine = -sine
    return h_x * cosine - h_y * sine, h_x * sine + h_y * cosine


@inner
def _rays_over(points, axes, twin, heading, gradient, entry, v, k, j, a, length2):
    """Return the gradients at the ends of an edge, along it and across it towards a node.

    Parameters
    ----------
    points, axes, twin, heading, gradient
        As in `march_higher`.
    entry, v : int
        Entry of the star of j in which k stands at place v and a at the other.
    k, j, a : int
    length2 : float
        Square of the length of the edge.

    Returns
    -------
    along_j, along_a, across_j, across_a : float
        Times the length of the edge.
    """
    if len(axes) == 2:
        x = points[a, 0] - points[j, 0]
        y = points[a, 1] - points[j, 1]
        side = x * (points[k, 1] - points[j, 1]) - y * (points[k, 0] - points[j, 0])
        x_a = x
        y_a = y
        side_a = side
    else:
        length = math.sqrt(length2)
        x = heading[entry, 1 - v, 0] * length
        y = heading[entry, 1 - v, 1] * length
        side = x * heading[entry, v, 1] - y * heading[entry, v, 0]
        there = twin[entry, 1 - v]  # in the star of a: j at place v, k at the other
        x_a = -heading[there, v, 0] * length
        y_a = -heading[there, v, 1] * length
        side_a = x_a * heading[there, 1 - v, 1] - y_a * heading[there, 1 - v, 0]
    along_j = gradient[j, 0] * x + gradient[j, 1] * y
    along_a = gradient[a, 0] * x_a + gradient[a, 1] * y_a
    across_j = gradient[j, 1] * x - gradient[j, 0] * y
    across_a = gradient[a, 1] * x_a - gradient[a, 0] * y_a
    if side < 0.0:
        across_j = -across_j
    if side_a < 0.0:
        across_a = -across_a
    return along_j, along_a, across_j, across_a


@inner
def _share_cell(star_ptr, star, j, a, z):
    """Return whether the nodes j, a, z are those of a cell."""
    for e in range(star_ptr[j], star_ptr[j + 1]):
        if (star[e, 0] == a and star[e, 1] == z) or (star[e, 0] == z and star[e, 1] == a):
            return True
    return False


@inner
def _stands_alone(star_ptr, star, source, h, z):
    """Return whether no neighbour of the source z is a source."""
    for e in range(star_ptr[z], star_ptr[z + 1]):
        for v in range(2):
            i = star[e, v]
            if source[i] == i and h[i] < math.inf:
                return False
    return True


@kernel
def march_higher(
    points,
    axes,
    star_ptr,
    star,
    owner,
    twin,
    heading,
    bends,
    reach,
    limits,
    floor,
    h,
    gradient,
    source,
    lowered,
    g,
    mode,
    key,
    node,
    place,
    size,
    max_pops,
):
    """Accept nodes in order of size and lower their neighbours; at most ``max_pops`` nodes.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    star_ptr, star, owner
        Stars of the nodes (see `fill_stars`).
    twin, heading
        See headings.py; both empty in the plane.
    bends : bool[n]
        Where paths bend: such a node is the source of what comes straight from it.
    reach : int
        NEXT, BEHIND or BEYOND; see above.
    limits : tuple
        See `minimum_from_source`.
    floor : float
        Least size of all: slopes that contradict each other could lead below it.
    h : float64[n]
        In/Out.
    gradient, source
        In/Out; see above.
    lowered : uint8[n]
        In/Out: how often a node was lowered.
    g : float64[1], float64[m] or float64[n]
    mode : int
        ONE_LIMIT, PER_CELL (needs ``owner``) or PER_NODE (linear between nodes).
    key, node, place, size
        In/Out: the heap (see heap.py).
    max_pops : int

    Returns
    -------
    int
        Number of nodes accepted; less than ``max_pops`` if the heap is empty.
    """
    pops = 0
    while size[0] > 0 and pops < max_pops:
        j = pop(key, node, place, size)
        h_j = h[j]
        z_j = source[j]
        pops += 1
        for entry in range(star_ptr[j], star_ptr[j + 1]):
            for v in range(2):
                k = star[entry, v]
                a = star[entry, 1 - v]
                h_k = h[k]
                h_a = h[a]
                # Nodes in the heap are left out: the side is looked at again when they
                # are accepted.  So is what a offers by itself: it did when it was.
                alone = place[a] >= 0 or h_a == math.inf
                if h_k <= h_j:
                    if alone or h_k <= h_a:
                        continue
                    # Plane waves over the side reach k before j if the angle at k is acute,
                    # round ones if it is clearly so.
                    dot = to_j = to_a = 0.0
                    for d in range(len(axes)):
                        e_j = points[j, d] - points[k, d]
                        e_a = points[a, d] - points[k, d]
                        dot += e_j * e_a
                        to_j += e_j * e_j
                        to_a += e_a * e_a
                    if dot > 0.0 and dot * dot > _CLEARLY_ACUTE * to_j * to_a:
                        continue
                if mode == PER_NODE:
                    g_k, g_j, g_a = g[k], g[j], g[a]
                else:
                    g_k = g[owner[entry]] if mode == PER_CELL else g[0]
                    g_j = g_a = g_k
                c_j = 0.5 * (g_k + g_j)
                straight = h_j + c_j * distance(points, axes, k, j)
                value = straight
                s = 0.0
                z = -1
                frame = (0.0, 0.0, 0.0)
                if not alone:
                    frame = edge_frame(points, axes, k, j, a)
                length2, foot, height2 = frame
                if length2 > 0.0:
                    along_j, along_a, across_j, across_a = _rays_over(
                        points, axes, twin, heading, gradient, entry, v, k, j, a, length2
                    )
                    # A gradient is of use only if its ray goes over the edge towards k.
                    known = across_j > 0.0 and across_a > 0.0
                    c_rise = 0.5 * (g_a - g_j)
                    z_a = source[a]
                    found = math.inf
                    t = 0.0
                    done = False
                    one = z_j >= 0 and z_j == z_a
                    if one:
                        n_ends = 1 if reach != NEXT or _share_cell(star_ptr, star, j, a, z_j) else 0
                    else:
                        n_ends = 2 if reach == BEYOND and z_j >= 0 and z_a >= 0 else 0
                    for end in range(n_ends):
                        if end == 0:
                            i, o, z_i, h_i, h_o = j, a, z_j, h_j, h_a if one else math.inf
                            along_i, along_o, across_i = along_j, along_a, across_j
                            seen, c_i, c_step = frame, c_j, c_rise
                        else:
                            i, o, z_i, h_i, h_o = a, j, z_a, h_a, math.inf
                            along_i, along_o, across_i = -along_a, -along_j, across_a
                            seen, c_i, c_step = (
                                (length2, 1.0 - foot, height2),
                                c_j + c_rise,
                                -c_rise,
                            )
                        if z_i in (i, o) or not (one or across_i > 0.0):
                            continue
                        from_i, t_i = minimum_from_source(
                            points, axes, seen, i, o, z_i, h[z_i], h_i, h_o, along_i, along_o,
                            known or not one, c_i, c_step, limits, reach == BEYOND,
                        )  # fmt: skip
                        if from_i < found:
                            found = from_i
                            t = t_i if end == 0 else 1.0 - t_i
                            z = z_i
                    if one:
                        done = found < math.inf
                    elif n_ends == 2:
                        # Between regions of single nodes nothing else comes over the edge.
                        # The sizes of sources side by side are data along the line of them.
                        done = _stands_alone(star_ptr, star, source, h, z_j) and (
                            _stands_alone(star_ptr, star, source, h, z_a)
                        )
                    if not done:
                        if known:
                            between, t_b = minimum_on_cubic(
                                length2, foot, height2, h_j, h_a - h_j, along_j, along_a,
                                along_j / across_j, along_a / across_a, c_j, c_rise,
                            )  # fmt: skip
                        else:
                            between, t_b = minimum_on_linear(
                                length2, foot, height2, h_j, h_a - h_j, c_j, c_rise
                            )
                        if between < found:
                            found = between
                            t = t_b
                            z = -1
                    if floor <= found < value:
                        value = found
                        s = t
                if value >= h_k * (1.0 - _ROUNDING):
                    continue
                lead = _ROUNDING * (1 << lowered[k])
                if lowered[k] >= _MOST_LOWERINGS or value >= h_k * (1.0 - lead):
                    value = straight
                    s = 0.0
                    z = -1
                    if value >= h_k * (1.0 - _ROUNDING):
                        continue
                else:
                    lowered[k] += 1
                h[k] = value
                push_or_decrease(key, node, place, size, k, value)
                near = j if s < 0.5 else a
                if 0.0 < s < 1.0:
                    if reach == NEXT:
                        z = -1
                    elif (
                        reach == BEHIND
                        and z < 0
                        and min(z_j, source[a]) >= 0
                        and (bends[z_j] or bends[source[a]])
                    ):
                        z = source[near]  # on a line of shadow both sources agree
                elif source[near] == near or bends[near]:
                    z = near
                else:
                    # The ray came from elsewhere: its direction is not known.
                    source[k] = source[near] if reach != NEXT else -1
                    gradient[k, 0] = 0.0
                    gradient[k, 1] = 0.0
                    continue
                source[k] = z
                there = twin[entry, v] if len(axes) > 2 else entry
                x, y = gradient_at(points, axes, heading, there, 1 - v, k, j, a, s, g_k, g_j, g_a)
                gradient[k, 0] = x
                gradient[k, 1] = y
    return pops
