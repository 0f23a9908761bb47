"""Rings, unique sub-simplices, and the boundary of flat meshes, in linear time.

The boundary of a flat mesh is found as a chain, without matching its facets.
Every cell is oriented by its signed measure.  A facet between two cells that lie on
different sides of it then occurs once in each direction, and what does not cancel is
the boundary: free facets, and those where the mesh is folded.  To find out where that
is, each node sums, over its cells, a number that changes sign with the direction of the facets
at it: the sum is 0 exactly inside, but for a chance of about 2^-60.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel


@lean_kernel
def fill_rings(cells, n_points, ring_ptr, ring):
    """List the cells around each point in compressed rows (CSR), cells ascending.

    Parameters
    ----------
    cells : int32[m, k]
    n_points : int
    ring_ptr : int32[n_points + 1]
        Out: the cells of point i are ``ring[ring_ptr[i]:ring_ptr[i + 1]]``.
    ring : int32[m * k]
        Out.
    """
    ring_ptr[:] = 0
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            ring_ptr[cells[c, v] + 1] += 1
    for i in range(n_points):
        ring_ptr[i + 1] += ring_ptr[i]
    # ring_ptr[i] is the next free place of row i, and is restored afterwards.
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            i = cells[c, v]
            ring[ring_ptr[i]] = c
            ring_ptr[i] += 1
    for i in range(n_points, 0, -1):
        ring_ptr[i] = ring_ptr[i - 1]
    ring_ptr[0] = 0


@lean
def _is_before(rows, a, b):
    """Return whether row a comes before row b in lexicographic order, equal rows by index."""
    for d in range(rows.shape[1]):
        if rows[a, d] != rows[b, d]:
            return rows[a, d] < rows[b, d]
    return a < b


@lean_kernel
def group_rows(rows, scratch, first, group):
    """Give each row of sorted indices the number of its group, groups in lexicographic order.

    Rows are dealt into one bucket per first index; the buckets are short in any
    mesh, so the insertion sort inside them makes the whole linear in practice.

    Parameters
    ----------
    rows : int32[m, k]
        Indices in 0..n_points - 1, ascending within each row.
    scratch : tuple of int64[n_points + 1] twice, int32[m]
        The first two are zeros.
    first : int32[m]
        Out: ``first[:n_groups]`` are the rows that are met first of each group.
    group : int32[m]
        Out: number of the group of each row.

    Returns
    -------
    int
        Number of different rows.
    """
    start, free, order = scratch
    m, k = rows.shape
    n_points = start.shape[0] - 1
    for r in range(m):
        start[rows[r, 0] + 1] += 1
    for i in range(n_points):
        start[i + 1] += start[i]
        free[i + 1] = start[i + 1]
    for r in range(m):
        i = rows[r, 0]
        order[free[i]] = r
        free[i] += 1

    n_groups = 0
    for i in range(n_points):
        for here in range(start[i] + 1, start[i + 1]):
            row = order[here]
            there = here
            while there > start[i] and _is_before(rows, row, order[there - 1]):
                order[there] = order[there - 1]
                there -= 1
            order[there] = row
        for here in range(start[i], start[i + 1]):
            row = order[here]
            same = here > start[i]
            if same:
                for d in range(k):
                    same = same and rows[row, d] == rows[order[here - 1], d]
            if not same:
                first[n_groups] = row
                n_groups += 1
            group[row] = n_groups - 1
    return n_groups


@lean_kernel
def join_cells(cells, parent):
    """Join the nodes of each cell, so that equal roots mean the same component.

    Parameters
    ----------
    cells : int32[m, k]
    parent : int32[n_points]
        In: each node itself; Out: for each node the least node of its component.
    """
    for c in range(cells.shape[0]):
        a = cells[c, 0]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        for v in range(1, cells.shape[1]):
            b = cells[c, v]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
                a = b
    for i in range(parent.shape[0]):
        parent[i] = parent[parent[i]]


@lean_kernel
def mark_nodes(cells, used):
    """Mark the nodes of cells (In/Out: used, bool[n_points]); return how many are marked now."""
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            used[cells[c, v]] = True
    count = 0
    for i in range(used.shape[0]):
        if used[i]:
            count += 1
    return count


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


@lean
def _signed_measure(points, axes, cells, c):
    """Return twice the signed area of a triangle, six times the signed volume of a tetrahedron."""
    i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
    ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    bx, by = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
    if len(axes) == 2:
        return ax * by - ay * bx
    m = cells[c, len(axes)]
    z = len(axes) - 1  # of triangles, this is never used, but compiled
    az, bz, cz = (
        points[j, z] - points[i, z],
        points[k, z] - points[i, z],
        points[m, z] - points[i, z],
    )
    cx, cy = points[m, 0] - points[i, 0], points[m, 1] - points[i, 1]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return nx * cx + ny * cy + nz * cz


@lean_kernel
def sum_facets(points, axes, cells, sums):
    """Add up, at each node, signed random numbers of the facets there.

    At a node, a facet is identified by its other nodes: by r_b in the plane, and by the
    antisymmetric r_b s_c - r_c s_b in space, where r and s are random numbers of the nodes.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    sums : uint64[n]
        In/Out: zeros; different from 0 then at the nodes of the boundary.

    Returns
    -------
    bool
        Whether a cell has no measure at all.
    """
    flat = False
    for c in range(cells.shape[0]):
        i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
        measure = _signed_measure(points, axes, cells, c)
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


@lean_kernel
def list_cells(cells, marked, least, found):
    """List the cells with at least so many marked nodes, as many as there is room for.

    Returns their number.
    """
    count = 0
    for c in range(cells.shape[0]):
        n_marked = 0
        for v in range(cells.shape[1]):
            n_marked += 1 if marked[cells[c, v]] else 0
        if n_marked >= least:
            if count < found.shape[0]:
                found[count] = c
            count += 1
    return count


@lean_kernel
def merge_walls(points, walls, is_end, slack, ends):
    """Merge walls that follow each other on a straight line.

    Parameters
    ----------
    points : float64[n, 2]
    walls : tuple of int32[w] three times, bool[w]
        Start and end of each wall; the wall that begins where this one ends, any where ``is_end``
        of its end; whether ``is_end`` holds at the start of each wall.
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
    start, end, after, begins = walls
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
