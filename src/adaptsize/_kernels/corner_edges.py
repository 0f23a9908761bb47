"""Whether a facet and the tangent plane at a probe meet at an edge of the boundary."""

import math

from adaptsize._kernels.compiling import inner, part
from adaptsize._kernels.distance import closest_on_segment


@inner
def _is_near(points, cells, boxes, x, within, stack, found, which):
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
    found : int32[k]
        In/Out: segments found before, which are tried first; -1: none.
    which : int
        Place of this search in ``found``.
    """
    m = cells.shape[0]
    n_leaves = boxes.shape[0] // 2
    c = found[which]
    if c >= 0 and closest_on_segment(points, cells[c, 0], cells[c, 1], x)[0] <= within * within:
        return True
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
        leaf = node - n_leaves
        for c in range(leaf * m // n_leaves, (leaf + 1) * m // n_leaves):
            if closest_on_segment(points, cells[c, 0], cells[c, 1], x)[0] <= within * within:
                found[which] = c
                return True
    return False


@part
def meet_at_edge(
    edge_points, edges, edge_boxes, p, n, q, normal, above, height, cos, share, reach, stack,
    found,
):  # fmt: skip
    """Return whether the tangent plane at p and the plane of q meet at an edge of the boundary.

    Parameters
    ----------
    edge_points, edges, edge_boxes
        As in `shrink_balls`.
    p, n, q, normal : tuple of 3 float64
        Probe, its unit normal, the other point, and the unit normal of its cell.
    above, height : float64
        Distance of q from the tangent plane, and of p from the plane of q.
    cos : float64
        Cosine of the angle between the normals.
    share : float64
        Distance of edges from the line where the planes meet, over that of p or q.
    reach : float64
        Distance of the probe to the edges.
    stack : int64[64]
        Scratch.
    found : int32[2]
        In/Out: edges found for q and p by the call before, -1: none.  The next cells are near by.
    """
    sin2 = 1.0 - cos * cos
    for seen_from in range(2):
        # The point of the line that is closest to q, or to p.
        if seen_from == 0:
            far = above / sin2
            foot = (
                q[0] - far * (n[0] - cos * normal[0]),
                q[1] - far * (n[1] - cos * normal[1]),
                q[2] - far * (n[2] - cos * normal[2]),
            )
        else:
            far = height / sin2
            foot = (
                p[0] - far * (normal[0] - cos * n[0]),
                p[1] - far * (normal[1] - cos * n[1]),
                p[2] - far * (normal[2] - cos * n[2]),
            )
        way = 0.0
        for d in range(3):
            way += (foot[d] - p[d]) ** 2
        within = share * far * math.sqrt(sin2)
        in_reach = reach <= math.sqrt(way) + within
        if in_reach and _is_near(
            edge_points, edges, edge_boxes, foot, within, stack, found, seen_from
        ):
            return True
    return False
