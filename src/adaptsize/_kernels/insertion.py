"""Insertion of a node into tetrahedra, also on facets and lines.

Its place is searched for around the middle of a cell, a face or an edge.  At each place, the best
cavity is found (cavity.py), and it must fit the given surface (cavity_fit.py).
"""

import math

import numpy as np

from adaptsize._kernels.cavity import best_cavity, fill_cavity, set_cavity
from adaptsize._kernels.cavity_fit import fits
from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import CELLS, FACETS, LINES, NONE, nodes_of, rows_with
from adaptsize._kernels.envelope import normal_of, projected
from adaptsize._kernels.local_mesh import squared_length
from adaptsize._kernels.vectors import between, frame, unit

#: First step of the search for a better place, in the mean length of the edges of the simplex; and
#: number of rounds.
_STEP, _ROUNDS = 0.3, 3
#: Edges may become as short as this share of the size; and at nodes that the distance of the
#: boundary needs.
_SHORTEST, _SHORTEST_WANTED = 0.7, 0.3
#: Number of simplices of a cell in which a node may be inserted: edges, faces and the cell.
N_PLACES = 11


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
    best, at = best_cavity(mesh, cavity, simplex, n_nodes, new, 180.0)
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
            score, steps = best_cavity(mesh, cavity, simplex, n_nodes, new, 180.0)
            if score > best:
                best, at, place, improved = score, steps, x, True
        start = place
        if not improved:
            step *= 0.5
    return best, place, at


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
    set_cavity(mesh, work.cavity, simplex, n_nodes, new, steps)
    if not fits(mesh, simplex, new, _SHORTEST, work):
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
    set_cavity(mesh, work.cavity, simplex, n_nodes, new, steps)
    fill_cavity(mesh, simplex, new, work)


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
            score, at = best_cavity(mesh, work.cavity, simplex, n_nodes, new, least)
            if score <= best:
                continue
            set_cavity(mesh, work.cavity, simplex, n_nodes, new, at)
            if fits(mesh, simplex, new, _SHORTEST_WANTED, work):
                best, chosen, steps, place = score, number, at, x
        if chosen >= 0:
            simplex, n_nodes = _simplex_of_facet(mesh, row, chosen)
            _insert_in(mesh, simplex, n_nodes, place, steps, work)
            n_made += 1
    return n_made
