"""Local operations on the cells around a node: a move of the node, or a collapse of an edge.

To collapse an edge is to move node i onto its neighbour j and to remove what contains both.  The
topology is kept if the links of the ends have nothing in common but the link of the edge.  For the
facets and the feature lines of the mesh, the same holds with one more node that is joined to all of
them.

References
----------
T. K. Dey, H. Edelsbrunner, S. Guha, D. V. Nekhayev, "Topology preserving edge contraction", Publ.
Inst. Math. 66 (1999) 23-45.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.complexes import count_with, has_node, remove_row, replace_node
from adaptsize._kernels.envelope import (
    allowed_at,
    are_samples_kept,
    attach_samples,
    detach_samples,
    is_row_within,
    measure_row,
    projected,
)
from adaptsize._kernels.local_mesh import (
    MOST_NODES,
    PLANE,
    SURFACE,
    TETRAHEDRA,
    angle_of,
    limit_of_edge,
    nodes_of,
    penalty,
    requeue,
    squared_length,
    update_angle,
)
from adaptsize._kernels.vectors import cross, dot, frame, minus, norm, unit

#: Least cosine of the angle by which a facet may turn.
_LEAST_COSINE = 0.3
#: Steps of the search for a better place of a node, in its mean distance from its neighbours, and
#: how often it is halved.
_STEP, _ROUNDS = 0.3, 5
#: Edges may become as short as this share of the size by moves.
_SHORTEST = 0.7


@lean
def _new_stamp(work):
    work.stamp[0] += 1
    return work.stamp[0]


@lean
def _list_star(cx, i, work, n):
    """Add the nodes of the simplices at node i to a list; return their number, -1 if too many."""
    if n < 0:
        return n
    k, stamp = cx.nodes.shape[1], work.stamp[0]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        row = corner // k
        for v in range(k):
            a = np.int64(cx.nodes[row, v])
            if work.seen[a] != stamp:
                work.seen[a] = stamp
                if n == MOST_NODES:
                    return -1
                work.around[n] = a
                n += 1
        corner = np.int64(cx.after[corner])
    return n


@lean
def list_around(cx, i, work):
    """List node i and its neighbours in a complex; return their number, -1 if there are too many."""
    stamp = _new_stamp(work)
    work.seen[i] = stamp
    work.around[0] = i
    return _list_star(cx, i, work, 1)


@lean
def _mark_link(cx, i, j, work):
    """Stamp what is in simplices with i in ``seen``, and with i and j in ``joined``."""
    stamp, k = _new_stamp(work), cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        row = corner // k
        at_edge = has_node(cx, row, j)
        for v in range(k):
            a = cx.nodes[row, v]
            work.seen[a] = stamp
            if at_edge:
                work.joined[a] = stamp
        corner = np.int64(cx.after[corner])
    return stamp


@lean
def _links_meet_elsewhere(cx, i, j, work):
    """Return whether the links of i and j have a simplex in common that is not in that of ij."""
    stamp, k = _mark_link(cx, i, j, work), cx.nodes.shape[1]
    corner = np.int64(cx.head[j])
    while corner >= 0:
        row = corner // k
        corner = np.int64(cx.after[corner])
        if has_node(cx, row, i):
            continue
        for v in range(k):
            a = cx.nodes[row, v]
            if a != j and work.seen[a] == stamp:
                if work.joined[a] != stamp:
                    return True
                # Edges in both links: of a triangle each, and in no simplex with both ends.
                for z in range(v):
                    b = cx.nodes[row, z]
                    if b == j or work.seen[b] != stamp:
                        continue
                    if count_with(cx, i, a, b)[0] > 0 and not _has_four(cx, i, j, a, b):
                        return True
        if k == 4 and _has_all_but(cx, row, i, j):
            return True
    return False


@lean
def _has_four(cx, i, j, a, b):
    """Return whether a simplex contains four nodes, or for triangles never."""
    k = cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        row = corner // k
        if has_node(cx, row, j) and has_node(cx, row, a) and has_node(cx, row, b):
            return True
        corner = np.int64(cx.after[corner])
    return False


@lean
def _has_all_but(cx, row, i, j):
    """Return whether a simplex at i has all nodes of a row at j but j."""
    k = cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        other, same = corner // k, 0
        for v in range(k):
            if cx.nodes[row, v] != j and has_node(cx, other, cx.nodes[row, v]):
                same += 1
        if same == k - 1:
            return True
        corner = np.int64(cx.after[corner])
    return False


@lean
def _meet_outside(cx, i, j, work):
    """Return whether the links of i and j with the common node of all simplices meet elsewhere.

    For facets of tetrahedra and for lines.
    """
    if cx.head[i] < 0 or cx.head[j] < 0:
        return False
    stamp, k, at_edge = _mark_link(cx, i, j, work), cx.nodes.shape[1], False
    corner = np.int64(cx.head[j])
    while corner >= 0:
        row = corner // k
        corner = np.int64(cx.after[corner])
        if has_node(cx, row, i):
            at_edge = True
            continue
        for v in range(k):
            a = cx.nodes[row, v]
            if a != j and work.seen[a] == stamp and work.joined[a] != stamp:
                return True
        if k == 3 and _has_all_but(cx, row, i, j):
            return True
    return not at_edge


@lean
def _may_vanish(mesh, i, j, work):
    """Return whether node i may be moved onto its neighbour j without a change of topology."""
    if mesh.is_corner[i]:
        return False
    if mesh.lines.head[i] >= 0 and count_with(mesh.lines, i, j, -1)[0] != 1:
        return False
    if mesh.kind == TETRAHEDRA and mesh.facets.head[i] >= 0:
        if count_with(mesh.facets, i, j, -1)[0] == 0:
            return False
        if _meet_outside(mesh.facets, i, j, work):
            return False
    if _meet_outside(mesh.lines, i, j, work):
        return False
    return not _links_meet_elsewhere(mesh.cells, i, j, work)


@lean
def _drop_around(mesh, i, skip, least):
    """Return by how much the penalty falls if node i is where it is now; 0 if not by more.

    Cells with both i and ``skip`` vanish.
    """
    cells, k = mesh.cells, mesh.cells.nodes.shape[1]
    before, worst = 0.0, 180.0
    corner = np.int64(cells.head[i])
    while corner >= 0:
        angle = mesh.angle[corner // k]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
        corner = np.int64(cells.after[corner])
    corner, after = np.int64(cells.head[i]), 0.0
    while corner >= 0:
        row = corner // k
        corner = np.int64(cells.after[corner])
        if skip >= 0 and has_node(cells, row, skip):
            continue
        angle = angle_of(mesh, nodes_of(cells, row))
        after += penalty(mesh, angle)
        if angle <= 0.0 or angle < worst or before - after <= least:
            return 0.0
    return before - after


@lean
def _put(points, i, x):
    points[i, 0], points[i, 1], points[i, 2] = x


@lean
def _place(points, i):
    return points[i, 0], points[i, 1], points[i, 2]


@lean
def _lengths_fit(mesh, i, skip, old):
    """Return whether no edge at node i, which was at ``old``, becomes too long or too short."""
    cells, points, k = mesh.cells, mesh.points, mesh.cells.nodes.shape[1]
    longest2, shortest2 = 0.0, math.inf
    for turn in range(2):
        corner = np.int64(cells.head[i])
        while corner >= 0:
            row = corner // k
            corner = np.int64(cells.after[corner])
            for v in range(k):
                a = cells.nodes[row, v]
                if a == i:
                    continue
                if turn == 0:
                    e = minus(old, _place(points, a))
                    longest2, shortest2 = max(longest2, dot(e, e)), min(shortest2, dot(e, e))
                    continue
                if skip >= 0 and has_node(cells, row, skip):
                    continue
                length2 = squared_length(points, i, a)
                limit2 = limit_of_edge(mesh, i if skip < 0 else skip, a)
                if length2 > max(limit2, longest2):
                    return False
                if skip < 0 and length2 < min(0.5 * _SHORTEST * _SHORTEST * limit2, shortest2):
                    return False
    return True


@lean
def _normal_with(mesh, row, i, x):
    """Return the normal of a facet with node i at x."""
    a, b, c, _ = nodes_of(mesh.facets, row)
    p, q, r = _place(mesh.points, a), _place(mesh.points, b), _place(mesh.points, c)
    if a == i:
        p = x
    if b == i:
        q = x
    if c == i:
        r = x
    return cross(minus(q, p), minus(r, p))


@lean
def _facets_keep_side(mesh, i, skip, old):
    """Return whether no facet at node i, which was at ``old``, turns far.

    The normal of a facet of less height than the tolerance means nothing; it is replaced by the
    mean one of the facets.
    """
    facets, now = mesh.facets, _place(mesh.points, i)
    if mesh.kind == PLANE:
        return True
    total, area = (0.0, 0.0, 0.0), 0.0
    corner = np.int64(facets.head[i])
    while corner >= 0:
        n = _normal_with(mesh, corner // 3, i, old)
        total = (total[0] + n[0], total[1] + n[1], total[2] + n[2])
        area += norm(n)
        corner = np.int64(facets.after[corner])
    is_smooth = norm(total) > 0.7 * area
    corner = np.int64(facets.head[i])
    while corner >= 0:
        row = corner // 3
        corner = np.int64(facets.after[corner])
        if skip >= 0 and has_node(facets, row, skip):
            continue
        before, after = _normal_with(mesh, row, i, old), _normal_with(mesh, row, i, now)
        a, b, c, _ = nodes_of(facets, row)
        points = mesh.points
        longest2 = max(
            squared_length(points, a, b), squared_length(points, b, c), squared_length(points, c, a)
        )
        if dot(before, before) <= mesh.surface.tolerance * mesh.surface.tolerance * longest2:
            if not is_smooth:
                continue
            before = total
        if dot(before, after) < _LEAST_COSINE * norm(before) * norm(after):
            return False
    return True


@lean
def _is_in_envelope(env, cx, points, i, skip, work):
    """Return whether the simplices at node i are within the tolerance, in both directions."""
    if cx.head[i] < 0:
        return True
    limit2, k = allowed_at(env, cx, i), cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        row = corner // k
        corner = np.int64(cx.after[corner])
        if skip >= 0 and has_node(cx, row, skip):
            continue
        if not is_row_within(env, cx, points, row, limit2, work.stack):
            return False
    n_around = list_around(cx, i, work)
    if n_around < 0:
        return False
    return are_samples_kept(env, cx, points, i, skip, work.around, n_around)


@lean
def _fits(mesh, i, skip, old, work):
    """Return whether all that is required of an operation holds with node i where it is now."""
    return (
        _lengths_fit(mesh, i, skip, old)
        and _facets_keep_side(mesh, i, skip, old)
        and (
            mesh.kind == PLANE
            or _is_in_envelope(mesh.surface, mesh.facets, mesh.points, i, skip, work)
        )
        and _is_in_envelope(mesh.curves, mesh.lines, mesh.points, i, skip, work)
    )


@lean
def drop_of_collapse(mesh, i, j, least, work):
    """Return by how much the penalty falls if node i is moved onto its neighbour j, or 0."""
    if not _may_vanish(mesh, i, j, work):
        return 0.0
    old = _place(mesh.points, i)
    _put(mesh.points, i, _place(mesh.points, j))
    drop = _drop_around(mesh, i, j, least)
    if drop > 0.0 and not _fits(mesh, i, j, old, work):
        drop = 0.0
    _put(mesh.points, i, old)
    return drop


@lean
def _collapse_in(cx, i, j):
    k = cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        row = corner // k
        corner = np.int64(cx.after[corner])
        if has_node(cx, row, j):
            remove_row(cx, row)
        else:
            replace_node(cx, row, i, j)


@lean
def _detach_at(env, cx, i):
    chain, k = np.int64(-1), cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        chain = detach_samples(env, corner // k, chain)
        corner = np.int64(cx.after[corner])
    return chain


@lean
def _measure_at(env, cx, points, i, work):
    k = cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        measure_row(env, cx, points, corner // k, work.stack)
        corner = np.int64(cx.after[corner])


@lean
def _change_complex(env, cx, points, i, j, x, work):
    """Move node i of facets or lines to x, or onto j unless this is negative."""
    if cx.head[i] < 0:
        return
    n_around, chain = list_around(cx, i, work), _detach_at(env, cx, i)
    if j >= 0:
        _collapse_in(cx, i, j)
    else:
        _put(points, i, x)
        j = i
    attach_samples(env, cx, points, work.around, n_around, chain)
    _measure_at(env, cx, points, j, work)


@lean
def change_star(mesh, i, j, x, work):
    """Move node i to x, or onto its neighbour j unless this is negative."""
    points = mesh.points
    if mesh.kind != PLANE:
        _change_complex(mesh.surface, mesh.facets, points, i, j, x, work)
    _change_complex(mesh.curves, mesh.lines, points, i, j, x, work)
    if j < 0:
        _put(points, i, x)
    elif mesh.kind != SURFACE:  # of a surface, the facets are the cells
        _collapse_in(mesh.cells, i, j)
    at, k = i if j < 0 else j, mesh.cells.nodes.shape[1]
    corner = np.int64(mesh.cells.head[at])
    while corner >= 0:
        row = corner // k
        update_angle(mesh, row)
        corner = np.int64(mesh.cells.after[corner])
        for v in range(k):
            requeue(mesh, mesh.cells.nodes[row, v], work)


@lean
def _directions(mesh, i):
    """Return how many directions a node may move in, 0 to 3, and three orthogonal vectors."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    if mesh.is_corner[i]:
        return 0, x, y, z
    if mesh.lines.head[i] >= 0:
        corner, one, other = np.int64(mesh.lines.head[i]), i, i
        while corner >= 0:
            row = corner // 2
            one, other = mesh.lines.nodes[row, 0] + mesh.lines.nodes[row, 1] - i, one
            corner = np.int64(mesh.lines.after[corner])
        along = unit(minus(_place(mesh.points, one), _place(mesh.points, other)))
        return (1 if norm(along) > 0.0 else 0), along, y, z
    if mesh.kind == PLANE:
        return 2, x, y, z
    if mesh.facets.head[i] < 0:
        return 3, x, y, z
    normal, corner = (0.0, 0.0, 0.0), np.int64(mesh.facets.head[i])
    while corner >= 0:
        n = _normal_with(mesh, corner // 3, -1, x)
        normal = (normal[0] + n[0], normal[1] + n[1], normal[2] + n[2])
        corner = np.int64(mesh.facets.after[corner])
    u, v = frame(unit(normal))
    return 2, u, v, z


@lean
def _onto_given(mesh, i, x, reach, work):
    """Return whether x may be put onto the given surface or curve on which node i is, and where."""
    if mesh.lines.head[i] >= 0:
        reach += math.sqrt(allowed_at(mesh.curves, mesh.lines, i))
        label = mesh.lines.label[mesh.lines.head[i] // 2]
        return projected(mesh.curves, label, x, reach * reach, work.stack)
    if mesh.kind == PLANE or mesh.facets.head[i] < 0:
        return True, x
    reach += math.sqrt(allowed_at(mesh.surface, mesh.facets, i))
    label = mesh.facets.label[mesh.facets.head[i] // 3]
    return projected(mesh.surface, label, x, reach * reach, work.stack)


@lean
def _mean_length(mesh, i):
    cells, k, total, count = mesh.cells, mesh.cells.nodes.shape[1], 0.0, 0
    corner = np.int64(cells.head[i])
    while corner >= 0:
        for v in range(k):
            total += math.sqrt(squared_length(mesh.points, i, cells.nodes[corner // k, v]))
        count += k - 1
        corner = np.int64(cells.after[corner])
    return total / max(count, 1)


@lean
def drop_of_move(mesh, i, least, work):
    """Return by how much the penalty falls if node i is moved, or 0; its place is in the work.

    Steps in each direction are tested; if none is better, the step is halved.  Nodes of facets and
    lines stay on the given ones.
    """
    n_directions, u, v, w = _directions(mesh, i)
    points, old, step = mesh.points, _place(mesh.points, i), _STEP * _mean_length(mesh, i)
    best, at = least, old
    for _ in range(_ROUNDS if n_directions > 0 else 0):
        start, improved = at, False
        for turn in range(2 * n_directions):
            e = u if turn < 2 else (v if turn < 4 else w)
            s = step if turn % 2 == 0 else -step
            x = (start[0] + s * e[0], start[1] + s * e[1], start[2] + s * e[2])
            is_near, x = _onto_given(mesh, i, x, step, work)
            if not is_near:
                continue
            _put(points, i, x)
            drop = _drop_around(mesh, i, -1, best)
            if drop > best:
                best, at, improved = drop, x, True
        if not improved:
            step *= 0.5
    drop = 0.0
    for turn in range(3 if best > least else 0):
        _put(points, i, at)
        drop = _drop_around(mesh, i, -1, least)
        if drop > 0.0 and _fits(mesh, i, -1, old, work):
            work.place[0], work.place[1], work.place[2] = at
            break
        drop = 0.0
        half = (0.5 * (old[0] + at[0]), 0.5 * (old[1] + at[1]), 0.5 * (old[2] + at[2]))
        reach = norm(minus(at, old))
        is_near, at = _onto_given(mesh, i, half, reach, work)
        if not is_near:
            break
    _put(points, i, old)
    return drop
