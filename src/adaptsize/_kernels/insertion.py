"""Insertion of a node into a cavity of tetrahedra, also on facets and lines.

The new node is in a cell, on a face or on an edge.  The cavity begins with the cells that contain
this simplex.  Its faces are joined to the node.  As long as the worst of these new cells is bad,
the old cell behind it becomes part of the cavity, and the best of the cavities is taken.  Where the
node is on facets, these have a cavity of their own, whose rim is joined to the node.

All new cells are positive, so that the cavity is a star around the node, and these fill it once.

References
----------
B. M. Klingner, J. R. Shewchuk, "Aggressive tetrahedral mesh improvement", Proc. 16th Int. Meshing
Roundtable (2007) 3-23.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import (
    CELLS,
    FACETS,
    LINES,
    NONE,
    add_row,
    are_joined,
    first_corner,
    has_node,
    next_corner,
    nodes_of,
    remove_row,
    rows_with,
)
from adaptsize._kernels.envelope import (
    INNER,
    attach_samples,
    closest_of,
    detach_samples,
    distance_of,
    measure_row,
    nearest_in,
    normal_of,
    projected,
)
from adaptsize._kernels.local_mesh import (
    MOST_IN_CAVITY,
    MOST_NODES,
    angle_of,
    limit_of_edge,
    penalty,
    requeue,
    squared_length,
    update_angle,
)
from adaptsize._kernels.vectors import between, dot, frame, norm, unit

#: Least cosine of the angle by which a facet may turn.
_LEAST_COSINE = 0.3
#: First step of the search for a better place, in the mean length of the edges of the simplex; and
#: number of rounds.
_STEP, _ROUNDS = 0.3, 3
#: Edges may become as short as this share of the size; and at nodes that the distance of the
#: boundary needs.
_SHORTEST, _SHORTEST_WANTED = 0.7, 0.3
#: Number of simplices of a cell in which a node may be inserted: edges, faces and the cell.
N_PLACES = 11
#: Places of the numbers of cells, faces, facets and edges of the rim of a cavity, of facets and
#: lines that contain the simplex, and of nodes of the simplex, in `Cavity.counts`.
_CELLS, _FACES, _RIM_FACETS, _RIM, _FIRST, _LINE, _NODES = range(7)


@lean
def simplex_of(mesh, c, number):
    """Return the nodes of an edge, a face or all of a cell, filled up with -1; and their number."""
    a, b, d, e = nodes_of(mesh.cx, c)
    if number == 0:
        return (a, b, NONE, NONE), np.int64(2)
    if number == 1:
        return (a, d, NONE, NONE), np.int64(2)
    if number == 2:
        return (a, e, NONE, NONE), np.int64(2)
    if number == 3:
        return (b, d, NONE, NONE), np.int64(2)
    if number == 4:
        return (b, e, NONE, NONE), np.int64(2)
    if number == 5:
        return (d, e, NONE, NONE), np.int64(2)
    if number == 6:
        return (b, d, e, NONE), np.int64(3)
    if number == 7:
        return (a, d, e, NONE), np.int64(3)
    if number == 8:
        return (a, b, e, NONE), np.int64(3)
    if number == 9:
        return (a, b, d, NONE), np.int64(3)
    return (a, b, d, e), np.int64(4)


@lean
def _contains(cx, row, simplex):
    a, b, c, d = simplex
    return (
        has_node(cx, row, a)
        and has_node(cx, row, b)
        and (c < 0 or has_node(cx, row, c))
        and (d < 0 or has_node(cx, row, d))
    )


@lean
def _with(cx, row, v, new):
    """Return the nodes of a simplex with another one in a place."""
    a, b, c, d = nodes_of(cx, row)
    if v == 0:
        return new, b, c, d
    if v == 1:
        return a, new, c, d
    if v == 2:
        return a, b, new, d
    return a, b, c, new


@lean
def _is_same(cx, row, v, other, w):
    """Return whether the faces opposite to places v and w of two simplices of a level are one."""
    corner = np.int64(cx.nodes[row, v])
    for k in range(4):
        node = np.int64(cx.nodes[other, k])
        if k != w and node >= 0 and (node == corner or not has_node(cx, row, node)):
            return False
    return True


@lean
def _face_like(cx, cavity, row, v):
    """Return the place of a face in the cavity, or -1."""
    for f in range(cavity.counts[_FACES]):
        if _is_same(cx, row, v, cavity.faces[f, 0], cavity.faces[f, 1]):
            return np.int64(f)
    return NONE


@lean
def _drop_face(cavity, f):
    last = cavity.counts[_FACES] - 1
    cavity.faces[f, 0], cavity.faces[f, 1] = cavity.faces[last, 0], cavity.faces[last, 1]
    cavity.angle[f] = cavity.angle[last]
    cavity.counts[_FACES] = last


@lean
def _face_of(cx, row, v):
    """Return the nodes of the face of a cell opposite to a place."""
    a, b, c, d = nodes_of(cx, row)
    if v == 0:
        return d, b, c
    if v == 1:
        return a, d, c
    return (a, b, d) if v == 2 else (a, b, c)


@lean
def _take_cell(mesh, cavity, row, new, begins):
    """Make a cell part of the cavity; return whether there was room.

    Facets inside of it are those that contain the simplex, with which the cavity begins: others
    would be left without a cell.
    """
    cx, count = mesh.cx, cavity.counts
    if count[_CELLS] == MOST_IN_CAVITY:
        return False
    cavity.cells[count[_CELLS]] = row
    count[_CELLS] += 1
    for v in range(4):
        f = _face_like(cx, cavity, row, v)
        if f >= 0:
            a, b, c = _face_of(cx, row, v)
            if not begins and rows_with(cx, FACETS, a, b, c)[0] > 0:
                return False
            _drop_face(cavity, f)
            continue
        f = count[_FACES]
        if f == cavity.faces.shape[0]:
            return False
        cavity.faces[f, 0], cavity.faces[f, 1] = row, v
        cavity.angle[f] = angle_of(mesh, _with(cx, row, v, new))
        count[_FACES] = f + 1
    return True


@lean
def _drop_facet_face(cx, cavity, row):
    """Remove the face of the cavity that is a facet, if there is one."""
    for f in range(cavity.counts[_FACES]):
        cell, v = cavity.faces[f, 0], cavity.faces[f, 1]
        a, b, c, _ = nodes_of(cx, row)
        if (
            has_node(cx, cell, a)
            and has_node(cx, cell, b)
            and has_node(cx, cell, c)
            and not has_node(cx, row, np.int64(cx.nodes[cell, v]))
        ):
            _drop_face(cavity, f)
            return


@lean
def _take_facet(mesh, cavity, row, simplex):
    """Make a facet part of the cavity; return whether there was room, and it is not beyond a line.

    The edge of the simplex in which the node is inserted is not part of the rim.
    """
    cx, count = mesh.cx, cavity.counts
    if count[_RIM_FACETS] == cavity.facets.shape[0]:
        return False
    cavity.facets[count[_RIM_FACETS]] = row
    count[_RIM_FACETS] += 1
    for v in range(3):
        a, b = np.int64(cx.nodes[row, (v + 1) % 3]), np.int64(cx.nodes[row, (v + 2) % 3])
        if count[_NODES] == 2 and simplex[0] in (a, b) and simplex[1] in (a, b):
            continue
        found = NONE
        for r in range(count[_RIM]):
            if _is_same(cx, row, v, cavity.rim[r, 0], cavity.rim[r, 1]):
                found = np.int64(r)
        if found >= 0:
            if are_joined(cx, LINES, a, b):
                return False
            last = count[_RIM] - 1
            cavity.rim[found, 0], cavity.rim[found, 1] = cavity.rim[last, 0], cavity.rim[last, 1]
            count[_RIM] = last
        elif count[_RIM] == cavity.rim.shape[0]:
            return False
        else:
            cavity.rim[count[_RIM], 0], cavity.rim[count[_RIM], 1] = row, v
            count[_RIM] += 1
    _drop_facet_face(cx, cavity, row)
    return True


@lean
def _begin(mesh, cavity, simplex, n_nodes, new):
    """Begin the cavity with what contains a simplex; return whether there was room."""
    cx, count, a = mesh.cx, cavity.counts, simplex[0]
    count[:] = 0
    count[_NODES] = n_nodes
    corner = first_corner(cx, CELLS, a)
    while corner >= 0:
        row = corner // 4
        corner = next_corner(cx, corner)
        if _contains(cx, row, simplex) and not _take_cell(mesh, cavity, row, new, True):
            return False
    corner = first_corner(cx, FACETS, a)
    while corner >= 0 and n_nodes < 4:
        row = corner // 4
        corner = next_corner(cx, corner)
        if _contains(cx, row, simplex) and not _take_facet(mesh, cavity, row, simplex):
            return False
    count[_FIRST] = count[_RIM_FACETS]
    count[_LINE] = rows_with(cx, LINES, a, simplex[1], NONE)[0] if n_nodes == 2 else 0
    return count[_CELLS] > 0 and count[_LINE] < 2


@lean
def _touches_rim(cx, cavity, row):
    """Return whether a facet has an edge of the rim, and the same label as the facet there."""
    for r in range(cavity.counts[_RIM]):
        other = cavity.rim[r, 0]
        if cx.about[other, 0] != cx.about[row, 0]:
            continue
        for v in range(3):
            if _is_same(cx, row, v, other, cavity.rim[r, 1]):
                return True
    return False


@lean
def _grow(mesh, cavity, simplex, new):
    """Add what is behind the worst new cell; return whether that was possible."""
    cx, worst = mesh.cx, 0
    for f in range(1, cavity.counts[_FACES]):
        if cavity.angle[f] < cavity.angle[worst]:
            worst = f
    if cavity.counts[_FACES] == 0 or cavity.angle[worst] >= 1.25 * mesh.goal:
        return False
    cell, v = np.int64(cavity.faces[worst, 0]), cavity.faces[worst, 1]
    a, b, c = _face_of(cx, cell, v)
    count, one, other = rows_with(cx, CELLS, a, b, c)
    facet = rows_with(cx, FACETS, a, b, c)[1]
    if facet < 0:
        behind = other if one == cell else one
        return count == 2 and _take_cell(mesh, cavity, behind, new, False)
    return (
        count == 1 and _touches_rim(cx, cavity, facet) and _take_facet(mesh, cavity, facet, simplex)
    )


@lean
def _score(mesh, cavity, allowed):
    """Return by how much the penalty falls with the cavity as it is, -inf if it is not valid."""
    before, worst, after, least = 0.0, 180.0, 0.0, 180.0
    for k in range(cavity.counts[_CELLS]):
        angle = mesh.angle[cavity.cells[k]]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
    for f in range(cavity.counts[_FACES]):
        angle = cavity.angle[f]
        after += penalty(mesh, angle)
        least = min(least, angle)
    if least <= 0.0 or least < min(worst, allowed) or cavity.counts[_FACES] < 3:
        return -math.inf
    return before - after


@lean
def _best_cavity(mesh, cavity, simplex, n_nodes, new, allowed):
    """Return the best score with the node where it is, and after how many steps."""
    best, steps, at = -math.inf, 0, 0
    if not _begin(mesh, cavity, simplex, n_nodes, new):
        return best, at
    while True:
        score = _score(mesh, cavity, allowed)
        if score > best:
            best, at = score, steps
        if not _grow(mesh, cavity, simplex, new):
            return best, at
        steps += 1


@lean
def _set_cavity(mesh, cavity, simplex, n_nodes, new, steps):
    """Make the cavity that was the best one."""
    _begin(mesh, cavity, simplex, n_nodes, new)
    for _ in range(steps):
        _grow(mesh, cavity, simplex, new)


@lean
def _put(mesh, i, x):
    mesh.points[i, 0], mesh.points[i, 1], mesh.points[i, 2] = x


@lean
def _level_of(mesh, simplex, n_nodes):
    """Return the level on which a simplex is, its label, and one of its rows there."""
    a, b, c, _ = simplex
    if n_nodes == 2:
        count, row, _ = rows_with(mesh.cx, LINES, a, b, NONE)
        if count > 0:
            return LINES, mesh.cx.about[row, 0], row
    if n_nodes < 4:
        count, row, _ = rows_with(mesh.cx, FACETS, a, b, c)
        if count > 0:
            return FACETS, mesh.cx.about[row, 0], row
    return CELLS, np.int32(-1), NONE


@lean
def _on_level(mesh, level, label, x, reach, work):
    """Return whether there is a place on the given surface or lines near x, and that."""
    if level == CELLS:
        return True, x
    given = mesh.curves if level == LINES else mesh.surface
    return projected(given, label, x, reach * reach, work.stack)


@lean
def _directions(mesh, level, row, simplex):
    """Return in how many directions a node may be moved, and these."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    points, (a, b, _, _) = mesh.points, simplex
    if level == LINES:
        return 1, unit(between(points, a, b)), y, z
    if level == FACETS:
        i, j, k, _ = nodes_of(mesh.cx, row)
        u, v = frame(unit(normal_of(points, i, j, k)))
        return 2, u, v, z
    return 3, x, y, z


@lean
def _middle(mesh, simplex, n_nodes):
    """Return the mean of the nodes of a simplex, and the mean length of its edges."""
    x, length, points = (0.0, 0.0, 0.0), 0.0, mesh.points
    for k in range(n_nodes):
        i = simplex[k]
        x = (x[0] + points[i, 0], x[1] + points[i, 1], x[2] + points[i, 2])
        for m in range(k):
            length += math.sqrt(squared_length(points, i, simplex[m]))
    pairs = 0.5 * n_nodes * (n_nodes - 1)
    return (x[0] / n_nodes, x[1] / n_nodes, x[2] / n_nodes), length / pairs


@lean
def _searched(mesh, simplex, n_nodes, new, least, work):
    """Return the best score of a node in a simplex, its place and the number of steps there."""
    cavity = work.cavity
    start, length = _middle(mesh, simplex, n_nodes)
    level, label, row = _level_of(mesh, simplex, n_nodes)
    tolerance, step = mesh.samples.tolerance, _STEP * length
    is_near, start = _on_level(mesh, level, label, start, length + tolerance, work)
    if not is_near:
        return least, start, 0
    n_directions, u, v, w = _directions(mesh, level, row, simplex)
    _put(mesh, new, start)
    best, at = _best_cavity(mesh, cavity, simplex, n_nodes, new, 180.0)
    place = start
    for _ in range(_ROUNDS):
        improved = False
        for turn in range(2 * n_directions):
            e = u if turn < 2 else (v if turn < 4 else w)
            s = step if turn % 2 == 0 else -step
            x = (start[0] + s * e[0], start[1] + s * e[1], start[2] + s * e[2])
            is_near, x = _on_level(mesh, level, label, x, step + tolerance, work)
            if not is_near:
                continue
            _put(mesh, new, x)
            score, steps = _best_cavity(mesh, cavity, simplex, n_nodes, new, 180.0)
            if score > best:
                best, at, place, improved = score, steps, x, True
        start = place
        if not improved:
            step *= 0.5
    return best, place, at


@lean
def _lengths_fit(mesh, cavity, new, shortest):
    """Return whether no edge at the node is too long, or shorter than a share of the size."""
    cx, points = mesh.cx, mesh.points
    longest2, shortest2 = 0.0, math.inf
    for k in range(cavity.counts[_CELLS]):
        nodes = nodes_of(cx, cavity.cells[k])
        for v in range(4):
            for w in range(v):
                length2 = squared_length(points, nodes[v], nodes[w])
                longest2, shortest2 = max(longest2, length2), min(shortest2, length2)
    for f in range(cavity.counts[_FACES]):
        nodes = nodes_of(cx, cavity.faces[f, 0])
        for v in range(4):
            if v == cavity.faces[f, 1]:
                continue
            length2, limit2 = (
                squared_length(points, new, nodes[v]),
                limit_of_edge(mesh, new, nodes[v]),
            )
            if length2 > max(limit2, longest2):
                return False
            if length2 < min(0.5 * shortest * shortest * limit2, shortest2):
                return False
    return True


@lean
def _ends_at(cx, cavity, node):
    """Return how many edges of the rim end at a node."""
    ends = 0
    for r in range(cavity.counts[_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        if node in (cx.nodes[row, (v + 1) % 3], cx.nodes[row, (v + 2) % 3]):
            ends += 1
    return ends


@lean
def _is_on_face(cx, cavity, r):
    """Return whether an edge of the rim is on a face of the cavity, so that new cells have it."""
    row, v = cavity.rim[r, 0], cavity.rim[r, 1]
    a, b = np.int64(cx.nodes[row, (v + 1) % 3]), np.int64(cx.nodes[row, (v + 2) % 3])
    for f in range(cavity.counts[_FACES]):
        cell, w = cavity.faces[f, 0], cavity.faces[f, 1]
        opposite = np.int64(cx.nodes[cell, w])
        if opposite not in (a, b) and has_node(cx, cell, a) and has_node(cx, cell, b):
            return True
    return False


@lean
def _rim_is_simple(cx, cavity, simplex):
    """Return whether the rim passes each of its nodes once, and the ends of a divided edge.

    Each of its edges must be on a face: cells all around the border line of a facet inside of a
    region would leave the new facet there without a cell.
    """
    is_edge = cavity.counts[_NODES] == 2
    for r in range(cavity.counts[_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        for w in range(3):
            node = np.int64(cx.nodes[row, w])
            if w == v or (is_edge and node in (simplex[0], simplex[1])):
                continue
            if _ends_at(cx, cavity, node) != 2:
                return False
        if not _is_on_face(cx, cavity, r):
            return False
    for k in range(2 if is_edge and cavity.counts[_FIRST] > 0 else 0):
        if _ends_at(cx, cavity, simplex[k]) != cavity.counts[_FIRST]:
            return False
    return True


@lean
def _is_listed(rows, n, row):
    found = False
    for k in range(n):
        found = found or rows[k] == row
    return found


@lean
def _is_sample_kept(mesh, cavity, s, new):
    """Return whether a sample of a facet of the cavity is near what comes instead."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
    label, reach2 = int(samples.at[s, 3]), samples.at[s, 4]
    for turn in range(2):
        for r in range(cavity.counts[_RIM]):
            row, v = cavity.rim[r, 0], cavity.rim[r, 1]
            if turn == 0:
                if label >= 0 and cx.about[row, 0] != label:
                    continue
                a, b, c, _ = _with(cx, row, v, new)
                if closest_of(points, (a, b, c), x)[0] <= reach2:
                    return True
                continue
            corner = first_corner(cx, FACETS, np.int64(cx.nodes[row, (v + 1) % 3]))
            while corner >= 0:
                other = corner // 4
                corner = next_corner(cx, corner)
                if (label >= 0 and cx.about[other, 0] != label) or _is_listed(
                    cavity.facets, cavity.counts[_RIM_FACETS], other
                ):
                    continue
                a, b, c, _ = nodes_of(cx, other)
                if closest_of(points, (a, b, c), x)[0] <= reach2:
                    return True
    return False


@lean
def _facets_fit(mesh, cavity, new, work):
    """Return whether the new facets are near the given ones, in both directions, and not turned."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    tolerance2 = samples.tolerance * samples.tolerance
    limit2 = tolerance2
    for k in range(cavity.counts[_RIM_FACETS]):
        limit2 = max(limit2, samples.off2[cavity.facets[k]])
    label = cx.about[cavity.facets[0], 0]
    x = (points[new, 0], points[new, 1], points[new, 2])
    if nearest_in(mesh.surface, label, x, limit2, work.stack)[0] < 0:
        return False
    for r in range(cavity.counts[_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        i, j, k, _ = nodes_of(cx, row)
        a, b, c, _ = _with(cx, row, v, new)
        was, now = normal_of(points, i, j, k), normal_of(points, a, b, c)
        longest2 = max(
            squared_length(points, i, j), squared_length(points, j, k), squared_length(points, k, i)
        )
        if dot(was, was) > tolerance2 * longest2 and dot(was, now) < _LEAST_COSINE * norm(
            was
        ) * norm(now):
            return False
        label = cx.about[row, 0]
        if distance_of(mesh.surface, points, (a, b, c), label, INNER, limit2, work.stack) > 1e300:
            return False
    for k in range(cavity.counts[_RIM_FACETS]):
        s = np.int64(samples.chain[cavity.facets[k], 0])
        while s >= 0:
            if not _is_sample_kept(mesh, cavity, s, new):
                return False
            s = np.int64(samples.chain[s, 1])
    return True


@lean
def _line_fits(mesh, simplex, new, work):
    """Return whether a line may be divided by the node."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    a, b, _, _ = simplex
    row = rows_with(cx, LINES, a, b, NONE)[1]
    label = cx.about[row, 0]
    limit2 = max(samples.tolerance * samples.tolerance, samples.off2[row])
    for end in (a, b):
        nodes = (end, new, NONE)
        if distance_of(mesh.curves, points, nodes, label, INNER, limit2, work.stack) > 1e300:
            return False
    s = np.int64(samples.chain[row, 0])
    while s >= 0:
        x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
        one = closest_of(points, (a, new, NONE), x)[0]
        other = closest_of(points, (new, b, NONE), x)[0]
        if min(one, other) > samples.at[s, 4]:
            return False
        s = np.int64(samples.chain[s, 1])
    return True


@lean
def _fits(mesh, simplex, new, shortest, work):
    """Return whether all that is required of the insertion holds for the cavity as it is."""
    cavity, cx = work.cavity, mesh.cx
    count = cavity.counts
    more = count[_FACES] + count[_RIM] - count[_CELLS] - count[_RIM_FACETS] + count[_LINE]
    if cx.n_free[0] < max(more, 1) or not _lengths_fit(mesh, cavity, new, shortest):
        return False
    if count[_RIM_FACETS] > 0 and not (
        _rim_is_simple(cx, cavity, simplex) and _facets_fit(mesh, cavity, new, work)
    ):
        return False
    return count[_LINE] == 0 or _line_fits(mesh, simplex, new, work)


@lean
def new_node(mesh, simplex, n_nodes):
    """Return the number that the next node gets, with its size; -1 if there is no room."""
    new = mesh.n_points[0]
    if new >= mesh.points.shape[0]:
        return NONE
    size = 0.0
    for k in range(n_nodes):
        size += mesh.size[simplex[k]]
    mesh.size[new] = size / n_nodes
    return np.int64(new)


@lean
def drop_of_insertion(mesh, c, number, least, work):
    """Return by how much the penalty falls if a node is inserted in a simplex of a cell, or 0.

    Its place, and the number of steps of its cavity, are in the work.
    """
    simplex, n_nodes = simplex_of(mesh, c, number)
    new = new_node(mesh, simplex, n_nodes)
    if new < 0:
        return 0.0
    best, x, steps = _searched(mesh, simplex, n_nodes, new, least, work)
    if best <= least:
        return 0.0
    _put(mesh, new, x)
    _set_cavity(mesh, work.cavity, simplex, n_nodes, new, steps)
    if not _fits(mesh, simplex, new, _SHORTEST, work):
        return 0.0
    work.place[0], work.place[1], work.place[2] = x
    work.choice[0] = steps
    return best


@lean
def insert(mesh, c, number, x, steps, work):
    """Insert a node at x, as `drop_of_insertion` has found."""
    simplex, n_nodes = simplex_of(mesh, c, number)
    _insert_in(mesh, simplex, n_nodes, x, steps, work)


@lean
def _insert_in(mesh, simplex, n_nodes, x, steps, work):
    new = new_node(mesh, simplex, n_nodes)
    _put(mesh, new, x)
    mesh.n_points[0] += 1
    _set_cavity(mesh, work.cavity, simplex, n_nodes, new, steps)
    _fill(mesh, simplex, new, work)


@lean
def _simplex_of_facet(mesh, row, number):
    """Return the nodes of a facet, or of one of its edges, filled up with -1; and their number."""
    a, b, c, _ = nodes_of(mesh.cx, row)
    if number == 0:
        return (a, b, c, NONE), np.int64(3)
    if number == 1:
        return (a, b, NONE, NONE), np.int64(2)
    return ((b, c, NONE, NONE) if number == 2 else (c, a, NONE, NONE)), np.int64(2)


@lean
def _on_line(mesh, simplex, n_nodes, x, work):
    """Return whether a node at x may be inserted, and where: on the given line if one is divided.

    That must be within the tolerance.
    """
    level, label, _ = _level_of(mesh, simplex, n_nodes)
    if level != LINES:
        return True, x
    return _on_level(mesh, level, label, x, mesh.samples.tolerance, work)


@lean_kernel
def insert_in_facets(mesh, places, corners, least, work):
    """Insert nodes at given places in facets or their edges, where the angles allow it.

    Parameters
    ----------
    mesh : LocalMesh
        In/Out: tetrahedra.
    places : float64[n, 3]
    corners : int64[n, 3]
        Nodes of the facets.  Places in facets that are no longer there are left out.
    least : float
        Least angle of new cells, unless old ones have smaller ones.
    work : Work

    Returns
    -------
    int
        Number of new nodes.
    """
    n_made = 0
    for p in range(places.shape[0]):
        a, b, c = corners[p, 0], corners[p, 1], corners[p, 2]
        row = rows_with(mesh.cx, FACETS, a, b, c)[1]
        wanted = (places[p, 0], places[p, 1], places[p, 2])
        best, chosen, steps, place = -math.inf, -1, 0, wanted
        for number in range(4 if row >= 0 else 0):
            simplex, n_nodes = _simplex_of_facet(mesh, row, number)
            new = new_node(mesh, simplex, n_nodes)
            if new < 0:
                return n_made
            is_near, x = _on_line(mesh, simplex, n_nodes, wanted, work)
            if not is_near:
                continue
            _put(mesh, new, x)
            score, at = _best_cavity(mesh, work.cavity, simplex, n_nodes, new, least)
            if score <= best:
                continue
            _set_cavity(mesh, work.cavity, simplex, n_nodes, new, at)
            if _fits(mesh, simplex, new, _SHORTEST_WANTED, work):
                best, chosen, steps, place = score, number, at, x
        if chosen >= 0:
            simplex, n_nodes = _simplex_of_facet(mesh, row, chosen)
            _insert_in(mesh, simplex, n_nodes, place, steps, work)
            n_made += 1
    return n_made


@lean
def _fill(mesh, simplex, new, work):
    """Replace what is in the cavity by what is joined to the node."""
    cavity, cx = work.cavity, mesh.cx
    count, made = cavity.counts, cavity.made
    n_cells, n_facets = count[_FACES], count[_RIM]
    for f in range(n_cells + n_facets):
        row = cavity.faces[f, 0] if f < n_cells else cavity.rim[f - n_cells, 0]
        v = cavity.faces[f, 1] if f < n_cells else cavity.rim[f - n_cells, 1]
        made[f, 0], made[f, 1], made[f, 2], made[f, 3] = _with(cx, row, v, new)
        if f >= n_cells:
            made[f, 3] = NONE
        made[f, 4] = cx.about[row, 0]
    if count[_LINE] > 0:
        _divide_line(mesh, simplex, new, work)
    for k in range(count[_CELLS]):
        remove_row(cx, cavity.cells[k])
    chain = NONE
    for k in range(count[_RIM_FACETS]):
        chain = detach_samples(mesh.samples, cavity.facets[k], chain)
        remove_row(cx, cavity.facets[k])
    n_around = np.int64(0)
    for f in range(n_cells + n_facets):
        nodes = made[f, 0], made[f, 1], made[f, 2], made[f, 3]
        row = add_row(cx, CELLS if f < n_cells else FACETS, nodes, made[f, 4])
        if f < n_cells:
            update_angle(mesh, row)
            continue
        mesh.samples.chain[row, 0] = -1
        measure_row(mesh.surface, mesh.samples, cx, mesh.points, row, work.stack)
        for v in range(3):
            if n_around < MOST_NODES and nodes[v] != new:
                work.around[n_around] = nodes[v]
                n_around += 1
    attach_samples(mesh.samples, cx, FACETS, mesh.points, work.around, n_around, chain)
    for f in range(n_cells):
        for v in range(4):
            requeue(mesh, np.int64(made[f, v]), work)


@lean
def _divide_line(mesh, simplex, new, work):
    """Replace a line by two."""
    cx, samples = mesh.cx, mesh.samples
    a, b, _, _ = simplex
    row = rows_with(cx, LINES, a, b, NONE)[1]
    label = cx.about[row, 0]
    chain = detach_samples(samples, row, NONE)
    remove_row(cx, row)
    for end in (a, b):
        row = add_row(cx, LINES, (end, new, NONE, NONE), label)
        samples.chain[row, 0] = -1
        measure_row(mesh.curves, samples, cx, mesh.points, row, work.stack)
    work.around[0] = new
    attach_samples(samples, cx, LINES, mesh.points, work.around, np.int64(1), chain)
