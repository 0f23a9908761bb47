"""Local mesh improvement: swapping of tetrahedra.

Two operations on the cells of a closed ball of tetrahedra keep its surface.  An interior edge is
removed: the ring of nodes around it is filled with triangles, each joined to both ends of the
edge, in the optimal triangulation (dynamic programming).  Or a face is replaced by the edge across
it.

References
----------
L. A. Freitag, C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping and smoothing",
Int. J. Numer. Methods Eng. 40 (1997) 3979-4002.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.smoothing import GAIN, tetrahedron

#: Largest number of cells around an edge to remove; all triangulations of the ring are examined.
MOST_AROUND = 9

_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


class Tetrahedra(NamedTuple):
    """Cells to improve.

    Parameters
    ----------
    points : npt.NDArray[np.float64]
    cells : npt.NDArray[np.int32]
        [m, 4], positive.
    ring_ptr : npt.NDArray[np.int32]
    ring : npt.NDArray[np.int32]
    quality : npt.NDArray[np.float64]
    removed : npt.NDArray[np.bool_]
        [m], In/Out: all False; True for the cells that are replaced.
    """

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int32]
    ring_ptr: npt.NDArray[np.int32]
    ring: npt.NDArray[np.int32]
    quality: npt.NDArray[np.float64]
    removed: npt.NDArray[np.bool_]


class Work(NamedTuple):
    """Scratch: the cells that an operation removes, and those that it makes.

    Parameters
    ----------
    old : npt.NDArray[np.int64]
    new : npt.NDArray[np.int64]
    best_old : npt.NDArray[np.int64]
        Those of the best operation; ``best_new`` likewise.
    best_new : npt.NDArray[np.int64]
    left : npt.NDArray[np.int64]
        Of each cell around an edge, one node off the edge; the other one is ``right``.
    right : npt.NDArray[np.int64]
    loop : npt.NDArray[np.int64]
        The nodes around the edge in order.
    stack : npt.NDArray[np.int64]
    split : npt.NDArray[np.int64]
        [i, j]: the node of the triangle at (i, j) if nodes i to j of the loop are filled at
        best.
    value : npt.NDArray[np.float64]
        [i, j]: the worst cell of that filling.
    """

    old: npt.NDArray[np.int64]
    new: npt.NDArray[np.int64]
    best_old: npt.NDArray[np.int64]
    best_new: npt.NDArray[np.int64]
    left: npt.NDArray[np.int64]
    right: npt.NDArray[np.int64]
    loop: npt.NDArray[np.int64]
    stack: npt.NDArray[np.int64]
    split: npt.NDArray[np.int64]
    value: npt.NDArray[np.float64]


def new_work() -> Work:
    """Return scratch for `swap`."""
    n = MOST_AROUND

    def integers(*shape: int) -> npt.NDArray[np.int64]:
        return np.empty(shape, np.int64)

    return Work(
        old=integers(n), new=integers(2 * n, 4),
        best_old=integers(n), best_new=integers(2 * n, 4),
        left=integers(n), right=integers(n), loop=integers(n), stack=integers(2 * n, 2),
        split=integers(n, n), value=np.empty((n, n)),
    )  # fmt: skip


@lean
def _list_around(mesh, a, b, work):
    """List the cells around an edge; return how many, 0 if too many or removed ones are there."""
    n = 0
    for place in range(mesh.ring_ptr[a], mesh.ring_ptr[a + 1]):
        t = mesh.ring[place]
        has, u, w = False, -1, -1
        for v in range(4):
            node = mesh.cells[t, v]
            if node == b:
                has = True
            elif node != a:
                u, w = w, node
        if not has:
            continue
        if mesh.removed[t] or n == MOST_AROUND:
            return 0
        if tetrahedron(mesh.points, a, b, u, w) < 0.0:
            u, w = w, u
        work.old[n], work.left[n], work.right[n] = t, u, w
        n += 1
    return n


@lean
def _close_loop(n, work):
    """Order the nodes around an edge; return whether they enclose it: it is not on the boundary."""
    loop = work.loop
    loop[0] = work.left[0]
    here = work.right[0]
    length = 1
    while here != loop[0] and length < n:
        loop[length] = here
        length += 1
        there = here
        for s in range(n):
            if work.left[s] == there:
                here = work.right[s]
                break
        if here == there:
            break
    return length == n and here == loop[0]


@lean
def _fill_best(points, a, b, n, work):
    """Fill the loop with triangles so that the worst cell is best; return its quality."""
    loop, value = work.loop, work.value
    for i in range(n - 1):
        value[i, i + 1] = 2.0
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            value[i, j] = -2.0
            for k in range(i + 1, j):
                worst = min(value[i, k], value[k, j])
                if worst <= value[i, j]:
                    continue
                worst = min(worst, tetrahedron(points, a, loop[i], loop[k], loop[j]))
                if worst <= value[i, j]:
                    continue
                worst = min(worst, tetrahedron(points, b, loop[i], loop[j], loop[k]))
                if worst > value[i, j]:
                    value[i, j] = worst
                    work.split[i, j] = k
    return value[0, n - 1]


@lean
def _set_cell(new, row, corners):
    a, b, c, d = corners  # of different types
    new[row, 0], new[row, 1], new[row, 2], new[row, 3] = a, b, c, d


@lean
def _list_filling(a, b, n, work):
    """List the cells of the best filling; return how many."""
    loop, stack, n_new = work.loop, work.stack, 0
    stack[0, 0], stack[0, 1], height = 0, n - 1, 1
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        k = work.split[i, j]
        _set_cell(work.new, n_new, (a, loop[i], loop[k], loop[j]))
        _set_cell(work.new, n_new + 1, (b, loop[i], loop[j], loop[k]))
        n_new += 2
        stack[height, 0], stack[height, 1] = i, k
        stack[height + 1, 0], stack[height + 1, 1] = k, j
        height += 2
    return n_new


@lean
def _remove_edge(mesh, a, b, gain, work):
    """List the cells around an edge, and better ones without it.

    Returns by how much the worst quality improves and the numbers of old and new cells; no new
    ones unless it improves by more than ``gain``.
    """
    n = _list_around(mesh, a, b, work)
    if n < 3 or not _close_loop(n, work):
        return 0.0, 0, 0
    before = 2.0
    for s in range(n):
        before = min(before, mesh.quality[work.old[s]])
    gained = _fill_best(mesh.points, a, b, n, work) - before
    if gained <= gain:
        return 0.0, 0, 0
    return gained, n, _list_filling(a, b, n, work)


@lean
def _find_across(mesh, c, f0, f1, f2):
    """Return the other cell at a face of cell c, and its node off the face; -1 if there is none."""
    for place in range(mesh.ring_ptr[f0], mesh.ring_ptr[f0 + 1]):
        t = mesh.ring[place]
        if t == c:
            continue
        count = 0
        off = -1
        for v in range(4):
            if mesh.cells[t, v] == f1 or mesh.cells[t, v] == f2:
                count += 1
            elif mesh.cells[t, v] != f0:
                off = mesh.cells[t, v]
        if count == 2:
            return t, off
    return -1, -1


@lean
def _remove_face(mesh, c, v, gain, work):
    """List the two cells at the face opposite to vertex v, and better ones without it.

    Returns the same as `_remove_edge`.
    """
    cells, points = mesh.cells, mesh.points
    p = cells[c, v]
    f0, f1, f2 = cells[c, (v + 1) % 4], cells[c, (v + 2) % 4], cells[c, (v + 3) % 4]
    if tetrahedron(points, f0, f1, f2, p) < 0.0:
        f1, f2 = f2, f1
    across, o = _find_across(mesh, c, f0, f1, f2)
    if across < 0 or mesh.removed[across]:
        return 0.0, 0, 0
    work.old[0] = c
    work.old[1] = across
    _set_cell(work.new, 0, (o, p, f0, f1))
    _set_cell(work.new, 1, (o, p, f1, f2))
    _set_cell(work.new, 2, (o, p, f2, f0))
    after = 2.0
    for s in range(3):
        after = min(after, tetrahedron(points, o, p, work.new[s, 2], work.new[s, 3]))
    gained = after - min(mesh.quality[c], mesh.quality[across])
    return (gained, 2, 3) if gained > gain else (0.0, 0, 0)


@lean_kernel
def swap(mesh, bad, work, made):
    """Replace cells around bad ones by others on the same nodes, if the worst quality improves.

    For each bad cell, the removal of each of its edges and of each of its faces is considered, and
    the best of these operations is applied.

    Parameters
    ----------
    mesh : Tetrahedra
    bad : int64[k]
        Cells to remove, the worst first.
    work : Work
    made : int32[capacity, 4]
        Out: new cells; swapping stops when it is full.

    Returns
    -------
    int
        Number of new cells.
    """
    n_made = 0
    for turn in range(bad.shape[0]):
        c = bad[turn]
        if mesh.removed[c] or n_made + 2 * MOST_AROUND > made.shape[0]:
            continue
        best, n_best_old, n_best_new = GAIN, 0, 0
        for e in range(10):
            if e < 6:
                a, b = mesh.cells[c, _EDGES[e][0]], mesh.cells[c, _EDGES[e][1]]
                gained, n_old, n_new = _remove_edge(mesh, a, b, best, work)
            else:
                gained, n_old, n_new = _remove_face(mesh, c, e - 6, best, work)
            if n_new == 0:
                continue
            best, n_best_old, n_best_new = gained, n_old, n_new
            for s in range(n_old):
                work.best_old[s] = work.old[s]
            for s in range(n_new):
                for v in range(4):
                    work.best_new[s, v] = work.new[s, v]
        for s in range(n_best_old):
            mesh.removed[work.best_old[s]] = True
        for s in range(n_best_new):
            for v in range(4):
                made[n_made, v] = work.best_new[s, v]
            n_made += 1
    return n_made
