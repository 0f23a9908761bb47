"""Cutting of the leaves of octrees and quadtrees into simplices (see octree.py)."""

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.octree import find_node, find_or_add


@inner
def _store(cells, place, corners, apex, flip):
    """Write one simplex, if there is an array to write to; return the next place."""
    if cells.shape[0] > 0:
        p, q, r = corners
        cells[place, 0] = p
        cells[place, 1] = r if flip else q
        cells[place, 2] = q if flip else r
        if cells.shape[1] == 4:
            cells[place, 3] = apex
    return place + 1


@inner
def has_halved_edge(table, square):
    """Return whether the middle of an edge of a square is a node.

    ``square``: the key of its lower corner, the strides of its two axes, its edge in lattice
    intervals.
    """
    base, a, b, size = square
    for side in range(4):
        key = base + (size >> 1) * (a if side % 2 == 0 else b)
        key += size * (b if side % 2 == 0 else a) * (side >> 1)
        if size > 1 and find_node(table, key) >= 0:
            return True
    return False


@inner
def _fan(table, square, centre, joined, cells, place):
    """Cut a square into triangles between its centre and the pieces of its edges.

    Pieces between nodes are dyadic; one that starts at ``at`` is no longer than the lowest
    bit of ``at``.

    Parameters as in `_cut_square`; ``centre`` is the number of the node there.
    """
    start, a, b, size = square
    p = find_node(table, start)
    for side in range(4):
        step = (a if side % 2 == 0 else b) * (1 if side < 2 else -1)
        at = np.int64(0)
        while at < size:
            length = at & -at if at > 0 else size
            while length > 1 and find_node(table, start + (at + length // 2) * step) >= 0:
                length //= 2
            at += length
            q = find_node(table, start + at * step)
            place = _store(cells, place, (p, q, centre), joined[0], joined[1])
            p = q
        start += size * step
    return place


@inner
def _cut_square(nodes, square, odd, joined, out, counts):
    """Cut a square (a leaf of a quadtree, or a face of a leaf) into triangles.

    The result depends on the nodes in the square and on its place alone, so that both
    leaves at a face find the same triangles.  Where its centre is a corner of leaves it is
    cut into quarters; where only edges are halved, into triangles around a new centre; else
    along the diagonal from the corner of even indices to that of odd ones.

    Parameters
    ----------
    nodes : Nodes
    square : tuple of 4 int
        As in `has_halved_edge`.
    odd : int
        1 if the sum of the two indices of the square, on its level, is odd, else 0.
    joined : tuple of int, bool
        Node that triangles are joined with, to tetrahedra, if there are four columns of cells;
        whether to turn triangles over.
    out : tuple of int64[64, 3], int32[m, 3 or 4]
        Scratch, and the cells (Out), which may have no rows: then simplices are counted only.
    counts : tuple of 2 int
        Number of nodes and of cells so far.

    Returns
    -------
    n_points, place : int
        The numbers after.
    """
    (first, a, b, size), (stack, cells), (n_points, place) = square, out, counts
    table = nodes.table
    stack[0, 0], stack[0, 1], stack[0, 2] = first, size, odd
    top = 1
    while top > 0:
        top -= 1
        low, edge, is_odd = stack[top, 0], stack[top, 1], stack[top, 2]
        half = edge >> 1
        middle = low + half * (a + b)
        if half > 0 and find_node(table, middle) >= 0:
            for quarter in range(4):
                u, v = quarter >> 1, quarter & 1
                stack[top, 0] = low + half * (u * a + v * b)
                stack[top, 1] = half
                stack[top, 2] = u ^ v
                top += 1
        elif has_halved_edge(table, (low, a, b, edge)):
            centre = find_or_add(nodes.centres, middle, n_points)
            if centre == n_points:
                nodes.keys[n_points] = middle
                n_points += 1
            place = _fan(table, (low, a, b, edge), centre, joined, cells, place)
        else:
            # Around the square from the end of a diagonal that both triangles have.
            turn = 1 if is_odd else 0
            p = find_node(table, low + edge * (turn * a))
            q = find_node(table, low + edge * (a + turn * b))
            r = find_node(table, low + edge * ((1 - turn) * a + b))
            s = find_node(table, low + edge * ((1 - turn) * b))
            place = _store(cells, place, (p, q, r), joined[0], joined[1])
            place = _store(cells, place, (p, r, s), joined[0], joined[1])
    return n_points, place


@inner
def _cut_along_diagonals(corners, leaf, even, cells, place):
    """Cut a leaf without hanging nodes as Kuhn does, from corner ``even`` to the opposite one.

    One simplex per order of the axes: the path from corner to corner along them.

    Returns the next place in ``cells``, which are left alone if there are none.
    """
    dim, last = cells.shape[1] - 1, corners.shape[1] - 1
    mirrored = ((even >> 2) ^ (even >> 1) ^ even) & 1
    for first in range(dim):
        for turn in range(dim - 1):
            one = even ^ (1 << (dim - 1 - first))
            two = one ^ (1 << (dim - 1 - (first + 1 + turn) % dim))
            # Odd orders of the axes and mirrored axes turn a simplex over.
            flip = (mirrored == 1) ^ (first + turn > 0 if dim == 2 else turn == 1)
            path = (corners[leaf, even], corners[leaf, one], corners[leaf, two])
            place = _store(cells, place, path, corners[leaf, last ^ even], flip)
    return place


@kernel
def cut_leaves(nodes, cells):
    """Cut all leaves into simplices that fit together; number the centres that this needs.

    A leaf without hanging nodes is cut along diagonals.  Of the others, a square is cut by
    `_cut_square`; the faces of a cube are, and their triangles are joined with its centre.

    To be called twice: with no cells, to count them, and again to have them filled.

    Parameters
    ----------
    nodes : Nodes
        In/Out.
    cells : int32[m, dim + 1]
        Out: positively oriented; or no rows.

    Returns
    -------
    n_points, n_cells : int
    """
    # Explicit types save the compiler some seconds of type inference.
    (indices, levels, strides), leaf_centres = nodes.leaves, nodes.leaf_centres
    dim = indices.shape[1]
    # A square leaves three of its quarters behind per level; keys of 64 bits allow 20 in 3-D.
    stack = np.empty((64, 3), np.int64)
    n_points = np.int64(nodes.n_corners)
    place = np.int64(0)
    for leaf in range(indices.shape[0]):
        size = np.int64(1) << levels[leaf]
        base = np.int64(0)
        even = np.int64(0)  # the corner whose indices on this level are all even
        for d in range(dim):
            base += indices[leaf, d] * strides[d]
            even = (even << 1) | ((indices[leaf, d] >> levels[leaf]) & 1)
        nodes.first_cells[leaf] = place
        if not nodes.hanging[leaf]:
            place = _cut_along_diagonals(nodes.corners, leaf, even, cells, place)
            continue
        if dim == 3:
            leaf_centres[leaf] = n_points
            nodes.keys[n_points] = base + (size >> 1) * (strides[0] + strides[1] + strides[2])
            n_points += 1
        # A quadtree's leaf counts as the lower face along a third axis.
        for face in range(6 if dim == 3 else 1):
            axis, side = (face >> 1, face & 1) if dim == 3 else (2, 0)
            i, j = (axis + 1) % 3, (axis + 2) % 3
            odd = ((even >> (dim - 1 - i)) ^ (even >> (dim - 1 - j))) & 1
            start = base + (side * size * strides[axis] if dim == 3 else 0)
            square, joined = (start, strides[i], strides[j], size), (leaf_centres[leaf], side == 1)
            n_points, place = _cut_square(
                nodes, square, odd, joined, (stack, cells), (n_points, place)
            )
    nodes.first_cells[indices.shape[0]] = place
    return n_points, place
