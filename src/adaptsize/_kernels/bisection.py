"""Longest-edge bisection of segments, triangles and tetrahedra until the mesh is conforming.

A cell is divided at the middle of its longest edge, and so is every cell with a divided edge, until
no cell has a divided edge.  Divided edges are kept in a hash table, so that no adjacency is needed.

References
----------
M.-C. Rivara, "Algorithms for refining triangular grids suitable for adaptive and multigrid
techniques", Int. J. Numer. Meth. Eng. 20 (1984) 745-756.
"""

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel

_ABSENT = -1


@lean
def _slot_of(keys, a, b):
    """Return the slot of an edge in the table, or the free one where it belongs."""
    if b < a:
        a, b = b, a
    key = (np.int64(a) << 32) | np.int64(b)
    mask = keys.shape[0] - 1
    # Fibonacci hashing: the high bits of the product depend on all bits of the key.
    slot = ((key * np.int64(-7046029254386353131)) >> 20) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@lean
def _middle_of(table, a, b):
    """Return the middle of an edge, or _ABSENT."""
    keys, middles = table
    slot = _slot_of(keys, a, b)
    return middles[slot] if keys[slot] != -1 else np.int32(_ABSENT)


@lean_kernel
def add_edges(edges, first, table):
    """Add divided edges to a hash table (In/Out).

    Parameters
    ----------
    edges : int32[n, 2]
        The middle of the edge in row i is point i.
    first : int
        Rows before this one are skipped.
    table : int64[2^k], int32[2^k]
        Keys, -1 where free, and middles.  At least twice as many slots as edges.
    """
    keys, middles = table
    for i in range(first, edges.shape[0]):
        slot = _slot_of(keys, edges[i, 0], edges[i, 1])
        keys[slot] = (np.int64(min(edges[i, 0], edges[i, 1])) << 32) | np.int64(
            max(edges[i, 0], edges[i, 1])
        )
        middles[slot] = i


@lean
def _is_longer(points, a, b, c, d):
    """Return whether edge ab is longer than cd; of equal edges, that with the larger middle is.

    The answer depends on coordinates only, so that all cells at an edge agree.
    """
    one, other = 0.0, 0.0
    for k in range(points.shape[1]):
        one += (points[a, k] - points[b, k]) * (points[a, k] - points[b, k])
        other += (points[c, k] - points[d, k]) * (points[c, k] - points[d, k])
    if one != other:
        return one > other
    for k in range(points.shape[1]):
        one, other = points[a, k] + points[b, k], points[c, k] + points[d, k]
        if one != other:
            return one > other
    return False


@lean
def _edge_to_divide(points, cells, c, table, only_known):
    """Return the corners of the longest edge of a cell, or of those divided already, or -1."""
    first, second = -1, -1
    for i in range(cells.shape[1]):
        for j in range(i):
            a, b = cells[c, i], cells[c, j]
            if only_known and _middle_of(table, a, b) < 0:
                continue
            if first < 0 or _is_longer(points, a, b, cells[c, first], cells[c, second]):
                first, second = i, j
    return first, second


@lean
def _has_divided_edge(cells, c, is_end, table):
    for i in range(cells.shape[1]):
        if is_end[cells[c, i]]:
            for j in range(i):
                if is_end[cells[c, j]] and _middle_of(table, cells[c, i], cells[c, j]) >= 0:
                    return True
    return False


@lean
def _share_samples(samples, c, new, i, j):
    """Distribute the samples in a cell between its halves: of corner i, which keeps number c.

    The half with corner i holds the points with a larger weight of i than of j.
    """
    first, following, weights, values, least = samples
    p = first[c]
    first[c], first[new] = -1, -1
    least[c], least[new] = np.inf, np.inf
    while p >= 0:
        after = following[p]
        at_i, at_j = weights[p, i], weights[p, j]
        if at_i >= at_j:
            weights[p, i], weights[p, j], half = at_i - at_j, 2.0 * at_j, c
        else:
            weights[p, i], weights[p, j], half = 2.0 * at_i, at_j - at_i, new
        following[p] = first[half]
        first[half] = p
        least[half] = min(least[half], values[p])
        p = after


@lean_kernel
def bisect_cells(points, ends, cells, owner, state, table, samples, counts, only_known):
    """Divide the wanted cells, and others until no cell has a divided edge.

    Parameters
    ----------
    points : float64[P, dim]
        In/Out: of these, ``counts[0]`` are used.
    ends : int32[P, 2]
        Out: the ends of the edges whose middles the new points are.
    cells : int32[C, k]
        In/Out: of these, ``counts[1]`` are used.  A half of a divided cell takes its place.
    owner : int64[C]
        In/Out: what a cell is a part of.
    state : uint8[C], uint8[C], uint8[P]
        In/Out: whether a cell is wanted.  In/Out: whether a cell was divided.  In/Out: whether a
        point is the end of a divided edge.
    table : int64[2^k], int32[2^k]
        In/Out: hash table of the divided edges.
    samples : int32[C], int32[s], float64[s, k], float64[s], float64[C]
        In/Out: the first sample in each cell, -1 for none, and for each sample the next in its
        cell, its barycentric coordinates, and its value.  In/Out: the least value in each cell.
        Without cells in the first of them, there are no samples.
    counts : int64[3]
        In/Out: numbers of points, of cells, and of edges in the table.
    only_known : bool
        No edge is divided that is not in the table.

    Returns
    -------
    bool
        False if the arrays are too short to go on.
    """
    wanted, is_new, is_end = state
    keys, middles = table
    again = True
    while again:
        again = False
        c = 0
        while c < counts[1]:
            if not (wanted[c] or _has_divided_edge(cells, c, is_end, table)):
                c += 1
                continue
            i, j = _edge_to_divide(points, cells, c, table, only_known)
            wanted[c] = 0
            if i < 0:
                c += 1
                continue
            a, b = cells[c, i], cells[c, j]
            slot = _slot_of(keys, a, b)
            full = counts[0] == ends.shape[0] or 2 * counts[2] + 2 > keys.shape[0]
            if counts[1] == cells.shape[0] or (keys[slot] == -1 and full):
                wanted[c] = 1
                return False
            if keys[slot] == -1:
                m = counts[0]
                for d in range(points.shape[1]):
                    points[m, d] = 0.5 * (points[a, d] + points[b, d])
                ends[m, 0], ends[m, 1] = min(a, b), max(a, b)
                keys[slot] = (np.int64(min(a, b)) << 32) | np.int64(max(a, b))
                middles[slot] = m
                is_end[a], is_end[b] = 1, 1
                counts[0] += 1
                counts[2] += 1
                again = True
            m, new = middles[slot], counts[1]
            for v in range(cells.shape[1]):
                cells[new, v] = cells[c, v]
            cells[c, j], cells[new, i] = m, m
            owner[new] = owner[c]
            wanted[new] = 0
            is_new[c], is_new[new] = 1, 1
            if samples[0].shape[0] > 0:
                _share_samples(samples, c, new, i, j)
            counts[1] += 1
    return True
