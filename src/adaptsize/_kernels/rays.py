"""Rays from points of a boundary into the domain, and the first wall that each one hits.

Facets are triangles, or segments in the plane z = 0, in the order of a tree of boxes (see
interpolate.py).  A facet is a row of `FACET` numbers: a corner c, the unit outward normal n, two
vectors a and b, and three tolerances, so that a point x of its plane has the weights

    u = a . (x - c),    v = b . (x - c),    1 - u - v,

each of which may be negative by its tolerance: a point may be beside a facet by the same distance
everywhere, however thin the facet is.  Hence no ray escapes between two facets.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel

#: Numbers of a facet.
FACET = 15

#: A direction lies in a plane up to this sine of an angle: single precision in files tilts facets.
ALONG = 1e-3

# A path from the root to a leaf leaves one node behind per level.
_STACK = 64
# A ray along a plane does not hit it.
_PARALLEL = 1e-9


@kernel
def fill_facets(corners, normals, slack, facets):
    """Fill the rows of facets.

    Parameters
    ----------
    corners : float64[m, k, 3]
        k = 3, or 2 in the plane.
    normals : float64[m, 3]
        Unit; zero for facets without area, which nothing hits.
    slack : float
        Distance beside a facet that belongs to it.
    facets : float64[m, FACET]
        Out.
    """
    in_plane = corners.shape[1] == 2
    for t in range(corners.shape[0]):
        c, n = corners[t, 0], normals[t]
        p, q = corners[t, 1] - c, corners[t, 1] - c
        if in_plane:
            a = p / (p[0] * p[0] + p[1] * p[1])
            b = np.zeros(3)
        else:
            q = corners[t, 2] - c
            across = np.array([
                n[1] * q[2] - n[2] * q[1], n[2] * q[0] - n[0] * q[2], n[0] * q[1] - n[1] * q[0],
            ])  # fmt: skip
            a = across / (across[0] * p[0] + across[1] * p[1] + across[2] * p[2])
            across = np.array([
                n[1] * p[2] - n[2] * p[1], n[2] * p[0] - n[0] * p[2], n[0] * p[1] - n[1] * p[0],
            ])  # fmt: skip
            b = across / (across[0] * q[0] + across[1] * q[1] + across[2] * q[2])
        lengths = np.zeros(3)
        for d in range(3):
            facets[t, d], facets[t, 3 + d] = c[d], n[d]
            facets[t, 6 + d], facets[t, 9 + d] = a[d], b[d]
            lengths[0] += a[d] * a[d]
            lengths[1] += b[d] * b[d]
            lengths[2] += (a[d] + b[d]) * (a[d] + b[d])
        for d in range(3):
            facets[t, 12 + d] = slack * math.sqrt(lengths[d])


@inner
def hit(facets, t, x, y, z, dx, dy, dz):
    """Return the distance at which a ray crosses facet t, and the cosine of its direction to n.

    The distance is inf if the ray misses the facet or runs along its plane.
    """
    cosine = dx * facets[t, 3] + dy * facets[t, 4] + dz * facets[t, 5]
    if not abs(cosine) > _PARALLEL:
        return math.inf, 0.0
    rx, ry, rz = facets[t, 0] - x, facets[t, 1] - y, facets[t, 2] - z
    along = (rx * facets[t, 3] + ry * facets[t, 4] + rz * facets[t, 5]) / cosine
    rx, ry, rz = along * dx - rx, along * dy - ry, along * dz - rz
    u = facets[t, 6] * rx + facets[t, 7] * ry + facets[t, 8] * rz
    v = facets[t, 9] * rx + facets[t, 10] * ry + facets[t, 11] * rz
    if u >= -facets[t, 12] and v >= -facets[t, 13] and 1.0 - u - v >= -facets[t, 14]:
        return along, cosine
    return math.inf, 0.0


@inner
def entry(boxes, node, x, y, z, dx, dy, dz, slack):
    """Return the distance at which a ray enters a box, widened by ``slack``; inf if it misses.

    ``dx``, ``dy``, ``dz``: inverses of the direction, inf where that is 0.
    """
    low, high = 0.0, math.inf
    # Comparisons are such that nan, from 0 * inf, changes nothing.
    a, b = (boxes[node, 0] - slack - x) * dx, (boxes[node, 3] + slack - x) * dx
    low, high = _clip(low, high, a, b)
    a, b = (boxes[node, 1] - slack - y) * dy, (boxes[node, 4] + slack - y) * dy
    low, high = _clip(low, high, a, b)
    a, b = (boxes[node, 2] - slack - z) * dz, (boxes[node, 5] + slack - z) * dz
    low, high = _clip(low, high, a, b)
    return low if low <= high else math.inf


@inner
def _clip(low, high, a, b):
    if a > b:
        a, b = b, a
    if a > low:
        low = a
    if b < high:
        high = b
    return low, high


@inner
def holds(first, items, row, item):
    """Return whether list ``row``, ``items[first[row]:first[row + 1]]``, ascending, has an item."""
    low, high = first[row], first[row + 1]
    while low < high:
        middle = (low + high) // 2
        if items[middle] < item:
            low = middle + 1
        else:
            high = middle
    return low < first[row + 1] and items[low] == item


@kernel
def shoot(
    facets, boxes, face, two_sided, first, meeting, starts, directions, own, limits, slack, reach,
    begin, end, leaves, stops, widths,
):  # fmt: skip
    """Find the first wall through which each ray leaves a body.

    Parameters
    ----------
    facets : float64[m, FACET]
    boxes : float64[2 * n_leaves, 6]
    face : int32[m]
    two_sided : bool[m]
        Facets of open sheets, which are walls for rays from both sides.
    first, meeting : int32[n_faces + 1], int32[k]
        Faces that meet each face, ascending.
    starts, directions : float64[n, 3]
        Directions are unit vectors.
    own : int32[n]
        Face of each start.
    limits : float64[2]
        Cosines of the largest angle between the direction and the normal of a wall that counts,
        and of the largest one of a wall on a face that meets that of the start.
    slack : float
        Hits as near to each other as this are one.
    reach : float64[n]
        Hits up to this distance do not count, such as those of the facets at the start.
    begin, end : int
        Only these rays are shot.
    leaves : float64[n]
        Out: distance of the wall; inf if there is none.
    stops : bool[n]
        Out: whether that wall is an open sheet.
    widths : float64[n]
        Out: the same if a wall at this distance counts, else inf.
    """
    n_cells, n_leaves = facets.shape[0], boxes.shape[0] // 2
    stack, entries = np.empty(_STACK, np.int64), np.empty(_STACK)
    for r in range(begin, end):
        x, y, z = starts[r, 0], starts[r, 1], starts[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        ix = 1.0 / dx if dx != 0.0 else math.inf
        iy = 1.0 / dy if dy != 0.0 else math.inf
        iz = 1.0 / dz if dz != 0.0 else math.inf
        nearest, sheet, counts = math.inf, math.inf, math.inf
        stack[0], entries[0] = 1, 0.0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if entries[top] > nearest + slack:
                continue
            if node < n_leaves:
                near, far = 2 * node, 2 * node + 1
                at_near = entry(boxes, near, x, y, z, ix, iy, iz, slack)
                at_far = entry(boxes, far, x, y, z, ix, iy, iz, slack)
                if at_far < at_near:
                    near, far, at_near, at_far = far, near, at_far, at_near
                if at_far < math.inf:
                    stack[top], entries[top] = far, at_far
                    top += 1
                if at_near < math.inf:
                    stack[top], entries[top] = near, at_near
                    top += 1
                continue
            leaf = node - n_leaves
            for t in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
                along, cosine = hit(facets, t, x, y, z, dx, dy, dz)
                if not reach[r] < along < math.inf or (cosine < 0.0 and not two_sided[t]):
                    continue
                nearest = min(nearest, along)
                if two_sided[t]:
                    sheet = min(sheet, along)
                cosine = abs(cosine)
                if along >= counts or cosine < limits[0]:
                    continue
                if cosine > limits[1] or not holds(first, meeting, np.int64(own[r]), face[t]):
                    counts = along
        leaves[r], stops[r] = nearest, sheet <= nearest + slack
        widths[r] = counts if counts <= nearest + slack else math.inf


@kernel
def find_entries(facets, boxes, two_sided, places, directions, slack, enters):
    """Find whether a body begins at points of the boundary, in given directions.

    Parameters
    ----------
    facets, boxes, two_sided, slack
        As for `shoot`.
    places, directions : float64[n, 3]
        Directions are unit vectors.
    enters : bool[n]
        Out: whether a facet through the point is entered.
    """
    n_cells, n_leaves = facets.shape[0], boxes.shape[0] // 2
    stack = np.empty(_STACK, np.int64)
    for r in range(places.shape[0]):
        x, y, z = places[r, 0], places[r, 1], places[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        enters[r] = False
        stack[0] = 1
        top = 1
        while top > 0 and not enters[r]:
            top -= 1
            node = stack[top]
            apart = 0.0
            for d in range(3):
                apart = max(apart, boxes[node, d] - places[r, d], places[r, d] - boxes[node, 3 + d])
            if apart > 2.0 * slack:
                continue
            if node < n_leaves:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2
                continue
            leaf = node - n_leaves
            for t in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
                along, cosine = hit(facets, t, x, y, z, dx, dy, dz)
                if cosine < 0.0 and abs(along) <= 2.0 * slack and not two_sided[t]:
                    enters[r] = True


@inner
def is_blocked(facets, boxes, ray, length, slack, stack):
    """Return whether a facet crosses a ray at more than ``slack`` from both of its ends.

    A ray that runs along a facet, up to the sine `ALONG`, does not cross it.

    Parameters
    ----------
    facets, boxes
        As for `shoot`.
    ray : tuple of 6 float64
        Start and unit direction.
    length, slack : float
    stack : int64[_STACK]
        Scratch.
    """
    x, y, z, dx, dy, dz = ray
    ix = 1.0 / dx if dx != 0.0 else math.inf
    iy = 1.0 / dy if dy != 0.0 else math.inf
    iz = 1.0 / dz if dz != 0.0 else math.inf
    n_cells, n_leaves = facets.shape[0], boxes.shape[0] // 2
    stack[0] = 1
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if entry(boxes, node, x, y, z, ix, iy, iz, slack) >= length:
            continue
        if node < n_leaves:
            stack[top], stack[top + 1] = 2 * node, 2 * node + 1
            top += 2
            continue
        leaf = node - n_leaves
        for t in range(leaf * n_cells // n_leaves, (leaf + 1) * n_cells // n_leaves):
            along, cosine = hit(facets, t, x, y, z, dx, dy, dz)
            if slack < along < length - slack and abs(cosine) > ALONG:
                return True
    return False
