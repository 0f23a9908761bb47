"""The boundary of flat meshes in linear time, and its straight pieces.

The boundary is found as a chain, without matching the facets.  Every cell is oriented by its signed
measure.  A facet between two cells that lie on different sides of it then occurs once in each
direction, and what does not cancel is the boundary: free facets, and those where the mesh is
folded.  To find out where that is, each node sums, over its cells, a number that changes sign with
the direction of the facets at it: the sum is 0 exactly inside, but for a chance of about 2^-60.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.vectors import between, cross, dot

# Odd 64-bit constants without structure (fractional parts of the golden ratio, of sqrt 2).
_A = np.uint64(0x9E3779B97F4A7C15)
_B = np.uint64(0x6A09E667F3BCC909)
_SHIFT = np.uint64(32)


@lean
def _random(i):
    """Return 64 bits for a node number."""
    x = (np.uint64(i) + _B) * _A
    x = (x ^ (x >> _SHIFT)) * _B
    return x ^ (x >> _SHIFT)


#: Cells with a smaller ratio of measure to the power of the longest edge at the first node have no
#: measure.
NO_MEASURE = 1e-12
#: Bits of what `sum_facets` finds.
HAS_FLAT, HAS_COINCIDENT = 1, 2


@lean
def _signed_measure(points, axes, cells, c):
    """Return the signed measure of a cell, and the longest edge at its first node to that power.

    The measure is twice the area of a triangle, and six times the volume of a tetrahedron.
    """
    i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
    if len(axes) == 2:
        ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        bx, by = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
        return ax * by - ay * bx, max(ax * ax + ay * ay, bx * bx + by * by)
    u, v = between(points, i, j), between(points, i, k)
    w = between(points, i, cells[c, len(axes)])
    longest = max(dot(u, u), dot(v, v), dot(w, w))
    return dot(cross(u, v), w), longest * math.sqrt(longest)


@lean
def _has_coincident(points, axes, cells, c):
    """Return whether two nodes of a cell are at one place."""
    for v in range(len(axes) + 1):
        for w in range(v):
            same = True
            for d in range(len(axes)):
                same = same and points[cells[c, v], d] == points[cells[c, w], d]
            if same:
                return True
    return False


@lean
def _random_of(ids, i):
    """Return 64 bits for a node: for its global number, if ``ids`` has these."""
    if ids is None:
        return _random(i)
    return _random(ids[i])


@lean_kernel
def sum_facets(points, axes, cells, ids, sums):
    """Add up, at each node, signed random numbers of the facets there.

    At a node, a facet is identified by its other nodes: by r_b in the plane, and by the
    antisymmetric r_b s_c - r_c s_b in space, where r and s are random numbers of the nodes.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    ids : None or int64[n]
        Global numbers of the nodes, for sums that parts of a mesh add up at nodes that they share.
    sums : uint64[n]
        In/Out: zeros; different from 0 then at the nodes of the boundary and of cells without
        measure, which have no orientation.

    Returns
    -------
    int
        Sum of bits: `HAS_FLAT` if a cell has no measure, `HAS_COINCIDENT` if two nodes of a
        cell are at one place.
    """
    found = 0
    for c in range(cells.shape[0]):
        i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
        measure, scale = _signed_measure(points, axes, cells, c)
        if measure == 0.0 or abs(measure) < NO_MEASURE * scale:
            found |= HAS_FLAT
            if _has_coincident(points, axes, cells, c):
                found |= HAS_COINCIDENT
            mark = _random(np.int32(c))
            for v in range(len(axes) + 1):
                sums[cells[c, v]] += mark
            continue
        if measure < 0.0:
            i, j = j, i
        a, b, d = _random_of(ids, i), _random_of(ids, j), _random_of(ids, k)
        if len(axes) == 2:
            sums[i] += b - d
            sums[j] += d - a
            sums[k] += a - b
        else:
            m = cells[c, len(axes)]
            e = _random_of(ids, m)
            a2, b2 = a ^ (a >> _SHIFT), b ^ (b >> _SHIFT)
            d2, e2 = d ^ (d >> _SHIFT), e ^ (e >> _SHIFT)
            ab, ad, ae = a * b2 - b * a2, a * d2 - d * a2, a * e2 - e * a2
            bd, be, de = b * d2 - d * b2, b * e2 - e * b2, d * e2 - e * d2
            sums[i] += bd + de - be
            sums[j] += ae - ad - de
            sums[k] += ab + be - ae
            sums[m] += ad - ab - bd
    return found


@lean_kernel
def list_facets(points, axes, cells, marked, facets, sides, owners):
    """List the facets all of whose nodes are marked, as many as there is room for.

    Parameters
    ----------
    points, axes, cells
        As in `sum_facets`.
    marked : bool[n]
    facets : int32[f, dim]
        Out: nodes, in the cyclic order that begins behind the opposite one.
    sides : int8[f]
        Out: 1 if the normal of the facet, its nodes in ascending order, points out of its cell, -1
        if into it, 0 if the cell has no measure.
    owners : int32[f]
        Out: the cells.

    Returns
    -------
    int
        Their number.
    """
    dim = len(axes)
    count = 0
    for c in range(cells.shape[0]):
        n_marked, free = 0, -1
        for v in range(dim + 1):
            if marked[cells[c, v]]:
                n_marked += 1
            else:
                free = v
        if n_marked < dim:
            continue
        measure, scale = _signed_measure(points, axes, cells, c)
        flat = measure == 0.0 or abs(measure) < NO_MEASURE * scale
        for v in range(dim + 1):
            if n_marked == dim and v != free:
                continue
            if count < owners.shape[0]:
                odd = dim == 3 and v % 2 == 1
                for d in range(dim):
                    facets[count, d] = cells[c, (v + 1 + d) % (dim + 1)]
                    for e in range(d):
                        odd ^= facets[count, e] > facets[count, d]
                sides[count] = 0 if flat else (-1 if odd != (measure < 0.0) else 1)
                owners[count] = c
            count += 1
    return count


@lean_kernel
def remove_flat_cells(group, sides, owners, times, removed):
    """Remove flat cells that have a facet without another cell, until there are none.

    Parameters
    ----------
    group : int32[f]
        Number of each facet; equal ones have one number.
    sides, owners : int8[f], int32[f]
        As from `list_facets`: the facets of a cell follow each other.
    times : int32[n_groups]
        In/Out: how often each facet occurs.
    removed : bool[f]
        In/Out: rows of removed cells.
    """
    n = group.shape[0]
    left = True
    while left:
        left = False
        first = 0
        while first < n:
            last, loose = first, False
            while last < n and owners[last] == owners[first]:
                loose |= times[group[last]] == 1
                last += 1
            if loose and sides[first] == 0 and not removed[first]:
                for r in range(first, last):
                    removed[r] = True
                    times[group[r]] -= 1
                left = True
            first = last


@lean_kernel
def merge_walls(points, walls, is_end, tolerance, piece, ends):
    """Merge walls that follow each other on a straight line.

    A merged wall is a chord such that the nodes of its walls follow each other along it, each at
    most ``tolerance`` away.  The slopes of the lines through the first node that pass that close to
    a node are an interval; a wall is added as long as its end lies in the intersection of those of
    all nodes before it.

    Parameters
    ----------
    points : float64[n, 2]
    walls : tuple of int32[w] three times
        Start and end of each wall, and the wall that begins where this one ends, any where
        ``is_end`` of its end.
    is_end : bool[n]
        In/Out: nodes at which walls end; those where merged walls end are added.
    tolerance : float
    piece : int32[w]
        Out: the merged wall of each wall.
    ends : int32[w, 2]
        Out: first and last node of the merged walls.

    Returns
    -------
    int
        Their number.
    """
    start, end, after = walls
    count = np.int64(0)
    piece[:] = -1
    for rest in (False, True):  # the rest are closed curves without any end
        for w in range(start.shape[0]):
            if piece[w] >= 0 or not (rest or is_end[start[w]]):
                continue
            is_end[start[w]] = True
            first = w
            while True:
                last = _last_of_chord(points, walls, is_end, tolerance, first, count, piece)
                ends[count, 0], ends[count, 1] = start[first], end[last]
                count += 1
                if is_end[end[last]]:
                    break
                is_end[end[last]] = True
                first = after[last]
    return count


@lean
def _last_of_chord(points, walls, is_end, tolerance, first, count, piece):
    """Return the last wall of the merged wall that begins with ``first`` (In/Out: piece)."""
    start, end, after = walls
    a, last = start[first], first
    ux, uy = points[end[first], 0] - points[a, 0], points[end[first], 1] - points[a, 1]
    along, away = math.hypot(ux, uy), 0.0
    low, high = -math.inf, math.inf
    piece[first] = count
    if along == 0.0:
        return last
    ux, uy = ux / along, uy / along
    while not is_end[end[last]]:
        low, high = max(low, (away - tolerance) / along), min(high, (away + tolerance) / along)
        c = end[after[last]]
        x, y = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
        before, along, away = along, ux * x + uy * y, ux * y - uy * x
        if along <= before or not low * along <= away <= high * along:
            break
        last = after[last]
        piece[last] = count
    return last
