"""Whether the straight line from a node to a source stays inside a flat mesh.

The line is followed from cell to cell (a walk) until it reaches a cell of the source.
Lines within two balls around their ends that do not reach the boundary need no walk.
Most others end before, on the certificate of a facet that the line crosses.

* All nodes of the facet have the source.  They see it, so the sides of the hull of facet
  and source lie in the mesh; only a hole that fits into that hull as a whole, and so is
  narrower than the facet, can be overlooked.
* In the plane: the paths of the nodes of the edge pass the source, each on its own side of the
  line; or one node has the source, a corner around which its path bends, and the other has
  the source of that corner, or of that in turn.  The sides of the polygon of edge and paths
  lie in the mesh.  This is so along shadow lines.
* The sources of the nodes of the facet are nodes that keep their own bound, lie on the
  same piece of boundary (cut where that turns inwards by more than 30 degrees), and within
  3 lengths of the facet from the end of the line.

Positions are told by barycentric coordinates: that of vertex v is negative beyond the
facet opposite to v.  ``axes`` is a tuple of which only the length counts.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, part
from adaptsize._kernels.local import distance
from adaptsize._kernels.source import drop_zero_weights, put_foot, set_source

# Beyond a facet by less than this share of the height of the cell is not beyond it.
GRAZING = 1e-10

# Relative error allowed in finding the cell into which a line leaves its node.
_CONE = -1e-9

# Relative distance of a line from the sides of a cone that makes looking at others needless.
_CLEARLY = 1e-6

# Bends that the second certificate looks back.
_BENDS = 8

# Reach of the third certificate, in lengths of the facet.
_NEAR = 3.0


@part
def _has_node(cells, c, i):
    found = False
    for v in range(cells.shape[1]):
        found = found or cells[c, v] == i
    return found


@part
def coordinates_of_two(points, axes, cells, c, v, i, j):
    """Return the barycentric coordinates of nodes i and j for vertex v of cell c.

    -inf, twice, if the cell is degenerate.
    """
    k = len(axes) + 1
    top = np.int64(cells[c, v])
    a = np.int64(cells[c, (v + 1) % k])
    b = np.int64(cells[c, (v + 2) % k])
    ux = points[b, 0] - points[a, 0]
    uy = points[b, 1] - points[a, 1]
    if len(axes) == 2:
        nx, ny, nz = -uy, ux, 0.0
    else:
        d = np.int64(cells[c, (v + 3) % k])
        uz = points[b, 2] - points[a, 2]
        wx = points[d, 0] - points[a, 0]
        wy = points[d, 1] - points[a, 1]
        wz = points[d, 2] - points[a, 2]
        nx = uy * wz - uz * wy
        ny = uz * wx - ux * wz
        nz = ux * wy - uy * wx
    height = nx * (points[top, 0] - points[a, 0]) + ny * (points[top, 1] - points[a, 1])
    at_i = nx * (points[i, 0] - points[a, 0]) + ny * (points[i, 1] - points[a, 1])
    at_j = nx * (points[j, 0] - points[a, 0]) + ny * (points[j, 1] - points[a, 1])
    if len(axes) == 3:
        height += nz * (points[top, 2] - points[a, 2])
        at_i += nz * (points[i, 2] - points[a, 2])
        at_j += nz * (points[j, 2] - points[a, 2])
    if height == 0.0:
        return -math.inf, -math.inf
    return at_i / height, at_j / height


@part
def _cell_beyond(points, axes, cells, ring_ptr, ring, c, v):
    """Return the cell across the facet of cell c opposite to its vertex v.

    -1 if there is not exactly one, or if it does not lie on the other side: a fold.
    """
    k = cells.shape[1]
    a = np.int64(cells[c, (v + 1) % k])
    b = np.int64(cells[c, (v + 2) % k])
    d = np.int64(cells[c, (v + k - 1) % k])  # b again for triangles
    found = np.int64(-1)
    for place in range(ring_ptr[a], ring_ptr[a + 1]):
        here = np.int64(ring[place])
        if here != c and _has_node(cells, here, b) and (d == b or _has_node(cells, here, d)):
            if found >= 0:
                return -1
            found = here
    if found < 0:
        return -1
    i = np.int64(-1)
    for w in range(k):
        if not _has_node(cells, c, np.int64(cells[found, w])):
            i = np.int64(cells[found, w])
    if i < 0:
        return -1
    ahead = coordinates_of_two(points, axes, cells, c, v, i, i)[0]
    if ahead >= 0.0 or ahead == -math.inf:
        return -1
    return found


@part
def _holds(cells, c, p, q, r):
    """Tell whether cell c has all nodes of the source (-1: none)."""
    return (
        _has_node(cells, c, p)
        and (q < 0 or _has_node(cells, c, q))
        and (r < 0 or _has_node(cells, c, r))
    )


@part
def _leads_beside(points, source, a, k, y, p):
    """Tell whether the path of node a goes to node p, at y, all on one side of the line from k."""
    wx = points[y, 0] - points[k, 0]
    wy = points[y, 1] - points[k, 1]
    side = wx * (points[a, 1] - points[k, 1]) - wy * (points[a, 0] - points[k, 0])
    leads = False
    i = a
    for _ in range(_BENDS):
        if source[i, 1] >= 0:
            break
        i = np.int64(source[i, 0])
        if i == p:
            leads = True
            break
        if (wx * (points[i, 1] - points[k, 1]) - wy * (points[i, 0] - points[k, 0])) * side <= 0.0:
            break
    return leads


@part
def _is_certified(points, axes, cells, c, v, source, h0, patch, k, y, p, q, r):
    """Tell whether the facet of cell c opposite to v shows that the line through it arrives."""
    dim = len(axes)
    same = True
    for w in range(dim + 1):
        if w != v:
            i = cells[c, w]
            same = same and source[i, 0] == p
            same = same and (dim < 2 or source[i, 1] == q)
            same = same and (dim < 3 or source[i, 2] == r)
    if same:
        return True
    if len(axes) == 2 and q < 0:
        a = np.int64(cells[c, (v + 1) % 3])
        b = np.int64(cells[c, (v + 2) % 3])
        if _leads_beside(points, source, a, k, y, p) and _leads_beside(points, source, b, k, y, p):
            return True
        if source[b, 0] == p and source[b, 1] < 0:
            a, b = b, a
        if source[a, 0] == p and source[a, 1] < 0 and source[b, 1] < 0:
            i = p
            for _ in range(_BENDS):
                i = np.int64(source[i, 0])
                if source[b, 0] == i:
                    return True
    here = patch[p]
    if here < 0 or points[p, dim] < h0[p]:
        return False
    # All from one smooth piece of the boundary, and from near the same place of it.
    longest = 0.0
    farthest = 0.0
    first = cells[c, (v + 1) % (dim + 1)]
    for w in range(dim + 1):
        if w == v:
            continue
        i = cells[c, w]
        s = source[i, 0]
        if patch[s] != here or points[s, dim] < h0[s]:
            return False
        length = 0.0
        reach = 0.0
        for d in range(dim):
            length += (points[i, d] - points[first, d]) ** 2
            reach += (points[s, d] - points[y, d]) ** 2
        longest = max(longest, length)
        farthest = max(farthest, reach)
    return farthest <= _NEAR * _NEAR * longest


@part
def _is_near(points, axes, cells, c, v, source, k, y0, y1, y2):
    """Tell whether what serves the facet of cell c opposite to its vertex v, k, is near k + y."""
    longest = 0.0
    farthest = 0.0
    first = cells[c, v - 1]
    for w in range(1, len(axes) + 1):
        i = cells[c, v - w]
        s = source[i, 0]
        length = (points[i, 0] - points[first, 0]) ** 2 + (points[i, 1] - points[first, 1]) ** 2
        reach = (points[s, 0] - points[k, 0] - y0) ** 2 + (points[s, 1] - points[k, 1] - y1) ** 2
        if len(axes) == 3:
            length += (points[i, 2] - points[first, 2]) ** 2
            reach += (points[s, 2] - points[k, 2] - y2) ** 2
        longest = max(longest, length)
        farthest = max(farthest, reach)
    return farthest <= _NEAR * _NEAR * longest


@part
def sees_past_its_cells(points, axes, cells, ring_ptr, ring, patch, h0, source, k, p, q, r, l1, l2):
    """Tell whether the first or last certificate holds where the line from k leaves its cells.

    As `sees`, which looks further, but that it may say no.  It is what nearly all lines need,
    and a call of `sees` costs more than this.
    """
    here = patch[p] if points[p, len(axes)] >= h0[p] else -1
    y0 = points[p, 0]
    y1 = points[p, 1]
    if q >= 0:
        y0 += l1 * (points[q, 0] - points[p, 0])
        y1 += l1 * (points[q, 1] - points[p, 1])
    y0 -= points[k, 0]
    y1 -= points[k, 1]
    y2 = 0.0
    if len(axes) == 3:
        y2 = points[p, 2]
        if q >= 0:
            y2 += l1 * (points[q, 2] - points[p, 2])
        if r >= 0:
            y0 += l2 * (points[r, 0] - points[p, 0])
            y1 += l2 * (points[r, 1] - points[p, 1])
            y2 += l2 * (points[r, 2] - points[p, 2])
        y2 -= points[k, 2]
    seen = False
    for place in range(ring_ptr[k], ring_ptr[k + 1]):
        c = ring[place]
        same = True
        near = here >= 0
        for v in range(len(axes) + 1):
            i = cells[c, v]
            if i != k:
                same = same and source[i, 0] == p and source[i, 1] == q
                if len(axes) == 3:
                    same = same and source[i, 2] == r
                if near:
                    s = source[i, 0]
                    near = patch[s] == here and points[s, len(axes)] >= h0[s]
        if not (same or near):
            continue
        v = 0
        while cells[c, v] != k:
            v += 1
        a = cells[c, v - 1]
        b = cells[c, v - 2]
        a0 = points[a, 0] - points[k, 0]
        a1 = points[a, 1] - points[k, 1]
        b0 = points[b, 0] - points[k, 0]
        b1 = points[b, 1] - points[k, 1]
        if len(axes) == 2:
            whole = a0 * b1 - a1 * b0
            at_a = (y0 * b1 - y1 * b0) * whole
            at_b = (a0 * y1 - a1 * y0) * whole
            at_d = 0.0
        else:
            d = cells[c, v - 3]
            a2 = points[a, 2] - points[k, 2]
            b2 = points[b, 2] - points[k, 2]
            d0 = points[d, 0] - points[k, 0]
            d1 = points[d, 1] - points[k, 1]
            d2 = points[d, 2] - points[k, 2]
            n0 = a1 * b2 - a2 * b1
            n1 = a2 * b0 - a0 * b2
            n2 = a0 * b1 - a1 * b0
            whole = n0 * d0 + n1 * d1 + n2 * d2
            at_d = (n0 * y0 + n1 * y1 + n2 * y2) * whole
            n0 = y1 * d2 - y2 * d1
            n1 = y2 * d0 - y0 * d2
            n2 = y0 * d1 - y1 * d0
            at_b = (n0 * a0 + n1 * a1 + n2 * a2) * whole
            at_a = -(n0 * b0 + n1 * b1 + n2 * b2) * whole
        if whole != 0.0 and at_a >= 0.0 and at_b >= 0.0 and at_d >= 0.0:
            seen = same or _is_near(points, axes, cells, c, v, source, k, y0, y1, y2)
            break
    return seen


@inner
def sees(
    points,
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
    s0,
    s1,
    s2,
    l1,
    l2,
):
    """Tell whether the straight line from node k to a point of a source lies in the mesh.

    Parameters
    ----------
    points : float64[n + 1, dim + 1]
        In/Out: coordinates and sizes; the last row is then the point.
    axes : tuple of length dim
    cells : int32[m, dim + 1]
    ring_ptr : int64[n + 1]
    ring : int32[m * (dim + 1)]
        Cells around each node.
    patch : int32[n]
        Piece of the boundary to which a node belongs; -1 inside and where pieces meet.
    clearance : float64[n] or float64[0]
        Lower bounds of the distances of the nodes from the boundary, if there are any.
    h0 : float64[n]
    source : int32[n, dim]
        Sources of the nodes.
    refused : int32[n + 1, dim]
        In/Out: the last source that each node did not see; the last row is then the facet of the
        boundary that hides the line, or starts with -1 if there is none.
    k : int
    s0, s1, s2 : int
        The source offered, as in ``source``.
    l1, l2 : float64
        Weights of s1 and s2 at the point.
    """
    dim = len(axes)
    refused[refused.shape[0] - 1, 0] = -1
    if refused[k, 0] == s0 and refused[k, 1] == s1 and (dim < 3 or refused[k, 2] == s2):
        return False
    put_foot(points, axes, s0, s1, s2, l1, l2)
    if k < clearance.shape[0]:
        # Two balls that cover the line and do not meet the boundary.
        y = points.shape[0] - 1
        at_y = clearance[s0] - distance(points, axes, s0, y)
        if distance(points, axes, k, y) < clearance[k] + max(at_y, 0.0):
            return True
    p, q, r, l1, l2 = drop_zero_weights(s0, s1, s2, l1, l2)
    most = 64 + 16 * int(cells.shape[0] ** (1.0 / dim))  # several times across the mesh
    seen = _arrives(
        points,
        axes,
        cells,
        ring_ptr,
        ring,
        patch,
        h0,
        source,
        refused,
        k,
        p,
        q,
        r,
        s0,
        s1,
        s2,
        most,
    )
    if not seen:
        set_source(refused, k, s0, s1, s2)
    return seen


@inner
def _arrives(
    points,
    axes,
    cells,
    ring_ptr,
    ring,
    patch,
    h0,
    source,
    refused,
    k,
    p,
    q,
    r,
    s0,
    s1,
    s2,
    max_steps,
):
    """Follow the line from node k to the last row of ``points``, which lies between p, q and r.

    A facet of the boundary that hides it is written to the last row of ``refused``.
    """
    y = points.shape[0] - 1
    # The cell into which the line leaves k: where it is most clearly inside the cone at k.
    c = entry = np.int64(-1)
    best = _CONE
    for place in range(ring_ptr[k], ring_ptr[k + 1]):
        here = np.int64(ring[place])
        if _holds(cells, here, p, q, r):
            return True
        least = math.inf
        total = 0.0
        at_k = 0
        for v in range(cells.shape[1]):
            if cells[here, v] == k:
                at_k = v
                continue
            share = coordinates_of_two(points, axes, cells, here, v, y, y)[0]
            total += abs(share)
            least = min(least, share)
        if total > 0.0 and total < math.inf and least > best * total:
            best = least / total
            c = here
            entry = at_k
            if best > _CLEARLY:
                break
    if c < 0:
        return False
    way_out = entry
    for _ in range(max_steps):
        if _is_certified(points, axes, cells, c, way_out, source, h0, patch, k, y, s0, s1, s2):
            return True
        beyond = _cell_beyond(points, axes, cells, ring_ptr, ring, c, way_out)
        if beyond < 0:
            for v in range(len(axes)):
                place = (way_out + 1 + v) % (len(axes) + 1)
                refused[refused.shape[0] - 1, v] = cells[c, place]
            return False
        if _holds(cells, beyond, p, q, r):
            return True
        way_out = np.int64(-1)
        nearest = math.inf
        for v in range(cells.shape[1]):
            if not _has_node(cells, c, np.int64(cells[beyond, v])):
                continue  # the facet that it came through
            at_k, at_y = coordinates_of_two(points, axes, cells, beyond, v, k, y)
            if at_y < -GRAZING:
                t = at_k / (at_k - at_y)
                if t < nearest:
                    nearest = t
                    way_out = v
        if way_out < 0:
            return False  # ends in a cell that has not got the source: another sheet
        c = beyond
    return False
