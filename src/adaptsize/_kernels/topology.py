"""Cells around nodes, unique sub-simplices, and components, in linear time."""

from adaptsize._kernels.compiling import lean, lean_kernel

#: Buckets with more rows are sorted by a heap.
_MANY = 64


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


@lean
def _sift(rows, order, start, there, end):
    """Let a row of a heap, the last one on top, sink to its place (In/Out: order)."""
    row = order[start + there]
    while True:
        child = 2 * there + 1
        if child >= end:
            break
        if child + 1 < end and _is_before(rows, order[start + child], order[start + child + 1]):
            child += 1
        if not _is_before(rows, row, order[start + child]):
            break
        order[start + there] = order[start + child]
        there = child
    order[start + there] = row


@lean
def _sort_by_heap(rows, order, start, end):
    """Sort a bucket with many rows (In/Out: order), such as that of the hub of a wheel."""
    count = end - start
    for there in range(count // 2 - 1, -1, -1):
        _sift(rows, order, start, there, count)
    for last in range(count - 1, 0, -1):
        row = order[start]
        order[start] = order[start + last]
        order[start + last] = row
        _sift(rows, order, start, 0, last)


@lean
def _sort_by_insertion(rows, order, start, end):
    """Sort a bucket with few rows (In/Out: order)."""
    for here in range(start + 1, end):
        row = order[here]
        there = here
        while there > start and _is_before(rows, row, order[there - 1]):
            order[there] = order[there - 1]
            there -= 1
        order[there] = row


@lean_kernel
def group_rows(rows, scratch, first, group):
    """Give each row of sorted indices the number of its group, groups in lexicographic order.

    Rows are dealt into one bucket per first index.  Most buckets are short, so that the insertion
    sort inside them makes the whole linear in practice; others are sorted by a heap.

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
        if start[i + 1] - start[i] > _MANY:
            _sort_by_heap(rows, order, start[i], start[i + 1])
        else:
            _sort_by_insertion(rows, order, start[i], start[i + 1])
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
    """Mark the nodes of cells (In/Out: used, bool[n_points])."""
    for c in range(cells.shape[0]):
        for v in range(cells.shape[1]):
            used[cells[c, v]] = True
