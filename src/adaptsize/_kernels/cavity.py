"""The cavity that a new node of tetrahedra replaces, also on facets and lines.

The node is in a cell, on a face or on an edge.  The cavity begins with the cells that contain this
simplex.  Its faces are joined to the node.  As long as the worst of these new cells is bad, the old
cell behind it becomes part of the cavity, and the best of the cavities is taken.  Where the node is
on facets, these have a cavity of their own, whose rim is joined to the node.

All new cells are positive, so that the cavity is a star around the node, and these fill it once.

References
----------
B. M. Klingner, J. R. Shewchuk, "Aggressive tetrahedral mesh improvement", Proc. 16th Int. Meshing
Roundtable (2007) 3-23.
"""

import math

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
    next_corner,
    nodes_of,
    remove_row,
    rows_with,
)
from adaptsize._kernels.envelope import attach_samples, detach_samples, measure_row
from adaptsize._kernels.local_mesh import (
    MOST_IN_CAVITY,
    MOST_NODES,
    N_BEGUN,
    N_CELLS,
    N_FACES,
    N_FACETS,
    N_LINES,
    N_NODES,
    N_RIM,
    angle_of,
    penalty,
    requeue,
    update_angle,
)


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
def with_corner(cx, row, v, new):
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
    for f in range(cavity.counts[N_FACES]):
        if _is_same(cx, row, v, cavity.faces[f, 0], cavity.faces[f, 1]):
            return np.int64(f)
    return NONE


@lean
def _drop_face(cavity, f):
    last = cavity.counts[N_FACES] - 1
    cavity.faces[f, 0], cavity.faces[f, 1] = cavity.faces[last, 0], cavity.faces[last, 1]
    cavity.angle[f] = cavity.angle[last]
    cavity.counts[N_FACES] = last


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
    if count[N_CELLS] == MOST_IN_CAVITY:
        return False
    cavity.cells[count[N_CELLS]] = row
    count[N_CELLS] += 1
    for v in range(4):
        f = _face_like(cx, cavity, row, v)
        if f >= 0:
            a, b, c = _face_of(cx, row, v)
            if not begins and rows_with(cx, FACETS, a, b, c)[0] > 0:
                return False
            _drop_face(cavity, f)
            continue
        f = count[N_FACES]
        if f == cavity.faces.shape[0]:
            return False
        cavity.faces[f, 0], cavity.faces[f, 1] = row, v
        cavity.angle[f] = angle_of(mesh, with_corner(cx, row, v, new))
        count[N_FACES] = f + 1
    return True


@lean
def _drop_facet_face(cx, cavity, row):
    """Remove the face of the cavity that is a facet, if there is one."""
    for f in range(cavity.counts[N_FACES]):
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
    if count[N_FACETS] == cavity.facets.shape[0]:
        return False
    cavity.facets[count[N_FACETS]] = row
    count[N_FACETS] += 1
    for v in range(3):
        a, b = np.int64(cx.nodes[row, (v + 1) % 3]), np.int64(cx.nodes[row, (v + 2) % 3])
        if count[N_NODES] == 2 and simplex[0] in (a, b) and simplex[1] in (a, b):
            continue
        found = NONE
        for r in range(count[N_RIM]):
            if _is_same(cx, row, v, cavity.rim[r, 0], cavity.rim[r, 1]):
                found = np.int64(r)
        if found >= 0:
            if are_joined(cx, LINES, a, b):
                return False
            last = count[N_RIM] - 1
            cavity.rim[found, 0], cavity.rim[found, 1] = cavity.rim[last, 0], cavity.rim[last, 1]
            count[N_RIM] = last
        elif count[N_RIM] == cavity.rim.shape[0]:
            return False
        else:
            cavity.rim[count[N_RIM], 0], cavity.rim[count[N_RIM], 1] = row, v
            count[N_RIM] += 1
    _drop_facet_face(cx, cavity, row)
    return True


@lean
def _begin(mesh, cavity, simplex, n_nodes, new):
    """Begin the cavity with what contains a simplex; return whether there was room."""
    cx, count, a = mesh.cx, cavity.counts, simplex[0]
    count[:] = 0
    count[N_NODES] = n_nodes
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
    count[N_BEGUN] = count[N_FACETS]
    count[N_LINES] = rows_with(cx, LINES, a, simplex[1], NONE)[0] if n_nodes == 2 else 0
    return count[N_CELLS] > 0 and count[N_LINES] < 2


@lean
def _touches_rim(cx, cavity, row):
    """Return whether a facet has an edge of the rim, and the same label as the facet there."""
    for r in range(cavity.counts[N_RIM]):
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
    for f in range(1, cavity.counts[N_FACES]):
        if cavity.angle[f] < cavity.angle[worst]:
            worst = f
    if cavity.counts[N_FACES] == 0 or cavity.angle[worst] >= 1.25 * mesh.goal:
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
    for k in range(cavity.counts[N_CELLS]):
        angle = mesh.angle[cavity.cells[k]]
        before += penalty(mesh, angle)
        worst = min(worst, angle)
    for f in range(cavity.counts[N_FACES]):
        angle = cavity.angle[f]
        after += penalty(mesh, angle)
        least = min(least, angle)
    if least <= 0.0 or least < min(worst, allowed) or cavity.counts[N_FACES] < 3:
        return -math.inf
    return before - after


@lean
def best_cavity(mesh, cavity, simplex, n_nodes, new, allowed):
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
def set_cavity(mesh, cavity, simplex, n_nodes, new, steps):
    """Make the cavity that was the best one."""
    _begin(mesh, cavity, simplex, n_nodes, new)
    for _ in range(steps):
        _grow(mesh, cavity, simplex, new)


@lean
def fill_cavity(mesh, simplex, new, work):
    """Replace what is in the cavity by what is joined to the node."""
    cavity, cx = work.cavity, mesh.cx
    count, made = cavity.counts, cavity.made
    n_cells, n_facets = count[N_FACES], count[N_RIM]
    for f in range(n_cells + n_facets):
        row = cavity.faces[f, 0] if f < n_cells else cavity.rim[f - n_cells, 0]
        v = cavity.faces[f, 1] if f < n_cells else cavity.rim[f - n_cells, 1]
        made[f, 0], made[f, 1], made[f, 2], made[f, 3] = with_corner(cx, row, v, new)
        if f >= n_cells:
            made[f, 3] = NONE
        made[f, 4] = cx.about[row, 0]
    if count[N_LINES] > 0:
        _divide_line(mesh, simplex, new, work)
    for k in range(count[N_CELLS]):
        remove_row(cx, cavity.cells[k])
    chain = NONE
    for k in range(count[N_FACETS]):
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
