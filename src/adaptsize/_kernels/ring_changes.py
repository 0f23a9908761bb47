"""Local operations on the cells around an edge or a face: swaps, also on boundary and interfaces.

An edge of tetrahedra is removed by filling the ring of nodes around it with triangles, each joined
to both ends.  Of an edge on a smooth boundary the ring is open: it is closed by the new edge of the
boundary.  If a single cell is there, it is flat and vanishes.  Of an edge of an interface, each
side is filled.
"""

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.complexes import add_row, are_joined, count_with, has_node, remove_row
from adaptsize._kernels.envelope import (
    attach_samples,
    closest_at,
    detach_samples,
    is_triangle_within,
    measure_row,
    normal_of,
)
from adaptsize._kernels.distance import closest_on_triangle
from adaptsize._kernels.local_mesh import (
    MOST_AROUND,
    PLANE,
    limit_of_edge,
    nodes_of,
    penalty,
    requeue,
    squared_length,
    tetrahedron_angle,
    triangle_angle,
    update_angle,
)
from adaptsize._kernels.vectors import dot, norm

#: Least cosine of the angle between new facets and those that they replace.
_LEAST_COSINE = 0.3


@lean
def _replaced_fit(mesh, gone, new, label, work):
    """Return whether two facets may be replaced by two or three others.

    Parameters
    ----------
    gone : tuple of 2 int64
        Rows of the facets; the second one may be -1.
    new : tuple of 3 tuples of 3 int64
        Corners of the new facets; the last one is used if there is but one row.
    label : int
    """
    env, points, facets = mesh.surface, mesh.points, mesh.facets
    n_new = 3 if gone[1] < 0 else 2
    total, limit2 = (0.0, 0.0, 0.0), env.tolerance * env.tolerance
    for row in gone:
        if row >= 0:
            a, b, c, _ = nodes_of(facets, row)
            n = normal_of(points, a, b, c)
            total = (total[0] + n[0], total[1] + n[1], total[2] + n[2])
            limit2 = max(limit2, env.off2[row])
    for t in range(n_new):
        a, b, c = new[t]
        n = normal_of(points, a, b, c)
        if dot(n, total) < _LEAST_COSINE * norm(n) * norm(total):
            return False
    for t in range(n_new):
        if not is_triangle_within(env, points, new[t], label, limit2, work.stack):
            return False
    for row in gone:
        s = np.int64(env.first[row]) if row >= 0 else np.int64(-1)
        while s >= 0:
            if not _is_sample_near(mesh, s, gone, new, n_new):
                return False
            s = np.int64(env.following[s])
    return True


@lean
def _is_sample_near(mesh, s, gone, new, n_new):
    """Return whether a sample is near new facets, or others at their corners."""
    env, points, facets = mesh.surface, mesh.points, mesh.facets
    x = (env.sample[s, 0], env.sample[s, 1], env.sample[s, 2])
    for t in range(n_new):
        a, b, c = new[t]
        if closest_on_triangle(points, a, b, c, x)[0] <= env.reach2[s]:
            return True
    # The edge that both facets have in common, or one edge of the facet.
    a, b, c, _ = nodes_of(facets, gone[0])
    one, other = a, b
    if gone[1] >= 0:
        if not has_node(facets, gone[1], a):
            one = c
        elif not has_node(facets, gone[1], b):
            other = c
    for t in range(n_new):
        for i in new[t]:
            found = closest_at(facets, points, i, env.sample_label[s], x, (one, other), -1.0)
            if found[1] <= env.reach2[s]:
                return True
    return False


@lean
def _replace_facets(mesh, gone, new, label, work):
    """Replace facets of tetrahedra, or triangles of a surface; return the rows of the new ones."""
    env, facets, points = mesh.surface, mesh.facets, mesh.points
    n_new, chain, n_around = 3 if gone[1] < 0 else 2, np.int64(-1), 0
    for row in gone:
        if row >= 0:
            if mesh.kind != PLANE:
                chain = detach_samples(env, row, chain)
            remove_row(facets, row)
    for t in range(n_new):
        a, b, c = new[t]
        row = add_row(facets, (a, b, c, c), label)
        if mesh.kind != PLANE:
            measure_row(env, facets, points, row, work.stack)
        for i in new[t]:
            work.around[n_around] = i
            n_around += 1
    if mesh.kind != PLANE:
        attach_samples(env, facets, points, work.around, n_around, chain)


@lean
def _list_rows_around(mesh, a, b, work):
    """List the cells around an edge and their other nodes in order; return how many, 0 if many."""
    cells, n = mesh.cells, 0
    corner = np.int64(cells.head[a])
    while corner >= 0:
        row = corner // 4
        corner = np.int64(cells.after[corner])
        if not has_node(cells, row, b):
            continue
        if n == MOST_AROUND:
            return 0
        # The two other nodes in the order that keeps the orientation with a and b first.
        at_a, at_b, u, w = 0, 0, np.int64(-1), np.int64(-1)
        for v in range(4):
            node = np.int64(cells.nodes[row, v])
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
        work.rows[n, 0], work.rows[n, 1], work.rows[n, 2] = row, u, w
        n += 1
    return n


@lean
def _step(work, n, node):
    """Return the place of the cell around an edge that begins at a node, or -1."""
    for s in range(n):
        if work.rows[s, 1] == node:
            return s
    return -1


@lean
def _set_loop(work, n, start, stop):
    """Put the nodes around an edge into the loop, from ``start`` to ``stop`` or to its end.

    Returns the number of nodes, the number of cells passed, and the last node.
    """
    node, passed, length = start, 0, 1
    work.loop[0] = start
    while passed < n:
        s = _step(work, n, node)
        if s < 0:
            break
        node = work.rows[s, 2]
        passed += 1
        if node == start:
            break
        work.loop[length] = node
        length += 1
        if node == stop:
            break
    return length, passed, node


@lean
def _fill_best(points, a, b, low, high, work):
    """Fill the nodes ``low`` to ``high`` of the loop so that the worst cell is best."""
    loop, value = work.loop, work.value
    for i in range(low, high):
        value[i, i + 1] = 180.0
    for width in range(2, high - low + 1):
        for i in range(low, high - width + 1):
            j = i + width
            value[i, j] = -1.0
            for k in range(i + 1, j):
                worst = min(value[i, k], value[k, j])
                if worst <= value[i, j]:
                    continue
                worst = min(worst, tetrahedron_angle(points, a, loop[i], loop[k], loop[j]))
                if worst <= value[i, j]:
                    continue
                worst = min(worst, tetrahedron_angle(points, b, loop[i], loop[j], loop[k]))
                if worst > value[i, j]:
                    value[i, j] = worst
                    work.split[i, j] = k
    return value[low, high]


@lean
def _set_made(work, n, nodes, label):
    a, b, c, d = nodes
    work.made[n, 0], work.made[n, 1], work.made[n, 2], work.made[n, 3] = a, b, c, d
    work.made[n, 4] = label


@lean
def _made(work, s):
    return work.made[s, 0], work.made[s, 1], work.made[s, 2], work.made[s, 3]


@lean
def _list_filling(mesh, a, b, low, high, label, n_made, longest2, work):
    """Add the cells of the best filling; return their number, -1 if an edge is too long."""
    loop, ranges = work.loop, work.ranges
    ranges[0, 0], ranges[0, 1], height = low, high, 1
    while height > 0:
        height -= 1
        i, j = ranges[height, 0], ranges[height, 1]
        if j - i < 2:
            continue
        length2 = squared_length(mesh.points, loop[i], loop[j])
        if length2 > max(longest2, limit_of_edge(mesh, loop[i], loop[j])):
            return -1
        k = work.split[i, j]
        _set_made(work, n_made, (a, loop[i], loop[k], loop[j]), label)
        _set_made(work, n_made + 1, (b, loop[i], loop[j], loop[k]), label)
        n_made += 2
        ranges[height, 0], ranges[height, 1] = i, k
        ranges[height + 1, 0], ranges[height + 1, 1] = k, j
        height += 2
    return n_made


@lean
def _drop_of_made(mesh, n_old, n_made, least, work):
    """Return by how much the penalty falls if the listed cells replace those around an edge."""
    before, worst, after = 0.0, 180.0, 0.0
    for s in range(n_old):
        angle = mesh.angle[work.rows[s, 0]]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
    for s in range(n_made):
        angle = tetrahedron_angle(mesh.points, *_made(work, s))
        after += penalty(mesh, angle)
        if angle <= 0.0 or angle < worst:
            return 0.0
    return before - after if before - after > least else 0.0


@lean
def _longest_listed(mesh, a, b, n, work):
    """Return the largest squared length of an edge of the cells around an edge."""
    longest2 = squared_length(mesh.points, a, b)
    for s in range(n):
        for side in range(1, 3):
            node = work.rows[s, side]
            longest2 = max(longest2, squared_length(mesh.points, a, node))
            longest2 = max(longest2, squared_length(mesh.points, b, node))
        u, w = work.rows[s, 1], work.rows[s, 2]
        longest2 = max(longest2, squared_length(mesh.points, u, w))
    return longest2


@lean
def rows_at_edge(cx, a, b):
    """Return the number of triangles at an edge, and the first and the last one."""
    count, last = count_with(cx, a, b, -1)
    first = last
    corner = np.int64(cx.head[a])
    while corner >= 0:
        if has_node(cx, corner // 3, b):
            first = corner // 3
            break
        corner = np.int64(cx.after[corner])
    return count, first, last


@lean
def third_node(cx, row, a, b):
    """Return the node of a triangle beside a and b."""
    return np.int64(cx.nodes[row, 0]) + cx.nodes[row, 1] + cx.nodes[row, 2] - a - b


@lean
def _new_facets_at(facets, first, last, a, b):
    """Return the two facets with the other diagonal, and its ends."""
    p, q = third_node(facets, first, a, b), third_node(facets, last, a, b)
    # In the first facet (a, b, p) or (b, a, p): a is followed by b or by p.
    one, other = (a, b, p), (a, b, p)
    for v in range(3):
        if facets.nodes[first, v] == a:
            if facets.nodes[first, (v + 1) % 3] == b:
                one, other = (a, q, p), (q, b, p)
            else:
                one, other = (a, p, q), (p, b, q)
    return one, other, p, q


@lean
def _ring_of_edge(mesh, a, b, least, work):
    """List the cells around an edge and better ones without it.

    Returns
    -------
    float
        By how much the penalty falls, or 0.
    int, int
        Number of old and of new cells.
    int, int
        The facets at the edge, -1 if there are none.
    """
    facets, none = mesh.facets, np.int64(-1)
    count, first, last = rows_at_edge(mesh.facets, a, b)
    if count not in (0, 2) or count_with(mesh.lines, a, b, -1)[0] > 0:
        return 0.0, 0, 0, none, none
    n = _list_rows_around(mesh, a, b, work)
    if n == 0:
        return 0.0, 0, 0, none, none
    longest2, n_made = _longest_listed(mesh, a, b, n, work), 0
    if count == 0:
        length, passed, end = _set_loop(work, n, work.rows[0, 1], none)
        if passed != n or end != work.loop[0] or n < 3:
            return 0.0, 0, 0, none, none
        if _fill_best(mesh.points, a, b, 0, n - 1, work) <= 0.0:
            return 0.0, 0, 0, none, none
        label = mesh.cells.label[work.rows[0, 0]]
        n_made = _list_filling(mesh, a, b, 0, n - 1, label, 0, longest2, work)
    else:
        if facets.label[first] != facets.label[last]:
            return 0.0, 0, 0, none, none
        n_made = _fill_sides(mesh, a, b, n, first, last, longest2, work)
    drop = _drop_of_made(mesh, n, n_made, least, work) if n_made >= 0 else 0.0
    return drop, n, max(n_made, 0), first, last


@lean
def _fill_sides(mesh, a, b, n, first, last, longest2, work):
    """List the best cells on the sides of an edge of facets; return their number, or -1."""
    facets, cells = mesh.facets, mesh.cells
    p, q = third_node(facets, first, a, b), third_node(facets, last, a, b)
    if _step(work, n, p) < 0:
        p, q = q, p
    if p == q or are_joined(facets, p, q):
        return -1
    passed, n_made, shortest = 0, 0, n
    start, stop = p, q
    for _ in range(2):
        if passed == n:
            break
        s = _step(work, n, start)
        if s < 0:
            return -1
        label = cells.label[work.rows[s, 0]]
        length, more, end = _set_loop(work, n, start, stop)
        if end != stop:
            return -1
        passed += more
        shortest = min(shortest, more)
        if more > 1:
            if _fill_best(mesh.points, a, b, 0, more, work) <= 0.0:
                return -1
            n_made = _list_filling(mesh, a, b, 0, more, label, n_made, longest2, work)
            if n_made < 0:
                return -1
        start, stop = q, p
    # Only a flat cell that vanishes may have the new edge before.
    is_fresh = shortest == 1 or not are_joined(cells, p, q)
    return n_made if passed == n and is_fresh else -1


@lean
def drop_of_edge(mesh, a, b, least, work):
    """Return by how much the penalty falls if an edge of tetrahedra is removed, or 0."""
    drop, n_old, n_made, first, last = _ring_of_edge(mesh, a, b, least, work)
    if drop <= 0.0 or mesh.cells.count[0] + n_old < n_made:
        return 0.0
    if first >= 0:
        one, other, p, q = _new_facets_at(mesh.facets, first, last, a, b)
        length2 = squared_length(mesh.points, p, q)
        if length2 > max(squared_length(mesh.points, a, b), limit_of_edge(mesh, p, q)):
            return 0.0
        label = mesh.facets.label[first]
        if not _replaced_fit(mesh, (first, last), (one, other, other), label, work):
            return 0.0
    return drop


@lean
def remove_edge(mesh, a, b, work):
    """Remove an edge of tetrahedra, as `drop_of_edge` has found."""
    _, n_old, n_made, first, last = _ring_of_edge(mesh, a, b, -1e300, work)
    for s in range(n_old):
        remove_row(mesh.cells, work.rows[s, 0])
    if first >= 0:
        one, other, _, _ = _new_facets_at(mesh.facets, first, last, a, b)
        label = mesh.facets.label[first]
        _replace_facets(mesh, (first, last), (one, other, other), label, work)
    _add_made(mesh, n_made, work)
    requeue(mesh, a, work)
    requeue(mesh, b, work)
    for s in range(n_old):
        requeue(mesh, work.rows[s, 1], work)
        requeue(mesh, work.rows[s, 2], work)


@lean
def _add_made(mesh, n_made, work):
    for s in range(n_made):
        row = add_row(mesh.cells, _made(work, s), work.made[s, 4])
        update_angle(mesh, row)


@lean
def _cells_at_face(mesh, c, v, work):
    """List the cells on both sides of a face and the three across it; return whether they exist."""
    cells = mesh.cells
    nodes = nodes_of(cells, c)
    o = nodes[v]
    f, g, h = nodes[(v + 1) % 4], nodes[(v + 2) % 4], nodes[(v + 3) % 4]
    if v % 2 == 0:  # so that (f, g, h, o) is positive
        g, h = h, g
    across, count = np.int64(-1), 0
    corner = np.int64(cells.head[f])
    while corner >= 0:
        row = corner // 4
        corner = np.int64(cells.after[corner])
        if row != c and has_node(cells, row, g) and has_node(cells, row, h):
            across, count = row, count + 1
    if count != 1 or cells.label[across] != cells.label[c]:
        return False
    if count_with(mesh.facets, f, g, h)[0] > 0:
        return False
    p = -(f + g + h)
    for w in range(4):
        p += cells.nodes[across, w]
    if are_joined(cells, o, p):
        return False
    work.rows[0, 0], work.rows[1, 0] = c, across
    label = cells.label[c]
    _set_made(work, 0, (p, o, f, g), label)
    _set_made(work, 1, (p, o, g, h), label)
    _set_made(work, 2, (p, o, h, f), label)
    return True


@lean
def drop_of_face(mesh, c, v, least, work):
    """Return by how much the penalty falls if the face opposite to a corner is removed, or 0."""
    if mesh.cells.count[0] < 1 or not _cells_at_face(mesh, c, v, work):
        return 0.0
    p, o = work.made[0, 0], work.made[0, 1]
    if squared_length(mesh.points, p, o) > limit_of_edge(mesh, p, o):
        return 0.0
    return _drop_of_made(mesh, 2, 3, least, work)


@lean
def remove_face(mesh, c, v, work):
    """Remove a face of tetrahedra, as `drop_of_face` has found."""
    _cells_at_face(mesh, c, v, work)
    remove_row(mesh.cells, work.rows[0, 0])
    remove_row(mesh.cells, work.rows[1, 0])
    _add_made(mesh, 3, work)
    for s in range(3):
        requeue(mesh, work.made[s, 2], work)
    requeue(mesh, work.made[0, 0], work)
    requeue(mesh, work.made[0, 1], work)


@lean
def _facet_of_cell(mesh, c):
    """Return the only facet of a cell, its other node and the new facets; -1 if it must stay."""
    cells, facets = mesh.cells, mesh.facets
    found, top = np.int64(-1), np.int64(-1)
    nodes = nodes_of(cells, c)
    for v in range(4):
        f, g, h = nodes[(v + 1) % 4], nodes[(v + 2) % 4], nodes[(v + 3) % 4]
        count, row = count_with(facets, f, g, h)
        if count > 0:
            if found >= 0 or count_with(cells, f, g, h)[0] != 1:
                return np.int64(-1), top
            found, top = row, nodes[v]
    if found < 0 or facets.head[top] >= 0 or facets.count[0] < 2:
        return np.int64(-1), top
    return found, top


@lean
def drop_of_cell(mesh, c, least, work):
    """Return by how much the penalty falls if a cell with one facet on the boundary vanishes."""
    drop = penalty(mesh, mesh.angle[c])
    if drop <= least:
        return 0.0
    row, p = _facet_of_cell(mesh, c)
    if row < 0:
        return 0.0
    a, b, d, _ = nodes_of(mesh.facets, row)
    new = ((a, b, p), (b, d, p), (d, a, p))
    label = mesh.facets.label[row]
    return drop if _replaced_fit(mesh, (row, np.int64(-1)), new, label, work) else 0.0


@lean
def remove_cell(mesh, c, work):
    """Remove a cell with one facet on the boundary, as `drop_of_cell` has found."""
    row, p = _facet_of_cell(mesh, c)
    a, b, d, _ = nodes_of(mesh.facets, row)
    remove_row(mesh.cells, c)
    new = ((a, b, p), (b, d, p), (d, a, p))
    _replace_facets(mesh, (row, np.int64(-1)), new, mesh.facets.label[row], work)
    for i in (a, b, d, p):
        requeue(mesh, i, work)


@lean
def drop_of_flip(mesh, a, b, least, work):
    """Return by how much the penalty falls if an edge of triangles is flipped, or 0."""
    cells, points = mesh.cells, mesh.points
    if count_with(mesh.lines, a, b, -1)[0] > 0:
        return 0.0
    count, first, last = rows_at_edge(cells, a, b)
    if count != 2 or cells.label[first] != cells.label[last]:
        return 0.0
    one, other, p, q = _new_facets_at(cells, first, last, a, b)
    if p == q or are_joined(cells, p, q):
        return 0.0
    length2 = squared_length(points, p, q)
    if length2 > max(squared_length(points, a, b), limit_of_edge(mesh, p, q)):
        return 0.0
    before = penalty(mesh, mesh.angle[first]) + penalty(mesh, mesh.angle[last])
    worst, after = min(mesh.angle[first], mesh.angle[last]), 0.0
    for nodes in (one, other):
        angle = triangle_angle(points, mesh.kind, nodes[0], nodes[1], nodes[2])
        after += penalty(mesh, angle)
        if angle <= 0.0 or angle < worst:
            return 0.0
    if before - after <= least:
        return 0.0
    if mesh.kind != PLANE:
        label = cells.label[first]
        if not _replaced_fit(mesh, (first, last), (one, other, other), label, work):
            return 0.0
    return before - after


@lean
def flip_edge(mesh, a, b, work):
    """Flip an edge of triangles, as `drop_of_flip` has found."""
    cells = mesh.cells
    _, first, last = rows_at_edge(cells, a, b)
    one, other, p, q = _new_facets_at(cells, first, last, a, b)
    label = cells.label[first]
    if mesh.kind == PLANE:
        remove_row(cells, first)
        remove_row(cells, last)
        rows = add_row(cells, (*one, one[2]), label), add_row(cells, (*other, other[2]), label)
    else:
        _replace_facets(mesh, (first, last), (one, other, other), label, work)
        rows = rows_at_edge(cells, p, q)[1:]
    for row in rows:
        update_angle(mesh, row)
    for i in (a, b, p, q):
        requeue(mesh, i, work)
