"""Intersections of the cells of two meshes: their measures, and products of linear functions."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

from adaptsize._kernels.overlap import fill_overlaps, new_clipping
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# A cell with less than this share of its measure in the old domain counts as outside.
OUTSIDE = 1e-9


class Intersections(NamedTuple):
    """Integrals over the intersections of the cells of two meshes."""

    measures: csr_array
    """Sparse [n_cells of the new mesh, n_cells of the old one]."""
    products: csr_array | None
    r"""The mixed mass matrix, sparse [n_points of the new mesh, n_points of the old one].

    Its entries are the integrals of :math:`\phi_i \psi_j` over the common domain, where
    :math:`\phi_i` and :math:`\psi_j` are the hat functions of the two meshes.  They are exact to
    rounding.  None if it was not requested.
    """


def intersections_of(
    old: SimplexMesh, new: SimplexMesh, report: ProgressCallback, *, products: bool = False
) -> Intersections:
    """Return integrals over the intersections of the cells of two meshes."""
    locator = old.locator
    points = np.zeros((new.n_points, 3))
    points[:, : new.dim] = new.points * locator.scale
    cells = np.array(new.cells)
    order = along_curve(new.points[new.cells].mean(axis=1)).astype(np.int64)
    counts, n_nodes = np.zeros(new.n_cells, np.int64), np.zeros(new.n_cells, np.int64)
    slot = np.zeros(len(locator.tree.points), np.int32)
    parts: list[tuple[IntArray, FloatArray]] = []
    assembled: list[tuple[IntArray, csr_array]] = []
    first, step, room = 0, 256, 1_000_000
    found, measures, nodes, values = _buffers(room, cells, products)
    work = new_clipping()
    while first < new.n_cells:
        begin = time.perf_counter()
        reached, used, n_used = fill_overlaps(
            locator.tree, (points, cells), order[first : first + step], work,
            (counts, found, measures), (n_nodes, nodes, slot, values),
        )  # fmt: skip
        seconds = time.perf_counter() - begin
        if reached == 0:  # a single cell has more overlaps
            room *= 2
            found, measures, nodes, values = _buffers(room, cells, products)
            continue
        parts.append((found[:used].copy(), measures[:used].copy()))
        if products:
            done = order[first : first + reached]
            start = np.concatenate([[0], np.cumsum(n_nodes[done])])
            rows = [
                csr_array((values[:n_used, v], nodes[:n_used], start), (reached, len(slot)))
                for v in range(cells.shape[1])
            ]
            assembled.append(_summed(cells[done].T.ravel(), vstack(rows), new.n_points))
        # A compiled loop cannot be interrupted.  One call should take about 0.3 s.
        step = 2 * step if seconds < 0.15 else max(step // 2, 1)
        first += reached
        report("overlaps of the cells of two meshes", first / new.n_cells)
    unit = locator.scale**-new.dim
    columns = locator.cell_of_row[np.concatenate([part[0] for part in parts])]
    data = np.concatenate([part[1] for part in parts]) * unit
    shape = (new.n_cells, old.n_cells)
    by_cell = csr_array((data, (np.repeat(order, counts[order]), columns)), shape=shape)
    if not products:
        return Intersections(by_cell, None)
    every = np.concatenate([numbers for numbers, _ in assembled])
    numbers, matrix = _summed(every, vstack([part for _, part in assembled]), new.n_points)
    start = np.zeros(new.n_points + 1, matrix.indptr.dtype)
    start[1 + numbers] = np.diff(matrix.indptr)
    mixed = csr_array(
        (matrix.data * unit, locator.node_of_point[matrix.indices], np.cumsum(start)),
        shape=(new.n_points, old.n_points),
    )
    return Intersections(by_cell, mixed)


def _buffers(
    room: int, cells: IntArray, products: bool
) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    """Return room for old cells and measures, and for nodes and their products."""
    nodes = np.empty(room if products else 0, np.int32)
    return np.empty(room, np.int32), np.empty(room), nodes, np.empty((len(nodes), cells.shape[1]))


def _summed(numbers: IntArray, rows: csr_array, n: int) -> tuple[IntArray, csr_array]:
    """Return the sums of rows with the same number below n, and these numbers, ascending."""
    present = np.zeros(n, np.bool_)
    present[numbers] = True
    place = np.cumsum(present, dtype=np.int32) - 1
    ones = csr_array(
        (np.ones(len(numbers)), place[numbers], np.arange(len(numbers) + 1)),
        shape=(len(numbers), int(place[-1]) + 1),
    )
    return np.flatnonzero(present).astype(np.int32), ones.T.tocsr() @ rows
