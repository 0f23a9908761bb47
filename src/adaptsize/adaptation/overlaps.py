"""Measures of the overlaps of the cells of two meshes."""

from __future__ import annotations

import time

import numpy as np
from scipy.sparse import csr_array

from adaptsize._kernels.overlap import fill_overlaps
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# A cell with less than this share of its measure in the old domain counts as outside.
OUTSIDE = 1e-9


def overlaps_of(old: SimplexMesh, new: SimplexMesh, report: ProgressCallback) -> csr_array:
    """Return the measures of the overlaps of the cells of two meshes."""
    locator = old.locator
    points = np.zeros((new.n_points, 3))
    points[:, : new.dim] = new.points * locator.scale
    cells = np.array(new.cells)
    order = along_curve(new.points[new.cells].mean(axis=1)).astype(np.int64)
    counts = np.zeros(new.n_cells, np.int64)
    parts: list[tuple[IntArray, FloatArray]] = []
    first, step = 0, 256
    room = 1_000_000  # overlaps of a call; grows if one new cell has more
    found, measures = np.empty(room, np.int32), np.empty(room)
    while first < new.n_cells:
        last = min(first + step, new.n_cells)
        begin = time.perf_counter()
        out = (counts, found, measures)
        reached, used = fill_overlaps(locator.tree, points, cells, order[first:last], out)
        seconds = time.perf_counter() - begin
        if reached == 0:  # a single cell has more overlaps
            room *= 2
            found, measures = np.empty(room, np.int32), np.empty(room)
            continue
        parts.append((found[:used].copy(), measures[:used].copy()))
        # A compiled loop cannot be interrupted.  One call should take about 0.3 s.
        step = 2 * step if seconds < 0.15 else max(step // 2, 1)
        first += reached
        report("overlaps of the cells of two meshes", first / new.n_cells)
    columns = locator.cell_of_row[np.concatenate([part[0] for part in parts])]
    data = np.concatenate([part[1] for part in parts]) / locator.scale**new.dim
    rows = np.repeat(order, counts[order])
    shape = (new.n_cells, old.n_cells)
    return csr_array((data, (rows, columns)), shape=shape)
