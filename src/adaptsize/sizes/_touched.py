"""Which cells of a mesh a point, a curve, a box or a ball touches."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

# Points within this distance, in diagonals of the mesh, count as inside.
_INSIDE = 1e-9
# Samples of a curve per mean edge length of the cell that it passes.
_SAMPLES_PER_CELL = 4.0
# Cells that are smaller, in diagonals of the mesh, are degenerate and need no denser samples.
_SMALLEST_SPACING = 1e-6


def cell_inside(mesh: SimplexMesh, point: FloatArray) -> IntArray:
    """Return the cell that contains a point, int32[1], or int32[0] if there is none."""
    cells, _, distances = mesh.locator.nearest(point[None])
    return cells[distances <= _INSIDE * mesh.diagonal]


def cells_along(
    mesh: SimplexMesh, curve: SimplexMesh
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the cells at samples along segments, with a density adapted to the cells.

    Returns
    -------
    cells : int32[n_samples]
        The cell around each sample, or the closest one.
    segments : int32[n_samples]
        The segment of each sample.
    along : float64[n_samples]
        Its place, 0 at the first node of the segment to 1 at the second.
    distances : float64[n_samples]
        Its distance from the mesh.
    """
    spacing = np.maximum(_mean_edges(mesh) / _SAMPLES_PER_CELL, _SMALLEST_SPACING * mesh.diagonal)
    a, b = curve.points[curve.cells[:, 0]], curve.points[curve.cells[:, 1]]
    lengths = np.linalg.norm(b - a, axis=1)
    segment = np.arange(curve.n_cells, dtype=np.int32)
    lower, upper = np.zeros(curve.n_cells), np.ones(curve.n_cells)
    at_a, at_b = mesh.locator.nearest(a), mesh.locator.nearest(b)
    found = [(at_a[0], segment, lower, at_a[2]), (at_b[0], segment, upper, at_b[2])]
    while len(segment) > 0:  # halve the pieces until they are short enough
        middle = 0.5 * (lower + upper)
        points = a[segment] + middle[:, None] * (b - a)[segment]
        cells, _, distances = mesh.locator.nearest(points)
        found.append((cells, segment, middle, distances))
        # A piece far from the mesh cannot touch it, however small the cells are.
        long = (upper - lower) * lengths[segment] > spacing[cells] + distances
        segment = np.repeat(segment[long], 2)
        lower, upper = (
            np.column_stack([lower[long], middle[long]]).ravel(),
            np.column_stack([middle[long], upper[long]]).ravel(),
        )
    cells, segment, along, distances = (np.concatenate(part) for part in zip(*found, strict=True))
    return cells, segment, along, distances


def cells_within(mesh: SimplexMesh, curve: SimplexMesh) -> IntArray:
    """Return the cells that contain samples of a curve, without cells that are only closest."""
    cells, _, _, distances = cells_along(mesh, curve)
    return cells[distances <= _INSIDE * mesh.diagonal]


def cells_with_edge_in_box(mesh: SimplexMesh, lower: FloatArray, upper: FloatArray) -> IntArray:
    """Return the cells with an edge that intersects a box."""
    meets = np.zeros(mesh.n_cells, np.bool_)
    for start, step in _edges_of_cells(mesh):
        first, last = np.zeros(len(start)), np.ones(len(start))
        hit = np.ones(len(start), np.bool_)
        for d in range(mesh.dim):
            moving = step[:, d] != 0.0
            rate = np.where(moving, step[:, d], 1.0)
            one, two = (lower[d] - start[:, d]) / rate, (upper[d] - start[:, d]) / rate
            first = np.where(moving, np.maximum(first, np.minimum(one, two)), first)
            last = np.where(moving, np.minimum(last, np.maximum(one, two)), last)
            hit &= moving | ((start[:, d] >= lower[d]) & (start[:, d] <= upper[d]))
        meets |= hit & (first <= last)
    return np.flatnonzero(meets).astype(np.int32)


def cells_with_edge_in_ball(mesh: SimplexMesh, centre: FloatArray, radius: float) -> IntArray:
    """Return the cells with an edge that intersects a ball."""
    meets = np.zeros(mesh.n_cells, np.bool_)
    for start, step in _edges_of_cells(mesh):
        squared = np.maximum((step**2).sum(axis=1), np.finfo(np.float64).tiny)
        along = np.clip(((centre - start) * step).sum(axis=1) / squared, 0.0, 1.0)
        closest = start + along[:, None] * step
        meets |= np.linalg.norm(closest - centre, axis=1) <= radius
    return np.flatnonzero(meets).astype(np.int32)


def box_edges(lower: FloatArray, upper: FloatArray) -> SimplexMesh:
    """Return the 2, 4 or 12 edges of a box as segments."""
    dim = len(lower)
    corner = np.arange(2**dim)
    points = np.where((corner[:, None] >> np.arange(dim)) & 1, upper, lower)
    edges = [(i, i | 1 << d) for i in corner for d in range(dim) if not i >> d & 1]
    return SimplexMesh(points, edges)


def _edges_of_cells(mesh: SimplexMesh) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the first node and the vector of the edges of all cells, one per cell at a time."""
    corners = mesh.points[mesh.cells]
    for i, j in combinations(range(mesh.cells.shape[1]), 2):
        yield corners[:, i], corners[:, j] - corners[:, i]


def _mean_edges(mesh: SimplexMesh) -> npt.NDArray[np.float64]:
    """Return the mean length of the edges of each cell."""
    lengths = [np.linalg.norm(step, axis=1) for _, step in _edges_of_cells(mesh)]
    return np.asarray(np.mean(lengths, axis=0))
