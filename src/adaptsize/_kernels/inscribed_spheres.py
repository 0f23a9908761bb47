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

from adaptsize._kernels.compiling import inner, kernel, part
from adaptsize._kernels.corner_edges import meet_at_edge
from adaptsize._kernels.corner_walls import (
    N_DIRECTIONS,
    SMALLER,
    add_wall,
    holding_wall,
    radius_between,
    tangents,
)
from adaptsize._kernels.distance import closest_on_segment, closest_on_triangle
from adaptsize._kernels.sphere_trees import EXCESS, cannot_shrink, nearer_half

# A path from the root to a leaf leaves one node behind per level.
_STACK = 64
_MAX_STEPS = 40
# Squared sine of the angle over the tangent plane from which on a facet is opposite: 60 degrees.
# Only such facets count at feature edges, where the normal is that of one side and, on rough
# surfaces, the next facets stand across it.
_OPPOSITE = 0.75


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
        elif d2 >= rr * rr:
            break
        q = (
            s * points[a, 0] + u * points[b, 0] + w * points[e, 0],
            s * points[a, 1] + u * points[b, 1] + w * points[e, 1],
            s * points[a, 2] + u * points[b, 2] + w * points[e, 2],
        )
        if step == 0:
            break
        touches = d2 >= (rr * (1.0 - 1e-7)) ** 2  # the next radius is accurate to rounding
        v = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
        above = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
        if not above > 0.0:  # rounding, far from the origin
            break
        rr = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) / (2.0 * above)
        if touches:
            break
    return rr, q[0], q[1], q[2]


@part
def _is_on_side(cells, normals, t, own, flat, smooth):
    """Return whether cell t continues the side of the boundary that holds the probe.

    It does if it turns from cell ``own`` by less than the separation angle, of cosine ``flat``,
    or if it has a node in common with it and turns by less than the crease angle, of cosine
    ``smooth``.
    """
    turn = 0.0
    for d in range(3):
        turn += normals[t, d] * normals[own, d]
    if t == own or turn >= flat:
        return True
    if turn > smooth:
        width = cells.shape[1]
        for k in range(width * width):
            if cells[t, k // width] == cells[own, k % width]:
                return True
    return False


@part
def _is_small_and_low(points, cells, t, p, n, sine):
    """Return whether a cell is small as seen from p, and low over the tangent plane there."""
    a = cells[t, 0]
    highest, to_probe, extent = 0.0, math.inf, 0.0
    for k in range(cells.shape[1]):
        b = cells[t, k]
        above, way, length = 0.0, 0.0, 0.0
        for d in range(3):
            above += n[d] * (points[b, d] - p[d])
            way += (points[b, d] - p[d]) ** 2
            length += (points[b, d] - points[a, d]) ** 2
        highest = max(highest, above)
        to_probe = min(to_probe, way)
        extent = max(extent, length)
    return extent < 0.04 * to_probe and highest * highest < sine * sine * to_probe


@part
def _are_same(probes, normals, cells, i, j):
    """Return whether probes i and j are the same."""
    for d in range(3):
        if probes[i, d] != probes[j, d] or normals[i, d] != normals[j, d]:
            return False
    return cells[i] == cells[j]


@part
def _are_near_tip(tips, k, p, q, within):
    """Return whether both p and q are as near to tip k as ``within``."""
    from_p, from_q = 0.0, 0.0
    for d in range(3):
        from_p += (tips[k, d] - p[d]) ** 2
        from_q += (tips[k, d] - q[d]) ** 2
    return max(from_p, from_q) <= within * within


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
        A probe at a feature edge lies a little beside its origin; cells that hold the
        origin are walls at most.
    probe_cells : int32[n_probes]
        Cell that holds each probe, -1 at nodes.  Cells are on its side, and are left out, that
        turn by less than the separation angle from it, or have a node in common with it and
        turn by less than the crease angle.  The normal at the probe may differ from that of
        its cell.
    reaches : float64[n_probes]
        Distance of each probe to the edges.
    tip_of : int32[n_probes]
        Nearest tip, -1: none.
    angles : float64[6]
        Least sine of the angle between q - p and the tangent plane; cosine of the least
        opening angle of a corner; distance of edges from the line where the planes of p and q
        meet, over that of p or q; distance of tips from p and q, over the radius; widest gap
        between walls that hold a ball; cosine of the crease angle.
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
        In/Out: cell that the ball touches, -1: none; between walls, one of them.
    """
    stack = np.empty(_STACK, np.int64)
    edge_stack = np.empty(_STACK, np.int64)
    edges_found = np.full(2, -1, np.int32)
    held = np.empty((N_DIRECTIONS, 6))
    m = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    sine, cosine, share = angles[0], angles[1], angles[2]
    tip_share, gap_of_walls, smooth = angles[3], angles[4], angles[5]
    flat = math.sqrt(1.0 - sine * sine)
    # The result must not depend on how many probes one call processes.
    guess = touched[order[first - 1]] if first > 0 else -1
    for place in range(first, last):
        i = order[place]
        if place > 0 and _are_same(probes, probe_normals, probe_cells, i, order[place - 1]):
            j = order[place - 1]
            radii[i], touched[i] = radii[j], touched[j]
            for d in range(3):
                contacts[i, d] = contacts[j, d]
            continue
        p = (probes[i, 0], probes[i, 1], probes[i, 2])
        n = (probe_normals[i, 0], probe_normals[i, 1], probe_normals[i, 2])
        r = largest
        radius = math.inf
        found = -1
        at = p
        e1, e2 = tangents(n)
        at_feature_edge = False
        for d in range(3):
            at_feature_edge = at_feature_edge or probes[i, d] != origins[i, d]
        for k in range(N_DIRECTIONS):
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
                if cannot_shrink(boxes, slabs, node, p, n, r, sine):
                    continue
                if node < n_leaves:
                    near = nearer_half(boxes, node, p)
                    stack[top] = near ^ 1  # the other half
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
                if own >= 0 and _is_on_side(cells, normals, t, own, flat, smooth):
                    continue
                # Seen from behind, in the tangent plane, or without a normal; no steeper than
                # the separation angle, and so not higher over the tangent plane; out of the ball.
                if height <= 1e-9 * largest or cos >= flat:
                    continue
                if height >= (1.0 - EXCESS) * r * (1.0 - cos):
                    continue
                if _is_small_and_low(points, cells, t, p, n, sine):
                    continue
                bound = height / (1.0 - cos)
                rr, x, y, z = _touch(points, cells, t, p, n, bound, r)
                if rr >= SMALLER * r:
                    continue
                v = (x - p[0], y - p[1], z - p[2])
                above = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
                way2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
                if above * above < sine * sine * way2:
                    continue
                parallel = 1.0 - cos * cos <= 1e-12
                in_corner = abs(at_origin) <= 1e-9 * largest
                if in_corner and (cos >= cosine or parallel):
                    continue  # beside the probe, on the same side of the feature edge
                normal = (normals[t, 0], normals[t, 1], normals[t, 2])
                if -cos < cosine and not parallel and not in_corner:
                    q = (x, y, z)
                    in_corner = meet_at_edge(
                        edge_points, edges, edge_boxes, p, n, q, normal, above, height, cos, share,
                        reaches[i], edge_stack, edges_found,
                    )  # fmt: skip
                    if tip_of[i] >= 0 and not in_corner:
                        in_corner = _are_near_tip(tips, tip_of[i], p, q, tip_share * rr)
                between = rr
                if in_corner:
                    u = normal[0] * e1[0] + normal[1] * e1[1] + normal[2] * e1[2]
                    w = normal[0] * e2[0] + normal[1] * e2[1] + normal[2] * e2[2]
                    direction = math.atan2(w, u) + math.pi
                    cotangent = math.sqrt((1.0 - cos) / (1.0 + cos))
                    if not add_wall(held, direction, rr, x, y, z, cotangent):
                        continue
                    k = holding_wall(held, gap_of_walls)
                    if k < 0 or SMALLER * held[k, 0] > r:
                        continue
                    between = radius_between(held, k, gap_of_walls)
                    if held[k, 0] >= SMALLER * r:  # the nearer wall has come nearer
                        radius = min(radius, between)
                        continue
                    rr, x, y, z = held[k, 0], held[k, 2], held[k, 3], held[k, 4]
                elif at_feature_edge and above * above < _OPPOSITE * way2:
                    continue
                if rr >= SMALLER * r:
                    continue
                r = rr
                radius = between
                found = t
                at = (x, y, z)
        touched[i] = found
        radii[i] = radius
        contacts[i, 0], contacts[i, 1], contacts[i, 2] = at[0], at[1], at[2]
        guess = found
