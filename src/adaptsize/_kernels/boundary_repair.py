"""Repair of the worst cells of a mesh by local operations, also on its boundary.

The worst cell is first.  Of the operations on its nodes, edges and faces, the one is applied that
reduces the sum of the penalties most (see `local_mesh`).  The sum of the penalties falls with every
operation by a least amount, so that there is an end.
"""

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.heap import pop
from adaptsize._kernels.local_mesh import TETRAHEDRA
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
from adaptsize._kernels.star_changes import change_star, drop_of_collapse, drop_of_move

#: Least reduction of the penalty by an operation.
_GAIN = 1e-4
_COLLAPSE, _EDGE, _FACE, _CELL, _FLIP, _MOVE = range(1, 7)


@lean
def _choose(work, kind, i, j):
    work.choice[0], work.choice[1], work.choice[2] = kind, i, j


@lean
def _best_of_edges(mesh, c, best, work):
    """Return the best reduction by operations on the edges of a cell; the choice is in the work."""
    nodes, k = mesh.cells.nodes, mesh.cells.nodes.shape[1]
    for v in range(k):
        for w in range(v):
            a, b = np.int64(nodes[c, v]), np.int64(nodes[c, w])
            drop = drop_of_collapse(mesh, a, b, best, work)
            if drop > best:
                best = drop
                _choose(work, _COLLAPSE, a, b)
            drop = drop_of_collapse(mesh, b, a, best, work)
            if drop > best:
                best = drop
                _choose(work, _COLLAPSE, b, a)
            if mesh.kind == TETRAHEDRA:
                drop = drop_of_edge(mesh, a, b, best, work)
                if drop > best:
                    best = drop
                    _choose(work, _EDGE, a, b)
            else:
                drop = drop_of_flip(mesh, a, b, best, work)
                if drop > best:
                    best = drop
                    _choose(work, _FLIP, a, b)
    return best


@lean
def _best_operation(mesh, c, work):
    """Return the best reduction by an operation on a cell, which is in the work; 0 if none."""
    work.choice[0] = 0
    best = _best_of_edges(mesh, c, _GAIN, work)
    if mesh.kind == TETRAHEDRA:
        for v in range(4):
            drop = drop_of_face(mesh, c, v, best, work)
            if drop > best:
                best = drop
                _choose(work, _FACE, c, v)
        drop = drop_of_cell(mesh, c, best, work)
        if drop > best:
            best = drop
            _choose(work, _CELL, c, 0)
    x, y, z = 0.0, 0.0, 0.0
    for v in range(mesh.cells.nodes.shape[1]):
        i = np.int64(mesh.cells.nodes[c, v])
        drop = drop_of_move(mesh, i, best, work)
        if drop > best:
            best = drop
            x, y, z = work.place[0], work.place[1], work.place[2]
            _choose(work, _MOVE, i, -1)
    work.place[0], work.place[1], work.place[2] = x, y, z
    return work.choice[0]


@lean
def _apply(mesh, work):
    """Apply the chosen operation."""
    kind, a, b = work.choice[0], work.choice[1], work.choice[2]
    x = (work.place[0], work.place[1], work.place[2])
    if kind == _COLLAPSE or kind == _MOVE:
        change_star(mesh, a, b, x, work)
    elif kind == _EDGE:
        remove_edge(mesh, a, b, work)
    elif kind == _FACE:
        remove_face(mesh, a, b, work)
    elif kind == _CELL:
        remove_cell(mesh, a, work)
    else:
        flip_edge(mesh, a, b, work)


@lean_kernel
def repair(mesh, work, most, counts):
    """Improve the cells in the queue until no operation does.

    Parameters
    ----------
    mesh : LocalMesh
        In/Out.
    work : Work
    most : int
        Number of attempts.
    counts : int64[7]
        Out: number of operations of each kind; of attempts, at 0.
    """
    while work.waiting.size[0] > 0 and counts[0] < most:
        c = pop(work.waiting)
        if not mesh.cells.alive[c] or mesh.angle[c] >= mesh.goal:
            continue
        counts[0] += 1
        kind = _best_operation(mesh, c, work)
        if kind > 0:
            counts[kind] += 1
            _apply(mesh, work)
