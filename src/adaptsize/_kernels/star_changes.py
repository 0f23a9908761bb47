"""Local operations on the cells around a node: a move of the node, or a collapse of an edge.

To collapse an edge is to move node i onto its neighbour j and to remove what contains both.  The
topology is kept if the links of the ends have nothing in common but the link of the edge.  For the
facets and the lines of the mesh, the same holds with one more node that is joined to all of them.

References
----------
T. K. Dey, H. Edelsbrunner, S. Guha, D. V. Nekhayev, "Topology preserving edge contraction", Publ.
Inst. Math. 66 (1999) 23-45.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.complexes import (
    CELLS,
    FACETS,
    LINES,
    NONE,
    first_corner,
    has_node,
    is_on,
    next_corner,
    nodes_of,
    remove_row,
    replace_node,
    rows_with,
)
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
    TETRAHEDRA,
    angle_of,
    limit_of_edge,
    penalty,
    requeue,
    squared_length,
    update_angle,
)
from adaptsize._kernels.vectors import cross, dot, frame, minus, norm, unit

#: Least cosine of the angle by which a facet may turn.
_LEAST_COSINE = 0.3
#: First step of the search for a better place of a node, in the mean distance of its neighbours,
#: and number of rounds.
_STEP, _ROUNDS = 0.3, 5
#: Edges may become as short as this share of the size by moves.
_SHORTEST = 0.7
#: Normals of the two sides of a wall have a smaller cosine.
_OPPOSITE = -0.5


@lean
def _list_around(cx, level, i, work):
    """List node i and its neighbours in a level; return their number, -1 if there are too many."""
    now = work.stamps.shape[0] - 1
    work.stamps[now, 0] += 1
    stamp = work.stamps[now, 0]
    work.stamps[i, 0] = stamp
    work.around[0], n = i, np.int64(1)
    corner = first_corner(cx, level, i)
    while corner >= 0:
        for a in nodes_of(cx, corner // 4):
            if a >= 0 and work.stamps[a, 0] != stamp:
                work.stamps[a, 0] = stamp
                if n == MOST_NODES:
                    return NONE
                work.around[n] = a
                n += 1
        corner = next_corner(cx, corner)
    return n


@lean
def _mark_link(cx, level, i, j, work):
    """Stamp the nodes of simplices with i, and those of simplices with i and j; return the time."""
    now = work.stamps.shape[0] - 1
    work.stamps[now, 0] += 1
    stamp = work.stamps[now, 0]
    corner = first_corner(cx, level, i)
    while corner >= 0:
        at_edge = has_node(cx, corner // 4, j)
        for a in nodes_of(cx, corner // 4):
            if a >= 0:
                work.stamps[a, 0] = stamp
                if at_edge:
                    work.stamps[a, 1] = stamp
        corner = next_corner(cx, corner)
    return stamp


@lean
def _shares_face(cx, level, row, i, j):
    """Return whether a simplex at i has all nodes of a row but j, which is one of them."""
    corner = first_corner(cx, level, i)
    while corner >= 0:
        same = True
        for a in nodes_of(cx, row):
            same = same and (a < 0 or a == j or has_node(cx, corner // 4, a))
        if same:
            return True
        corner = next_corner(cx, corner)
    return False


@lean
def _shares_edge(cx, row, i, j, stamp, work):
    """Return whether an edge of a cell at j is in the link of i, but not in that of both."""
    nodes = nodes_of(cx, row)
    for v in range(4):
        for w in range(v):
            a, b = nodes[v], nodes[w]
            if a < 0 or j in (a, b):
                continue
            if work.stamps[a, 0] != stamp or work.stamps[b, 0] != stamp:
                continue
            of_i, of_both = False, False
            corner = first_corner(cx, CELLS, i)
            while corner >= 0:
                other = corner // 4
                if has_node(cx, other, a) and has_node(cx, other, b):
                    of_i = True
                    of_both = of_both or has_node(cx, other, j)
                corner = next_corner(cx, corner)
            if of_i and not of_both:
                return True
    return False


@lean
def _links_meet_elsewhere(cx, level, i, j, work):
    """Return whether the links of i and j have more in common than the link of the edge ij.

    Of facets and lines, the links with the node that is joined to all of them are compared.
    """
    if level != CELLS and not (is_on(cx, level, i) and is_on(cx, level, j)):
        return False
    stamp, at_edge = _mark_link(cx, level, i, j, work), False
    corner = first_corner(cx, level, j)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(cx, corner)
        if has_node(cx, row, i):
            at_edge = True
            continue
        for a in nodes_of(cx, row):
            if a < 0 or a == j:
                continue
            if work.stamps[a, 0] == stamp and work.stamps[a, 1] != stamp:
                return True
        if _shares_face(cx, level, row, i, j):
            return True
        if level == CELLS and _shares_edge(cx, row, i, j, stamp, work):
            return True
    return not at_edge


@lean
def _may_vanish(mesh, i, j, work):
    """Return whether node i may be moved onto its neighbour j without a change of topology."""
    cx = mesh.cx
    if mesh.is_corner[i]:
        return False
    if is_on(cx, LINES, i) and rows_with(cx, LINES, i, j, NONE)[0] != 1:
        return False
    if is_on(cx, FACETS, i) and rows_with(cx, FACETS, i, j, NONE)[0] == 0:
        return False
    for level in (CELLS, FACETS, LINES):
        if (level != FACETS or mesh.kind == TETRAHEDRA) and _links_meet_elsewhere(
            cx, level, i, j, work
        ):
            return False
    return True


@lean
def _vanishes(cx, row, skip):
    return skip >= 0 and has_node(cx, row, skip)


@lean
def _drop_around(mesh, i, skip, least):
    """Return by how much the penalty falls if node i is where it is now; 0 if not by more.

    Cells with both i and ``skip`` vanish.
    """
    before, worst, after = 0.0, 180.0, 0.0
    corner = first_corner(mesh.cx, CELLS, i)
    while corner >= 0:
        angle = mesh.angle[corner // 4]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
        corner = next_corner(mesh.cx, corner)
    corner = first_corner(mesh.cx, CELLS, i)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(mesh.cx, corner)
        if _vanishes(mesh.cx, row, skip):
            continue
        angle = angle_of(mesh, nodes_of(mesh.cx, row))
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
    cx, points = mesh.cx, mesh.points
    longest2, shortest2 = 0.0, math.inf
    for turn in range(2):
        corner = first_corner(cx, CELLS, i)
        while corner >= 0:
            row = corner // 4
            corner = next_corner(cx, corner)
            if turn == 1 and _vanishes(cx, row, skip):
                continue
            for a in nodes_of(cx, row):
                if a < 0 or a == i:
                    continue
                if turn == 0:
                    e = minus(old, _place(points, a))
                    longest2, shortest2 = max(longest2, dot(e, e)), min(shortest2, dot(e, e))
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
    """Return the normal of a facet with node i at x, and its longest edge squared."""
    a, b, c, _ = nodes_of(mesh.cx, row)
    p, q, r = _place(mesh.points, a), _place(mesh.points, b), _place(mesh.points, c)
    if a == i:
        p = x
    elif b == i:
        q = x
    elif c == i:
        r = x
    u, v, w = minus(q, p), minus(r, p), minus(r, q)
    return cross(u, v), max(dot(u, u), dot(v, v), dot(w, w))


@lean
def _total_normal(mesh, i, x):
    """Return the sum of the normals of the facets at node i, which is at x; that of lengths."""
    total, area = (0.0, 0.0, 0.0), 0.0
    corner = first_corner(mesh.cx, mesh.facets, i)
    while corner >= 0:
        n, _ = _normal_with(mesh, corner // 4, i, x)
        total = (total[0] + n[0], total[1] + n[1], total[2] + n[2])
        area += norm(n)
        corner = next_corner(mesh.cx, corner)
    return total, area


@lean
def _facets_keep_side(mesh, i, skip, old):
    """Return whether no facet at node i, which was at ``old``, turns far.

    The normal of a facet of less height than the tolerance means nothing; it is replaced by the
    mean one of the facets.
    """
    now = _place(mesh.points, i)
    total, area = _total_normal(mesh, i, old)
    is_smooth, tolerance = norm(total) > 0.7 * area, mesh.samples.tolerance
    corner = first_corner(mesh.cx, mesh.facets, i)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(mesh.cx, corner)
        if _vanishes(mesh.cx, row, skip):
            continue
        before, longest2 = _normal_with(mesh, row, i, old)
        after, _ = _normal_with(mesh, row, i, now)
        if dot(before, before) <= tolerance * tolerance * longest2:
            if not is_smooth:
                continue
            before = total
        if dot(before, after) < _LEAST_COSINE * norm(before) * norm(after):
            return False
    return True


@lean
def _is_in_envelope(mesh, level, i, skip, work):
    """Return whether the simplices at node i are within the tolerance, in both directions."""
    cx, given = mesh.cx, mesh.curves if level == LINES else mesh.surface
    if not is_on(cx, level, i):
        return True
    limit2 = allowed_at(mesh.samples, cx, level, i)
    gone = (i, skip, NONE)
    n_around = _list_around(cx, level, i, work)
    if n_around < 0:
        return False
    for turn in range(2):
        corner = first_corner(cx, level, i)
        while corner >= 0:
            row = corner // 4
            corner = next_corner(cx, corner)
            if turn == 0:
                if not _vanishes(cx, row, skip) and not is_row_within(
                    given, cx, mesh.points, row, limit2, work.stack
                ):
                    return False
            elif not are_samples_kept(
                mesh.samples, cx, level, mesh.points, row, gone, work.around, n_around
            ):
                return False
    return True


@lean
def _fits(mesh, i, skip, old, work):
    """Return whether all that is required of an operation holds with node i where it is now."""
    if not _lengths_fit(mesh, i, skip, old):
        return False
    if mesh.kind != PLANE and not _facets_keep_side(mesh, i, skip, old):
        return False
    for turn in range(2):
        if turn == 1 and mesh.kind == PLANE:
            break
        if not _is_in_envelope(mesh, LINES if turn == 0 else mesh.facets, i, skip, work):
            return False
    return True


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
def _change_level(mesh, level, i, j, work):
    """Move node i of a level onto j unless this is negative, and update what depends on it."""
    cx, samples, given = mesh.cx, mesh.samples, mesh.curves if level == LINES else mesh.surface
    has_samples = level == LINES or (level == mesh.facets and mesh.kind != PLANE)
    n_around, chain = np.int64(0), NONE
    if has_samples:
        n_around = _list_around(cx, level, i, work)
    corner = first_corner(cx, level, i)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(cx, corner)
        if has_samples:
            chain = detach_samples(samples, row, chain)
        if j >= 0 and has_node(cx, row, j):
            remove_row(cx, row)
        elif j >= 0:
            replace_node(cx, row, i, j)
    if has_samples:
        attach_samples(samples, cx, level, mesh.points, work.around, n_around, chain)
        corner = first_corner(cx, level, i if j < 0 else j)
        while corner >= 0:
            measure_row(given, samples, cx, mesh.points, corner // 4, work.stack)
            corner = next_corner(cx, corner)


@lean
def change_star(mesh, i, j, x, work):
    """Move node i to x, or onto its neighbour j unless this is negative."""
    if j < 0:
        _put(mesh.points, i, x)
    for level in (CELLS, FACETS, LINES):
        if is_on(mesh.cx, level, i):
            _change_level(mesh, level, i, j, work)
    for turn in range(2):  # angles first, since cells are put into the queue by them
        corner = first_corner(mesh.cx, CELLS, i if j < 0 else j)
        while corner >= 0:
            row = corner // 4
            corner = next_corner(mesh.cx, corner)
            if turn == 0:
                update_angle(mesh, row)
                continue
            for a in nodes_of(mesh.cx, row):
                if a >= 0:
                    requeue(mesh, a, work)


@lean
def _directions(mesh, i):
    """Return how many directions a node may move in, 0 to 3, and three orthogonal vectors."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    if mesh.is_corner[i]:
        return 0, x, y, z
    if is_on(mesh.cx, LINES, i):
        corner, one, other = first_corner(mesh.cx, LINES, i), i, i
        while corner >= 0:
            a, b, _, _ = nodes_of(mesh.cx, corner // 4)
            one, other = a + b - i, one
            corner = next_corner(mesh.cx, corner)
        along = unit(minus(_place(mesh.points, one), _place(mesh.points, other)))
        return (1 if norm(along) > 0.0 else 0), along, y, z
    if mesh.kind == PLANE:
        return 2, x, y, z
    if not is_on(mesh.cx, mesh.facets, i):
        return 3, x, y, z
    normal, _ = _total_normal(mesh, i, _place(mesh.points, i))
    u, v = frame(unit(normal))
    return 2, u, v, z


@lean
def _onto_given(mesh, i, x, reach, work):
    """Return whether x may be put onto the given surface or curve on which node i is, and where."""
    level = LINES if is_on(mesh.cx, LINES, i) else mesh.facets
    if not is_on(mesh.cx, level, i) or (mesh.kind == PLANE and level != LINES):
        return True, x
    reach += math.sqrt(allowed_at(mesh.samples, mesh.cx, level, i))
    label = mesh.cx.about[first_corner(mesh.cx, level, i) // 4, 0]
    given = mesh.curves if level == LINES else mesh.surface
    return projected(given, label, x, reach * reach, work.stack)


@lean
def _mean_length(mesh, i):
    total, count = 0.0, 0
    corner = first_corner(mesh.cx, CELLS, i)
    while corner >= 0:
        for a in nodes_of(mesh.cx, corner // 4):
            if a >= 0 and a != i:
                total += math.sqrt(squared_length(mesh.points, i, a))
                count += 1
        corner = next_corner(mesh.cx, corner)
    return total / max(count, 1)


@lean
def _better_place(mesh, i, least, work):
    """Return the best place of node i that is found, and by how much the penalty falls there.

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
            drop = _drop_around(mesh, i, NONE, best)
            if drop > best:
                best, at, improved = drop, x, True
        if not improved:
            step *= 0.5
    _put(points, i, old)
    return at, best


@lean
def drop_of_move(mesh, i, least, work):
    """Return by how much the penalty falls if node i is moved, or 0; its place is in the work."""
    points, old = mesh.points, _place(mesh.points, i)
    at, best = _better_place(mesh, i, least, work)
    drop = 0.0
    for _ in range(3 if best > least else 0):  # half of the way if all of it is too far
        _put(points, i, at)
        drop = _drop_around(mesh, i, NONE, least)
        if drop > 0.0 and _fits(mesh, i, NONE, old, work):
            work.place[0], work.place[1], work.place[2] = at
            break
        drop = 0.0
        half = (0.5 * (old[0] + at[0]), 0.5 * (old[1] + at[1]), 0.5 * (old[2] + at[2]))
        is_near, at = _onto_given(mesh, i, half, norm(minus(at, old)), work)
        if not is_near:
            break
    _put(points, i, old)
    return drop


@lean
def is_across_wall(mesh, c):
    """Return whether a cell has nodes on both sides of a wall thinner than the tolerance."""
    nodes = nodes_of(mesh.cx, c)
    for v in range(4):
        for w in range(v):
            i, j = nodes[v], nodes[w]
            if not (is_on(mesh.cx, FACETS, i) and is_on(mesh.cx, FACETS, j)):
                continue
            at_i, at_j = _place(mesh.points, i), _place(mesh.points, j)
            n, m = unit(_total_normal(mesh, i, at_i)[0]), unit(_total_normal(mesh, j, at_j)[0])
            thickness = abs(dot(n, minus(at_i, at_j)))
            if dot(n, m) < _OPPOSITE and thickness < mesh.samples.tolerance:
                return True
    return False


@lean
def drop_of_lift(mesh, i, least, work):
    """Return by how much the penalty falls if node i leaves the given surface, or 0.

    Steps along the normal to both sides are tested, up to the tolerance; the place of the best is
    in the work.  Nodes of lines stay on these.
    """
    cx, points = mesh.cx, mesh.points
    if mesh.is_corner[i] or not is_on(cx, FACETS, i) or is_on(cx, LINES, i):
        return 0.0
    old, found = _place(points, i), 0.0
    e, step = unit(_total_normal(mesh, i, old)[0]), mesh.samples.tolerance
    label, farthest2 = cx.about[first_corner(cx, FACETS, i) // 4, 0], step * step
    for turn in range(2 * _ROUNDS):
        s = step if turn % 2 == 0 else -step
        x = (old[0] + s * e[0], old[1] + s * e[1], old[2] + s * e[2])
        _put(points, i, x)
        drop = _drop_around(mesh, i, NONE, max(least, found))
        # What `_fits` looks at are places between the nodes.
        is_near = drop > 0.0 and projected(mesh.surface, label, x, farthest2, work.stack)[0]
        if is_near and _fits(mesh, i, NONE, old, work):
            found = drop
            work.place[0], work.place[1], work.place[2] = x
        if turn % 2 == 1:
            step *= 0.5
    _put(points, i, old)
    return found
