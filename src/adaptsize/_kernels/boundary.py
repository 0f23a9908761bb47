"""The boundary of a flat mesh as a chain, without matching its facets.

Every cell is oriented by its signed measure.  A facet between two cells that lie on
different sides of it then occurs once in each direction, and what does not cancel is
the boundary: free facets, and those where the mesh is folded.  To find out where that
is, each node sums, over its cells, a number that changes sign with the direction of the facets
at it: the sum is 0 exactly inside, but for a chance of about 2^-60.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel

# Odd 64-bit constants without structure (fractional parts of the golden ratio, of sqrt 2).
_A = np.uint64(0x9E3779B97F4A7C15)
_B = np.uint64(0x6A09E667F3BCC909)
_SHIFT = np.uint64(32)

# Cells with a smaller ratio of measure to the power of the longest edge have no measure.
_NO_MEASURE = 1e-12


@inner
def _random(i):
    """Return 64 bits for a node number."""
    x = (np.uint64(i) + _B) * _A
    x = (x ^ (x >> _SHIFT)) * _B
    return x ^ (x >> _SHIFT)


@inner
def _facet(cells, c, v, dim):
    """Return the nodes of the facet opposite to v, ascending, and whether their order is odd.

    Of the two orders of a facet the even one has its normal out of a cell of positive measure.
    """
    a = cells[c, (v + 1) % (dim + 1)]
    b = cells[c, (v + 2) % (dim + 1)]
    odd = False
    if dim == 2:
        d = np.int32(-1)
    else:
        d = cells[c, (v + 3) % 4]
        odd = v % 2 == 1
        if b > d:
            b, d = d, b
            odd = not odd
    if a > b:
        a, b = b, a
        odd = not odd
    if dim == 3 and b > d:
        b, d = d, b
        odd = not odd
    return a, b, d, odd


@inner
def signed_measure(points, axes, cells, c):
    """Return twice the signed area of a triangle, six times the signed volume of a tetrahedron."""
    i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
    ax = points[j, 0] - points[i, 0]
    ay = points[j, 1] - points[i, 1]
    bx = points[k, 0] - points[i, 0]
    by = points[k, 1] - points[i, 1]
    if len(axes) == 2:
        return ax * by - ay * bx
    m = cells[c, len(axes)]
    az = points[j, 2] - points[i, 2]
    bz = points[k, 2] - points[i, 2]
    cx = points[m, 0] - points[i, 0]
    cy = points[m, 1] - points[i, 1]
    cz = points[m, 2] - points[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return nx * cx + ny * cy + nz * cz


@kernel
def sum_facets(points, axes, cells, first, last, sums):
    """Add up, at each node, signed random numbers of the facets there.

    At a node, a facet is identified by its other nodes: by r_b in the plane, and by the
    antisymmetric r_b s_c - r_c s_b in space, where r and s are random numbers of the nodes.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    first, last : int
        The cells to add up.
    sums : uint64[n]
        In/Out: zeros; different from 0 then at the nodes of the boundary.

    Returns
    -------
    bool
        Whether a cell has no measure at all.
    """
    flat = False
    for c in range(first, last):
        i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
        measure = signed_measure(points, axes, cells, c)
        flat = flat or measure == 0.0
        if measure < 0.0:
            i, j = j, i
        a, b, d = _random(i), _random(j), _random(k)
        if len(axes) == 2:
            sums[i] += b - d
            sums[j] += d - a
            sums[k] += a - b
        else:
            m = cells[c, len(axes)]
            e = _random(m)
            a2, b2, d2, e2 = (
                a ^ (a >> _SHIFT),
                b ^ (b >> _SHIFT),
                d ^ (d >> _SHIFT),
                e ^ (e >> _SHIFT),
            )
            ab, ad, ae = a * b2 - b * a2, a * d2 - d * a2, a * e2 - e * a2
            bd, be, de = b * d2 - d * b2, b * e2 - e * b2, d * e2 - e * d2
            sums[i] += bd + de - be
            sums[j] += ae - ad - de
            sums[k] += ab + be - ae
            sums[m] += ad - ab - bd
    return flat


@inner
def _flatness(points, axes, cells, c):
    """Return the measure of a cell over its longest edge to the power of the dimension."""
    dim = len(axes)
    longest = 0.0
    for v in range(dim + 1):
        for w in range(v):
            square = 0.0
            for d in range(dim):
                square += (points[cells[c, v], d] - points[cells[c, w], d]) ** 2
            longest = max(longest, square)
    if longest == 0.0:
        return 0.0
    size = math.sqrt(longest)
    ax = (points[cells[c, 1], 0] - points[cells[c, 0], 0]) / size
    ay = (points[cells[c, 1], 1] - points[cells[c, 0], 1]) / size
    bx = (points[cells[c, 2], 0] - points[cells[c, 0], 0]) / size
    by = (points[cells[c, 2], 1] - points[cells[c, 0], 1]) / size
    if dim == 2:
        return abs(ax * by - ay * bx)
    az = (points[cells[c, 1], 2] - points[cells[c, 0], 2]) / size
    bz = (points[cells[c, 2], 2] - points[cells[c, 0], 2]) / size
    cx = (points[cells[c, dim], 0] - points[cells[c, 0], 0]) / size
    cy = (points[cells[c, dim], 1] - points[cells[c, 0], 1]) / size
    cz = (points[cells[c, dim], 2] - points[cells[c, 0], 2]) / size
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return abs(nx * cx + ny * cy + nz * cz)


@kernel
def list_facets(points, axes, cells, sums, facets, side, cell):
    """List the facets all of whose nodes may be on the boundary, and so all of its facets.

    Parameters
    ----------
    points, axes, cells, sums
        As in `sum_facets`.
    facets : int32[f, dim]
        Out: nodes, ascending; as many as there is room for.
    side : int8[f]
        Out: 1 if the normal of the even order of the facet points out of its cell, -1 if into
        it, 0 if the cell has no measure.
    cell : int32[f]
        Out: its cell.

    Returns
    -------
    int
        Their number; more than f if there was not enough room.
    """
    dim = len(axes)
    count = 0
    for c in range(cells.shape[0]):
        near = 0
        for v in range(dim + 1):
            if sums[cells[c, v]] != np.uint64(0):
                near += 1
        if near < dim:
            continue
        for v in range(dim + 1):
            if near == dim and sums[cells[c, v]] != np.uint64(0):
                continue
            if count < facets.shape[0]:
                a, b, d, is_odd = _facet(cells, c, v, dim)
                facets[count, 0] = a
                facets[count, 1] = b
                if dim == 3:
                    facets[count, 2] = d
                side[count] = -1 if is_odd != (signed_measure(points, axes, cells, c) < 0.0) else 1
                if _flatness(points, axes, cells, c) < _NO_MEASURE:
                    side[count] = 0
                cell[count] = c
            count += 1
    return count


@kernel
def list_cells_at(cells, marked, found):
    """List the cells with a marked node, as many as there is room for; return their number."""
    count = 0
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            if marked[cells[c, v]]:
                if count < found.shape[0]:
                    found[count] = c
                count += 1
                break
    return count


@kernel
def merge_walls(points, start, end, after, begins, is_end, slack, ends):
    """Merge walls that follow each other on a straight line.

    Parameters
    ----------
    points : float64[n, 2]
    start, end : int32[w]
        Nodes of each wall.
    after : int32[w]
        The wall that begins where this one ends; any where ``is_end`` of its end.
    begins : bool[w]
        Whether ``is_end`` holds at the start of each wall.
    is_end : bool[n]
        In/Out: nodes at which walls end; those where a line leaves another are added.
    slack : float64
        Distance from a line below which a point is on it.
    ends : float64[w, 4]
        Out: start and end of the merged walls.

    Returns
    -------
    int
        Their number.
    """
    count = 0
    for w in range(start.shape[0]):
        if not begins[w]:
            continue
        first = w
        while True:
            a, b = start[first], end[first]
            ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            length = math.hypot(ux, uy)
            last = first
            while not is_end[end[last]] and length > 0.0:
                c = end[after[last]]
                cx, cy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
                along = (ux * cx + uy * cy) / length
                before = math.hypot(
                    points[end[last], 0] - points[a, 0], points[end[last], 1] - points[a, 1]
                )
                if abs(ux * cy - uy * cx) > slack * length or along <= before:
                    break
                last = after[last]
            ends[count, 0], ends[count, 1] = points[a, 0], points[a, 1]
            ends[count, 2], ends[count, 3] = points[end[last], 0], points[end[last], 1]
            count += 1
            if is_end[end[last]]:
                break
            is_end[end[last]] = True
            first = after[last]
    return count
