"""Local operations on the cells around an edge or a face: swaps, also on boundary and interfaces.

An edge of tetrahedra is removed by filling the ring of nodes around it with triangles, each joined
to both ends.  Of an edge on a smooth boundary the ring is open: it is closed by the new edge of the
boundary.  If a single cell is there, it is flat and vanishes.  Of an edge of an interface, each
side is filled.
"""

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.complexes import (
    CELLS,
    FACETS,
    LINES,
    NONE,
    add_row,
    are_joined,
    first_corner,
    has_node,
    is_on,
    next_corner,
    nodes_of,
    remove_row,
    rows_with,
    third_node,
)
from adaptsize._kernels.envelope import (
    INNER,
    are_samples_kept,
    attach_samples,
    detach_samples,
    distance_of,
    measure_row,
    normal_of,
)
from adaptsize._kernels.local_mesh import (
    MOST_AROUND,
    PLANE,
    angle_of,
    limit_of_edge,
    penalty,
    requeue,
    squared_length,
    tetrahedron_angle,
    update_angle,
)
from adaptsize._kernels.vectors import dot, norm

#: Least cosine of the angle between new facets and those that they replace.
_LEAST_COSINE = 0.3
_TWO, _THREE = np.int64(2), np.int64(3)


@lean
def _replaced_fit(mesh, gone, new, work):
    """Return whether one or two facets may be replaced by others.

    Parameters
    ----------
    gone : tuple of 2 int64
        Rows of the facets; the second one may be -1.
    new : tuple of 3 tuples of 3 int64
        Corners of the new facets.
    """
    points, cx, samples = mesh.points, mesh.cx, mesh.samples
    total, limit2 = (0.0, 0.0, 0.0), samples.tolerance * samples.tolerance
    n_new = 3 if gone[1] < 0 else 2
    for row in gone:
        if row >= 0:
            a, b, c, _ = nodes_of(cx, row)
            n = normal_of(points, a, b, c)
            total = (total[0] + n[0], total[1] + n[1], total[2] + n[2])
            limit2 = max(limit2, samples.off2[row])
    label = cx.about[gone[0], 0]
    for t in range(n_new):
        a, b, c = new[t]
        n = normal_of(points, a, b, c)
        if dot(n, total) < _LEAST_COSINE * norm(n) * norm(total):
            return False
        off2 = distance_of(mesh.surface, points, new[t], label, INNER, limit2, work.stack)
        if off2 > 2.0 * limit2:
            return False
    return True


@lean
def _replace_facets(mesh, gone, new, work):
    """Replace facets by others, with what depends on them."""
    cx, samples = mesh.cx, mesh.samples
    chain, n_around, label = NONE, np.int64(0), cx.about[gone[0], 0]
    n_new = 3 if gone[1] < 0 else 2
    is_plane = mesh.kind == PLANE
    for row in gone:
        if row >= 0:
            if not is_plane:
                chain = detach_samples(samples, row, chain)
            remove_row(cx, row)
    for t in range(n_new):
        a, b, c = new[t]
        row = add_row(cx, mesh.facets, (a, b, c, NONE), label)
        samples.chain[row, 0] = -1
        if mesh.facets == CELLS:
            update_angle(mesh, row)
        if not is_plane:
            measure_row(mesh.surface, samples, cx, mesh.points, row, work.stack)
        for i in new[t]:
            work.around[n_around] = i
            n_around += 1
    if not is_plane:
        attach_samples(samples, cx, mesh.facets, mesh.points, work.around, n_around, chain)


@lean
def _may_replace(mesh, gone, new, work):
    """Return whether facets may be replaced, and the samples of the old ones remain near.

    The facets are replaced for the second question, and put back.
    """
    if mesh.cx.n_free[0] < _THREE or not _replaced_fit(mesh, gone, new, work):
        return False
    cx, level = mesh.cx, mesh.facets
    rows, n_around = (NONE, NONE, NONE), np.int64(0)
    n_new = 3 if gone[1] < 0 else 2
    for t in range(n_new):
        a, b, c = new[t]
        row = add_row(cx, level, (a, b, c, NONE), cx.about[gone[0], 0])
        rows = (row, rows[0], rows[1])
        for i in new[t]:
            work.around[n_around] = i
            n_around += 1
    p, q, r, _ = nodes_of(cx, gone[0])
    common = (p, q, r)
    if gone[1] >= 0:  # of two facets, their edge
        for a, b, c in ((p, q, r), (q, r, p), (r, p, q)):
            if not has_node(cx, gone[1], c):
                common = (a, b, NONE)
    kept = True
    for row in gone:
        if row >= 0 and kept:
            kept = are_samples_kept(
                mesh.samples, cx, level, mesh.points, row, common, work.around, n_around
            )
    for t in range(n_new):
        remove_row(cx, rows[t])
    return kept


@lean
def _list_rows_around(mesh, a, b, work):
    """List the cells around an edge and their other nodes in order; return how many, 0 if many."""
    cx, n = mesh.cx, 0
    corner = first_corner(cx, CELLS, a)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(cx, corner)
        if not has_node(cx, row, b):
            continue
        if n == MOST_AROUND:
            return 0
        # The two other nodes in the order that keeps the orientation with a and b first.
        at_a, at_b, u, w = 0, 0, NONE, NONE
        for v in range(4):
            node = np.int64(cx.nodes[row, v])
            if node == a:
                at_a = v
            elif node == b:
                at_b = v
            elif u < 0:
                u = node
            else:
                w = node
        if (at_a + at_b + (1 if at_b > at_a else 0)) % 2 == 1:
            u, w = w, u
        work.ring[n, 0], work.ring[n, 1], work.ring[n, 2] = row, u, w
        n += 1
    return n


@lean
def _cell_from(work, n, node):
    """Return the place of the cell around an edge that begins at a node, or -1."""
    for s in range(n):
        if work.ring[s, 1] == node:
            return s
    return -1


@lean
def _set_loop(work, n, start, stop):
    """Put the nodes around an edge into the loop, from ``start`` to ``stop``, which may be equal.

    Returns the number of cells passed, 0 if there is no such way.
    """
    node, passed = start, 0
    work.ring[0, 3] = start
    while passed < n:
        s = _cell_from(work, n, node)
        if s < 0:
            return 0
        node = work.ring[s, 2]
        passed += 1
        work.ring[passed, 3] = node
        if node == stop:
            return passed
    return 0


@lean
def _fill_best(points, a, b, last, work):
    """Fill the nodes 0 to ``last`` of the loop so that the worst cell is best; return its angle."""
    ring, best = work.ring, work.best
    for i in range(last):
        best[i, i + 1, 0] = 180.0
    for width in range(2, last + 1):
        for i in range(last - width + 1):
            j = i + width
            best[i, j, 0] = -1.0
            for k in range(i + 1, j):
                worst = min(best[i, k, 0], best[k, j, 0])
                for side in range(2):
                    if worst <= best[i, j, 0]:
                        break
                    end, one, other = (a, k, j) if side == 0 else (b, j, k)
                    angle = tetrahedron_angle(points, end, ring[i, 3], ring[one, 3], ring[other, 3])
                    worst = min(worst, angle)
                if worst > best[i, j, 0]:
                    best[i, j, 0] = worst
                    best[i, j, 1] = k
    return best[0, last, 0]


@lean
def _set_made(work, n, nodes, label):
    a, b, c, d = nodes
    work.made[n, 0], work.made[n, 1], work.made[n, 2], work.made[n, 3] = a, b, c, d
    work.made[n, 4] = label


@lean
def _made(work, s):
    return work.made[s, 0], work.made[s, 1], work.made[s, 2], work.made[s, 3]


@lean
def _list_filling(mesh, a, b, last, label, n_made, longest2, work):
    """Add the cells of the best filling; return their number, -1 if there is none good enough."""
    ring = work.ring
    if last < 2:
        return n_made
    if _fill_best(mesh.points, a, b, last, work) <= 0.0:
        return -1
    ring[0, 4], ring[0, 5], height = 0, last, 1
    while height > 0:
        height -= 1
        i, j = ring[height, 4], ring[height, 5]
        if j - i < 2:
            continue
        p, q = ring[i, 3], ring[j, 3]
        if squared_length(mesh.points, p, q) > max(longest2, limit_of_edge(mesh, p, q)):
            return -1
        k = np.int64(work.best[i, j, 1])
        middle = ring[k, 3]
        _set_made(work, n_made, (a, p, middle, q), label)
        _set_made(work, n_made + 1, (b, p, q, middle), label)
        n_made += 2
        ring[height, 4], ring[height, 5] = i, k
        ring[height + 1, 4], ring[height + 1, 5] = k, j
        height += 2
    return n_made


@lean
def _drop_of_made(mesh, n_old, n_made, least, work):
    """Return by how much the penalty falls if the listed cells replace others; 0 if not by more."""
    before, worst, after = 0.0, 180.0, 0.0
    for s in range(n_old):
        angle = mesh.angle[work.ring[s, 0]]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
    for s in range(n_made):
        angle = angle_of(mesh, _made(work, s))
        after += penalty(mesh, angle)
        if angle <= 0.0 or angle < worst:
            return 0.0
    return before - after if before - after > least else 0.0


@lean
def _longest_listed(mesh, a, b, n, work):
    """Return the largest squared length of an edge of the cells around an edge."""
    longest2, points = squared_length(mesh.points, a, b), mesh.points
    for s in range(n):
        u, w = work.ring[s, 1], work.ring[s, 2]
        for p, q in ((a, u), (b, u), (u, w)):
            longest2 = max(longest2, squared_length(points, p, q))
    return longest2


@lean
def _new_facets_at(cx, first, last, a, b):
    """Return the two facets with the other diagonal, and its ends."""
    p, q = third_node(cx, first, a, b), third_node(cx, last, a, b)
    one, other = (a, p, q), (p, b, q)
    for v in range(3):
        if cx.nodes[first, v] == a and cx.nodes[first, (v + 1) % 3] == b:
            one, other = (a, q, p), (q, b, p)
    return one, other, p, q


@lean
def _list_without_edge(mesh, a, b, work):
    """List the cells around an edge, and the best ones without it.

    Returns
    -------
    int, int
        Number of old cells, and of new ones; the latter is -1 if the edge cannot be removed.
    int, int
        The facets at the edge, -1 if there are none.
    """
    cx = mesh.cx
    count, first, last = rows_with(cx, FACETS, a, b, NONE)
    n = 0
    if count == 0 or (count == 2 and not are_joined(cx, LINES, a, b)):
        n = _list_rows_around(mesh, a, b, work)
    if n == 0:
        return 0, NONE, NONE, NONE
    longest2 = _longest_listed(mesh, a, b, n, work)
    if count == 2:
        return n, _list_sides(mesh, a, b, n, first, last, longest2, work), first, last
    start = work.ring[0, 1]
    if n < 3 or _set_loop(work, n, start, start) != n:
        return n, NONE, NONE, NONE
    label = cx.about[work.ring[0, 0], 0]
    return n, _list_filling(mesh, a, b, n - 1, label, np.int64(0), longest2, work), NONE, NONE


@lean
def _list_sides(mesh, a, b, n, first, last, longest2, work):
    """List the best cells on the sides of an edge of facets; return their number, or -1."""
    cx = mesh.cx
    p, q = third_node(cx, first, a, b), third_node(cx, last, a, b)
    if p == q or are_joined(cx, FACETS, p, q):
        return NONE
    passed, n_made, shortest = 0, np.int64(0), n
    for side in range(2):
        start, stop = (p, q) if side == 0 else (q, p)
        s = _cell_from(work, n, start)
        if s < 0:  # outside
            continue
        label, more = cx.about[work.ring[s, 0], 0], _set_loop(work, n, start, stop)
        if more == 0:
            return NONE
        passed += more
        shortest = min(shortest, more)
        n_made = _list_filling(mesh, a, b, more, label, n_made, longest2, work)
        if n_made < 0:
            return n_made
    # Only a flat cell that vanishes may have the new edge before.
    is_new = shortest == 1 or not are_joined(cx, CELLS, p, q)
    return n_made if passed == n and is_new else NONE


@lean
def drop_of_edge(mesh, a, b, least, work):
    """Return by how much the penalty falls if an edge of tetrahedra is removed, or 0."""
    n_old, n_made, first, last = _list_without_edge(mesh, a, b, work)
    drop = _drop_of_made(mesh, n_old, n_made, least, work) if n_made >= 0 else 0.0
    if drop <= 0.0 or mesh.cx.n_free[0] + n_old < n_made:
        return 0.0
    return drop if first < 0 or _may_flip(mesh, first, last, a, b, work) else 0.0


@lean
def _may_flip(mesh, first, last, a, b, work):
    """Return whether the edge between two facets may be flipped."""
    one, other, p, q = _new_facets_at(mesh.cx, first, last, a, b)
    length2 = squared_length(mesh.points, p, q)
    if length2 > max(squared_length(mesh.points, a, b), limit_of_edge(mesh, p, q)):
        return False
    if mesh.kind == PLANE:
        return True
    return _may_replace(mesh, (first, last), (one, other, other), work)


@lean
def remove_edge(mesh, a, b, work):
    """Remove an edge of tetrahedra, as `drop_of_edge` has found."""
    n_old, n_made, first, last = _list_without_edge(mesh, a, b, work)
    for s in range(n_old):
        remove_row(mesh.cx, work.ring[s, 0])
    if first >= 0:
        one, other, _, _ = _new_facets_at(mesh.cx, first, last, a, b)
        _replace_facets(mesh, (first, last), (one, other, other), work)
    _add_made(mesh, n_made, work)
    requeue(mesh, a, work)
    requeue(mesh, b, work)
    for s in range(n_old):
        requeue(mesh, work.ring[s, 1], work)
        requeue(mesh, work.ring[s, 2], work)


@lean
def _add_made(mesh, n_made, work):
    for s in range(n_made):
        row = add_row(mesh.cx, CELLS, _made(work, s), work.made[s, 4])
        update_angle(mesh, row)


@lean
def _list_across(mesh, c, v, work):
    """List the cells at a face and the three across it; return how many are listed, 3 or 0."""
    cx = mesh.cx
    nodes = nodes_of(cx, c)
    o = nodes[v]
    f, g, h = nodes[(v + 1) % 4], nodes[(v + 2) % 4], nodes[(v + 3) % 4]
    if v % 2 == 0:  # so that (f, g, h, o) is positive
        g, h = h, g
    count, one, other = rows_with(cx, CELLS, f, g, h)
    across = other if one == c else one
    if count != 2 or cx.about[across, 0] != cx.about[c, 0]:
        return 0
    if rows_with(cx, FACETS, f, g, h)[0] > 0:
        return 0
    s, t, u, w = nodes_of(cx, across)
    p = s + t + u + w - f - g - h
    if are_joined(cx, CELLS, o, p):
        return 0
    if squared_length(mesh.points, p, o) > limit_of_edge(mesh, p, o):
        return 0
    work.ring[0, 0], work.ring[1, 0] = c, across
    for s in range(3):
        one, other = (f, g) if s == 0 else ((g, h) if s == 1 else (h, f))
        _set_made(work, s, (p, o, one, other), cx.about[c, 0])
    return 3


@lean
def drop_of_face(mesh, c, v, least, work):
    """Return by how much the penalty falls if the face opposite to a corner is removed, or 0."""
    if mesh.cx.n_free[0] == 0 or _list_across(mesh, c, v, work) == 0:
        return 0.0
    return _drop_of_made(mesh, _TWO, _THREE, least, work)


@lean
def remove_face(mesh, c, v, work):
    """Remove a face of tetrahedra, as `drop_of_face` has found."""
    _list_across(mesh, c, v, work)
    remove_row(mesh.cx, work.ring[0, 0])
    remove_row(mesh.cx, work.ring[1, 0])
    _add_made(mesh, _THREE, work)
    for s in range(3):
        for i in _made(work, s):
            requeue(mesh, i, work)


@lean
def _facet_of_cell(mesh, c):
    """Return the only facet of a cell and the new ones; -1 if the cell must stay.

    The cell has one facet on the boundary, and its other node is inside.
    """
    cx, nodes = mesh.cx, nodes_of(mesh.cx, c)
    found, top = NONE, nodes[0]
    for v in range(4):
        f, g, h = nodes[(v + 1) % 4], nodes[(v + 2) % 4], nodes[(v + 3) % 4]
        count, row, _ = rows_with(cx, FACETS, f, g, h)
        if count > 0:
            if found >= 0 or rows_with(cx, CELLS, f, g, h)[0] != 1:
                return NONE, ((f, g, h), (f, g, h), (f, g, h))
            found, top = row, nodes[v]
    if found < 0 or is_on(cx, FACETS, top):
        p, q, r, _ = nodes
        return NONE, ((p, q, r), (p, q, r), (p, q, r))
    a, b, d, _ = nodes_of(cx, found)
    return found, ((a, b, top), (b, d, top), (d, a, top))


@lean
def drop_of_cell(mesh, c, least, work):
    """Return by how much the penalty falls if a cell with one facet on the boundary vanishes."""
    drop = penalty(mesh, mesh.angle[c])
    if drop <= least:
        return 0.0
    row, new = _facet_of_cell(mesh, c)
    return drop if row >= 0 and _may_replace(mesh, (row, NONE), new, work) else 0.0


@lean
def remove_cell(mesh, c, work):
    """Remove a cell with one facet on the boundary, as `drop_of_cell` has found."""
    row, new = _facet_of_cell(mesh, c)
    nodes = nodes_of(mesh.cx, c)
    remove_row(mesh.cx, c)
    _replace_facets(mesh, (row, NONE), new, work)
    for i in nodes:
        requeue(mesh, i, work)


@lean
def drop_of_flip(mesh, a, b, least, work):
    """Return by how much the penalty falls if an edge of triangles is flipped, or 0."""
    cx = mesh.cx
    count, first, last = rows_with(cx, CELLS, a, b, NONE)
    if count != 2 or cx.about[first, 0] != cx.about[last, 0] or are_joined(cx, LINES, a, b):
        return 0.0
    one, other, p, q = _new_facets_at(cx, first, last, a, b)
    if p == q or are_joined(cx, CELLS, p, q):
        return 0.0
    work.ring[0, 0], work.ring[1, 0] = first, last
    for s in range(2):
        i, j, k = one if s == 0 else other
        _set_made(work, s, (i, j, k, NONE), cx.about[first, 0])
    drop = _drop_of_made(mesh, _TWO, _TWO, least, work)
    return drop if drop > 0.0 and _may_flip(mesh, first, last, a, b, work) else 0.0


@lean
def flip_edge(mesh, a, b, work):
    """Flip an edge of triangles, as `drop_of_flip` has found."""
    _, first, last = rows_with(mesh.cx, CELLS, a, b, NONE)
    one, other, p, q = _new_facets_at(mesh.cx, first, last, a, b)
    _replace_facets(mesh, (first, last), (one, other, other), work)
    for i in (a, b, p, q):
        requeue(mesh, i, work)
