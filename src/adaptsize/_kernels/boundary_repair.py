"""Repair of the worst cells of a mesh by local operations, also on its boundary.

The worst cell is first.  Of the operations on its nodes, edges and faces, the one is applied that
reduces the sum of the penalties most (see `local_mesh`).  The sum of the penalties falls with every
operation by a least amount, so that there is an end.
"""

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import CELLS, NONE, nodes_of
from adaptsize._kernels.heap import pop
from adaptsize._kernels.insertion import N_PLACES, drop_of_insertion, insert
from adaptsize._kernels.local_mesh import TETRAHEDRA, put_in_queue
from adaptsize._kernels.ring_changes import (
    drop_of_cell,
    drop_of_edge,
    drop_of_face,
    drop_of_flip,
    flip_edge,
    remove_cell,
    remove_edge,
    remove_face,
)
from adaptsize._kernels.star_changes import (
    change_star,
    drop_of_collapse,
    drop_of_lift,
    drop_of_move,
    is_across_wall,
)

#: Least reduction of the penalty by an operation.
_GAIN = 1e-4
#: Kinds of operations.  Each has two numbers: the nodes of an edge, of which the first one vanishes
#: in a collapse; or a cell, and for a face its opposite corner; or a node.
#: An insertion has a cell and the number of one of its edges and faces, see `insertion`; a lift has
#: a node of the boundary.
COLLAPSE, EDGE, FACE, CELL, FLIP, MOVE, INSERTION, LIFT = range(1, 9)


@lean
def _operation(mesh, c, number):
    """Return an operation on a cell and its two numbers; kind 0 at the end.

    Tetrahedra have 12 collapses, 6 edges, 4 faces, the cell itself and 4 moves; triangles 6
    collapses, 3 edges and 3 moves.
    """
    k = 4 if mesh.kind == TETRAHEDRA else 3
    nodes, n_pairs = mesh.cx.nodes, k * (k - 1)
    if number < n_pairs + n_pairs // 2:
        order = number if number < n_pairs else 2 * (number - n_pairs)
        count = 0
        for v in range(k):
            for w in range(v):
                a, b = np.int64(nodes[c, v]), np.int64(nodes[c, w])
                if number >= n_pairs and count == order:
                    return (EDGE if k == 4 else FLIP), a, b
                if count == order:
                    return COLLAPSE, a, b
                if count + 1 == order:
                    return COLLAPSE, b, a
                count += 2
    number -= n_pairs + n_pairs // 2
    if k == 4 and number < 4:
        return FACE, c, np.int64(number)
    if k == 4 and number == 4:
        return CELL, c, np.int64(0)
    number -= 5 if k == 4 else 0
    return (MOVE, np.int64(nodes[c, number]), np.int64(-1)) if number < k else (0, c, np.int64(0))


@lean
def _drop_of(mesh, kind, a, b, best, work):
    """Return by how much an operation reduces the sum of the penalties, or 0 if not by more."""
    if kind == COLLAPSE:
        return drop_of_collapse(mesh, a, b, best, work)
    if kind == EDGE:
        return drop_of_edge(mesh, a, b, best, work)
    if kind == FACE:
        return drop_of_face(mesh, a, b, best, work)
    if kind == CELL:
        return drop_of_cell(mesh, a, best, work)
    if kind == FLIP:
        return drop_of_flip(mesh, a, b, best, work)
    return drop_of_move(mesh, a, best, work)


@lean
def _apply(mesh, kind, a, b, x, work):
    """Apply an operation."""
    if kind in (COLLAPSE, MOVE):
        change_star(mesh, a, b, x, work)
    elif kind == EDGE:
        remove_edge(mesh, a, b, work)
    elif kind == FACE:
        remove_face(mesh, a, b, work)
    elif kind == CELL:
        remove_cell(mesh, a, work)
    else:
        flip_edge(mesh, a, b, work)


@lean_kernel
def lift_best(mesh, c, work):
    """Lift the node of a cell off the given surface that reduces the penalty most.

    Only cells in walls thinner than the tolerance are looked at: no other operation makes these
    thicker.  Returns whether there is such a node.
    """
    best, chosen, x = _GAIN, NONE, (0.0, 0.0, 0.0)
    if not is_across_wall(mesh, c):
        return False
    for i in nodes_of(mesh.cx, c):
        drop = drop_of_lift(mesh, i, best, work)
        if drop > best:
            best, chosen = drop, i
            x = (work.place[0], work.place[1], work.place[2])
    if chosen >= 0:
        change_star(mesh, chosen, NONE, x, work)
    return chosen >= 0


@lean_kernel
def insert_best(mesh, c, work):
    """Insert the node in a cell that reduces the penalty most; return whether there is one."""
    best, chosen, steps, x = _GAIN, -1, np.int64(0), (0.0, 0.0, 0.0)
    for number in range(N_PLACES):
        drop = drop_of_insertion(mesh, c, number, best, work)
        if drop > best:
            best, chosen, steps = drop, number, work.choice[0]
            x = (work.place[0], work.place[1], work.place[2])
    if chosen >= 0:
        insert(mesh, c, chosen, x, steps, work)
    return chosen >= 0


@lean_kernel
def repair_waiting(mesh, n_cells, work, limits, counts):
    """Improve cells until no operation does; those for which there is no room are left out.

    This ends where nothing but a lift or a new node may help, so that these are only compiled for
    it.

    Parameters
    ----------
    mesh : LocalMesh
        In/Out.
    n_cells : int
        Cells to put in the queue, in the first rows; none to go on after a lift or an insertion.
    work : Work
    limits : tuple of int and float
        Number of attempts over that of the cells to improve, beside a thousand; and the angle of
        cells below which nodes are lifted or inserted.
    counts : int64[9]
        Out: number of operations of each kind; of attempts that are left, at 0.

    Returns
    -------
    int
        The cell of which a node may be lifted or in which one may be inserted, or -1 at the end.
    """
    for row in range(n_cells):
        put_in_queue(mesh, row, work)
    if n_cells > 0:
        counts[0] = 1000 + limits[0] * work.waiting.size[0]
    while work.waiting.size[0] > 0 and counts[0] > 0:
        c = pop(work.waiting)
        if mesh.cx.about[c, 1] != CELLS or mesh.angle[c] >= mesh.goal:
            continue
        counts[0] -= 1
        best, chosen, x = _GAIN, -1, (0.0, 0.0, 0.0)
        number, kind = 0, 1
        while kind > 0:
            kind, a, b = _operation(mesh, c, number)
            drop = _drop_of(mesh, kind, a, b, best, work) if kind > 0 else 0.0
            if drop > best:
                best, chosen = drop, number
                if kind == MOVE:
                    x = (work.place[0], work.place[1], work.place[2])
            number += 1
        if chosen >= 0:
            kind, a, b = _operation(mesh, c, chosen)
            counts[kind] += 1
            _apply(mesh, kind, a, b, x, work)
        elif mesh.kind == TETRAHEDRA and mesh.angle[c] < limits[1]:
            return c
    return np.int64(-1)
