"""The largest sphere that touches a boundary at a given point and holds no other point of it.

Points are float64[n, 3]; planes are padded with zeros.  Of all balls that are tangent to the
boundary at a point p with inward normal n, the one through another point q has the radius

    r(q) = |q - p|^2 / (2 n . (q - p)),

and smaller balls lie in larger ones.  Hence one descent through a tree of boxes, in which
the ball only shrinks and boxes outside of it are left out, finds the least r(q).

The angle under which the centre sees p and q, the separation angle, is twice that between q - p
and the tangent plane at p: a bound on the one is a bound on the other, and boxes low over that
plane are left out before they are opened.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.distance import closest_on_segment, closest_on_triangle

# A path from the root to a leaf leaves one node behind per level.
_STACK = 64
# Radii may come out larger than the least one by this share.  Without it all boxes would be opened
# where the ball touches the boundary all around, as in a sphere.
_EXCESS = 1e-2
_MAX_STEPS = 40
# Squared sine of the angle over the tangent plane from which on a facet is opposite: 60 degrees.
# Only such facets count at creases, where the normal is that of one side and, on rough
# surfaces, the next facets stand across it.
_OPPOSITE = 0.75
# Corners around a point are remembered for walls of so many directions.
_DIRECTIONS = 12


@kernel
def fill_slabs(points, cells, normals, measures, slabs):
    """Fill a direction, and the interval that the cells take along it, for each node of a tree.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        In the order of the tree.
    normals : float64[m, 3]
        Unit normals, zero if there is none.
    measures : float64[m]
        Their weights.
    slabs : float64[2 * n_leaves, 5]
        Out: direction (zero: none), lower and upper end; row 0 is not used.
    """
    m, width = cells.shape
    n_leaves = slabs.shape[0] // 2
    for node in range(2 * n_leaves - 1, 0, -1):
        leaves, first = 1, node
        while first < n_leaves:
            first *= 2
            leaves *= 2
        begin = (first - n_leaves) * m // n_leaves
        end = (first - n_leaves + leaves) * m // n_leaves
        u = np.zeros(3)
        for c in range(begin, end):
            for d in range(3):
                u[d] += measures[c] * normals[c, d]
        length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        low, high = math.inf, -math.inf
        for d in range(3):
            u[d] = u[d] / length if length > 0.0 else 0.0
            slabs[node, d] = u[d]
        for c in range(begin, end):
            for v in range(width):
                i = cells[c, v]
                along = u[0] * points[i, 0] + u[1] * points[i, 1] + u[2] * points[i, 2]
                low = min(low, along)
                high = max(high, along)
        slabs[node, 3] = low
        slabs[node, 4] = high


@inner
def _is_near(points, cells, boxes, x, within, stack):
    """Return whether a segment comes as near to x as ``within``.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 2]
        In the order of the tree; the ends of a segment may be one point.
    boxes : float64[2 * n_leaves, 6]
    x : tuple of 3 float64
    within : float64
    stack : int64[64]
        Scratch.
    """
    n_leaves = boxes.shape[0] // 2
    stack[0] = 1
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        total = 0.0
        for d in range(3):
            gap = max(boxes[node, d] - x[d], x[d] - boxes[node, 3 + d])
            if gap > 0.0:
                total += gap * gap
        if total > within * within:
            continue
        if node < n_leaves:
            stack[top] = 2 * node
            stack[top + 1] = 2 * node + 1
            top += 2
            continue
        m = cells.shape[0]
        leaf = node - n_leaves
        for c in range(leaf * m // n_leaves, (leaf + 1) * m // n_leaves):
            if closest_on_segment(points, cells[c, 0], cells[c, 1], x)[0] <= within * within:
                return True
    return False


@inner
def _touch(points, cells, t, p, n, bound, r):
    """Shrink the ball at p until it touches cell t; return the radius and the point.

    Parameters
    ----------
    points : float64[m, 3]
    cells : int32[m, 2 or 3]
    t : int
    p, n : tuple of 3 float64
        Point and unit normal.
    bound : float64
        Radius of the ball that touches the plane of the cell.
    r : float64
        Radius of a larger ball.

    Returns
    -------
    float64, float64, float64, float64
        ``r`` and p if it does not reach into that ball.
    """
    q = p
    rr = bound
    for step in range(_MAX_STEPS):
        c = (p[0] + rr * n[0], p[1] + rr * n[1], p[2] + rr * n[2])
        a, b = cells[t, 0], cells[t, 1]
        if cells.shape[1] == 2:
            d2, s, u = closest_on_segment(points, a, b, c)
            w, e = 0.0, b
        else:
            e = cells[t, 2]
            d2, s, u, w = closest_on_triangle(points, a, b, e, c)
        if step == 0:
            if d2 > (bound * (1.0 + 1e-9)) ** 2:  # the cell ends beside that point of its plane
                rr = r
                continue
        elif d2 >= (rr * (1.0 - 1e-7)) ** 2:
            break
        q = (
            s * points[a, 0] + u * points[b, 0] + w * points[e, 0],
            s * points[a, 1] + u * points[b, 1] + w * points[e, 1],
            s * points[a, 2] + u * points[b, 2] + w * points[e, 2],
        )
        if step == 0:
            break
        v = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
        above = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
        rr = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) / (2.0 * above)
    return rr, q[0], q[1], q[2]


@inner
def _radius_between(held, last, widest):
    """Return the radius of the ball on the tangent plane that fits between two walls.

    A ball at p meets a wall at a distance s = r cot(a / 2) of p from a corner of angle a.  One
    that rolls away from p meets two opposite walls where r is the mean of both radii, weighted by
    the cotangents.

    Parameters
    ----------
    held : float64[k, 6]
        As for `_holding_wall`.
    last : int
        What that returned; the other wall is the nearer one most opposite to it.
    widest : float64
        Less than 2 pi - ``widest`` apart are no opposite walls.

    Returns
    -------
    float64
        The radius of the last wall if none is opposite.
    """
    best = 2.0 * math.pi - widest - 1e-5
    radius = held[last, 0]
    for k in range(held.shape[0]):
        if held[k, 0] <= held[last, 0]:
            apart = abs(held[k, 1] - held[last, 1])
            apart = min(apart, 2.0 * math.pi - apart)
            if apart > best:
                best = apart
                total = held[k, 5] + held[last, 5]
                radius = (held[k, 5] * held[k, 0] + held[last, 5] * held[last, 0]) / total
    return radius


@inner
def _tangents(n):
    """Return two unit vectors that are perpendicular to a unit vector and to each other."""
    if abs(n[2]) < 0.9:  # in the plane, n[2] = 0, the second one is the normal of the plane
        length = math.hypot(n[0], n[1])
        a = (-n[1] / length, n[0] / length, 0.0)
    else:
        length = math.hypot(n[1], n[2])
        a = (0.0, -n[2] / length, n[1] / length)
    b = (
        n[1] * a[2] - n[2] * a[1],
        n[2] * a[0] - n[0] * a[2],
        n[0] * a[1] - n[1] * a[0],
    )
    return a, b


@inner
def _holding_wall(held, widest):
    """Return the last of the walls that leave no gap between them that is too wide.

    Parameters
    ----------
    held : float64[k, 6]
        Radius at which the ball meets the wall, inf: none; direction of the wall; where it
        meets it; cotangent of half the angle in the corner.  Sorted by direction, 0 to 2 pi.
    widest : float64
        Gap between the directions of neighbouring walls that is not too wide.

    Returns
    -------
    int
        That with the largest radius of the nearest walls that do; -1: there are none.
    """
    best = math.inf
    last = -1
    for i in range(held.shape[0]):
        if held[i, 0] >= best:
            continue
        # All walls up to this radius, from the last one around to the first.
        before = math.inf
        largest = 0.0
        for k in range(2 * held.shape[0]):
            j = k % held.shape[0]
            if held[j, 0] <= held[i, 0]:
                direction = held[j, 1] + (2.0 * math.pi if k >= held.shape[0] else 0.0)
                if not math.isinf(before):
                    largest = max(largest, direction - before)
                before = direction
        if largest <= widest:
            best = held[i, 0]
            last = i
    return last


@kernel
def shrink_balls(
    points, cells, normals, boxes, slabs, edge_points, edges, edge_boxes, tips,
    probes, origins, probe_normals, probe_cells, reaches, tip_of, angles, largest,
    order, first, last, radii, contacts, touched,
):  # fmt: skip
    """Fill the radius of the largest ball at each probe that holds nothing of the boundary.

    Cells that meet the tangent plane at the probe in a corner are walls.  They count only where
    they stand on all sides of the ball.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k + 1]
        Segments or triangles, in the order of the tree.
    normals : float64[m, 3]
        Unit normals to the side where balls grow; zero: the cell does not count.
    boxes : float64[2 * n_leaves, 6]
    slabs : float64[2 * n_leaves, 5]
    edge_points, edges, edge_boxes : float64[n_e, 3], int32[m_e, 2], float64[2 * n_e_leaves, 6]
        Edges along which the boundary bends, and their tree; m_e may be 0.
    tips : float64[n_tips, 3]
        Tips of cones.
    probes, origins, probe_normals : float64[n_probes, 3]
        A probe at a crease stands a little beside its origin; cells that hold the origin
        are walls at most.
    probe_cells : int32[n_probes]
        Cell that holds each probe, -1 at nodes.  Cells are on its side, and are left out, that
        turn by less than the separation angle from it, or hang together with it and turn by
        less than a crease; the normal at the probe may turn from that of its cell as well.
    reaches : float64[n_probes]
        Distance of each probe to the edges.
    tip_of : int32[n_probes]
        Nearest tip, -1: none.
    angles : float64[6]
        Least sine of the angle between q - p and the tangent plane; cosine of the least
        opening angle of a corner; distance of edges from the line where the planes of p and q
        meet, over that of p or q; distance of tips from p and q, over the radius; widest gap
        between walls that hold a ball; cosine of the turn of a crease.
    largest : float64
        Radius to start from.
    order : int64[n_probes]
        Neighbours should follow each other: what one touches is the first guess for the next.
    first, last : int
        Only ``order[first:last]`` is processed.
    radii : float64[n_probes]
        Out: inf where no cell is met.  Between opposite walls that of a ball beside the probe.
    contacts : float64[n_probes, 3]
        Out: where the ball touches the boundary again; the probe itself where nothing is met.
    touched : int32[n_probes]
        Out: cell that the ball touches, -1: none; between walls, one of them.
    """
    stack = np.empty(_STACK, np.int64)
    edge_stack = np.empty(_STACK, np.int64)
    held = np.empty((_DIRECTIONS, 6))
    m, width = cells.shape
    n_leaves = boxes.shape[0] // 2
    sine, cosine, share = angles[0], angles[1], angles[2]
    tip_share, gap_of_walls, smooth = angles[3], angles[4], angles[5]
    flat = math.sqrt(1.0 - sine * sine)
    guess = -1
    for place in range(first, last):
        i = order[place]
        p = (probes[i, 0], probes[i, 1], probes[i, 2])
        n = (probe_normals[i, 0], probe_normals[i, 1], probe_normals[i, 2])
        r = largest
        radius = math.inf
        found = -1
        at = p
        e1, e2 = _tangents(n)
        at_crease = False
        for d in range(3):
            at_crease = at_crease or probes[i, d] != origins[i, d]
        for k in range(_DIRECTIONS):
            held[k, 0] = math.inf
        stack[0] = 1
        top = 1
        if guess >= 0:
            stack[1] = -1
            top = 2
        while top > 0:
            top -= 1
            node = stack[top]
            begin, end = guess, guess + 1
            if node > 0:
                # Is any of it in the ball, and high enough over the tangent plane?
                to_centre, to_probe, from_probe = 0.0, 0.0, 0.0
                highest, lowest, along = 0.0, 0.0, 0.0
                for d in range(3):
                    low, high = boxes[node, d], boxes[node, 3 + d]
                    centre = p[d] + r * n[d]
                    gap = max(low - centre, centre - high)
                    if gap > 0.0:
                        to_centre += gap * gap
                    gap = max(low - p[d], p[d] - high)
                    if gap > 0.0:
                        to_probe += gap * gap
                    from_probe += max(high - p[d], p[d] - low) ** 2
                    above, below = (high, low) if n[d] > 0.0 else (low, high)
                    highest += n[d] * (above - p[d])
                    lowest += n[d] * (below - p[d])
                    along += slabs[node, d] * centre
                if highest <= 0.0 or highest * highest < sine * sine * to_probe:
                    continue
                # What reaches as deep as b r into a ball, at an angle a over the tangent plane,
                # makes it smaller by the share b / (2 sin(a)^2).
                depth = max(sine, lowest / math.sqrt(from_probe)) if from_probe > 0.0 else sine
                reach = r * (1.0 - 2.0 * _EXCESS * depth * depth)
                if to_centre >= reach * reach:
                    continue
                if max(slabs[node, 3] - along, along - slabs[node, 4]) >= reach:
                    continue
                if node < n_leaves:
                    near, far = 2 * node, 2 * node + 1
                    to_near, to_far = 0.0, 0.0
                    for d in range(3):
                        to_near += abs(boxes[near, d] + boxes[near, 3 + d] - 2.0 * p[d])
                        to_far += abs(boxes[far, d] + boxes[far, 3 + d] - 2.0 * p[d])
                    if to_far < to_near:
                        near, far = far, near
                    stack[top] = far
                    stack[top + 1] = near
                    top += 2
                    continue
                begin = (node - n_leaves) * m // n_leaves
                end = (node - n_leaves + 1) * m // n_leaves
            for t in range(begin, end):
                a = cells[t, 0]
                height, cos, at_origin = 0.0, 0.0, 0.0
                for d in range(3):
                    height += normals[t, d] * (p[d] - points[a, d])
                    at_origin += normals[t, d] * (origins[i, d] - points[a, d])
                    cos += normals[t, d] * n[d]
                own = probe_cells[i]
                if own >= 0:
                    turn = 0.0
                    for d in range(3):
                        turn += normals[t, d] * normals[own, d]
                    same_side = t == own or turn >= flat
                    if turn > smooth:
                        for k in range(width * width):
                            same_side = same_side or cells[t, k // width] == cells[own, k % width]
                    if same_side:
                        continue
                # Seen from behind, in the tangent plane, or without a normal; no steeper than
                # the separation angle, and so not higher over the tangent plane; out of the ball.
                if height <= 1e-9 * largest or cos >= flat:
                    continue
                if height >= (1.0 - _EXCESS) * r * (1.0 - cos):
                    continue
                # Small, as seen from p, and low over the tangent plane?
                highest, to_probe, extent = 0.0, math.inf, 0.0
                for k in range(width):
                    b = cells[t, k]
                    above, way, length = 0.0, 0.0, 0.0
                    for d in range(3):
                        above += n[d] * (points[b, d] - p[d])
                        way += (points[b, d] - p[d]) ** 2
                        length += (points[b, d] - points[a, d]) ** 2
                    highest = max(highest, above)
                    to_probe = min(to_probe, way)
                    extent = max(extent, length)
                if extent < 0.04 * to_probe and highest * highest < sine * sine * to_probe:
                    continue
                bound = height / (1.0 - cos)
                rr, x, y, z = _touch(points, cells, t, p, n, bound, r)
                if rr >= r:
                    continue
                v = (x - p[0], y - p[1], z - p[2])
                above = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
                if above * above < sine * sine * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]):
                    continue
                # Does its plane meet the tangent plane at an edge, seen from q or from p?
                sin2 = 1.0 - cos * cos
                in_corner = abs(at_origin) <= 1e-9 * largest
                if in_corner and (cos >= cosine or sin2 <= 1e-12):
                    continue  # beside the probe, on the same side of the crease
                if -cos < cosine and sin2 > 1e-12 and not in_corner:
                    for seen_from in range(2):
                        way = 0.0
                        if seen_from == 0:
                            far = above / sin2
                            foot = (
                                x - far * (n[0] - cos * normals[t, 0]),
                                y - far * (n[1] - cos * normals[t, 1]),
                                z - far * (n[2] - cos * normals[t, 2]),
                            )
                        else:
                            far = height / sin2
                            foot = (
                                p[0] - far * (normals[t, 0] - cos * n[0]),
                                p[1] - far * (normals[t, 1] - cos * n[1]),
                                p[2] - far * (normals[t, 2] - cos * n[2]),
                            )
                        for d in range(3):
                            way += (foot[d] - p[d]) ** 2
                        within = share * far * math.sqrt(sin2)
                        if reaches[i] <= math.sqrt(way) + within and not in_corner:
                            in_corner = _is_near(
                                edge_points, edges, edge_boxes, foot, within, edge_stack
                            )
                    if tip_of[i] >= 0 and not in_corner:
                        k = tip_of[i]
                        from_p, from_q = 0.0, 0.0
                        for d in range(3):
                            from_p += (tips[k, d] - p[d]) ** 2
                        from_q = (
                            (tips[k, 0] - x) ** 2 + (tips[k, 1] - y) ** 2 + (tips[k, 2] - z) ** 2
                        )
                        in_corner = max(from_p, from_q) <= (tip_share * rr) ** 2
                if in_corner:
                    # One corner does not stop the ball, walls on all sides do.
                    u, v = 0.0, 0.0
                    for d in range(3):
                        u += normals[t, d] * e1[d]
                        v += normals[t, d] * e2[d]
                    direction = math.atan2(v, u) + math.pi
                    k = min(int(direction * _DIRECTIONS / (2.0 * math.pi)), _DIRECTIONS - 1)
                    if rr >= held[k, 0]:
                        continue
                    held[k, 0], held[k, 1] = rr, direction
                    held[k, 2], held[k, 3], held[k, 4] = x, y, z
                    held[k, 5] = math.sqrt((1.0 - cos) / (1.0 + cos))
                    k = _holding_wall(held, gap_of_walls)
                    if k < 0 or held[k, 0] > r:
                        continue
                    between = _radius_between(held, k, gap_of_walls)
                    if held[k, 0] == r:  # the nearer wall has come nearer
                        radius = min(radius, between)
                        continue
                    rr, x, y, z = held[k, 0], held[k, 2], held[k, 3], held[k, 4]
                else:
                    if at_crease and above * above < _OPPOSITE * (
                        v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
                    ):
                        continue
                    between = rr
                if rr >= r:
                    continue
                r = rr
                radius = between
                found = t
                at = (x, y, z)
        touched[i] = found
        radii[i] = radius
        contacts[i, 0], contacts[i, 1], contacts[i, 2] = at[0], at[1], at[2]
        if found >= 0:
            guess = found
