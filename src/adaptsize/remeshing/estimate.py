"""Estimates of the number of cells of a mesh with given sizes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes, check_function, check_type
from adaptsize.background import SimplexMesh
from adaptsize.errors import TooManyElementsError
from adaptsize.remeshing.sizing import Size
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, mean_density
from adaptsize.typing import FloatArray

_COLUMNS = 40


def estimate_n_cells(mesh: SimplexMesh, size: Size) -> float:
    """Return the estimated number of cells in the domain of ``mesh`` at the requested sizes.

    Parameters
    ----------
    mesh : SimplexMesh
    size : callable
        Requested edge length at float64[n, dim] points.

    Returns
    -------
    float
        The integral of 1 over the measure of a regular simplex with edges h, where h is linear
        between the nodes and the centroid of each cell.  Details of the size function smaller
        than the cells are missed.  Mmg makes about as many triangles, and 1.2 times as many
        tetrahedra.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> round(estimate_n_cells(mesh, lambda x: np.full(len(x), 0.1)))
    115
    """
    check_type("mesh", mesh, SimplexMesh)
    check_function("size", size, "points")
    k = mesh.cell_dim
    sizes = as_sizes("size(points)", size(mesh.points), (mesh.n_points,))
    corners = sizes[mesh.cells]
    middles = mesh.points[mesh.cells].mean(axis=1)
    central = as_sizes("size(points)", size(middles), (mesh.n_cells,))
    density = np.zeros(mesh.n_cells)
    for v in range(k + 1):  # the sub-simplices between the facets of a cell and its centroid
        part = corners.copy()
        part[:, v] = central
        density += mean_density(part) / (k + 1)
    return float(ELEMENTS_PER_MEASURE[k] * (mesh.measures * density).sum())


def estimate_n_enclosed(surface: SimplexMesh, size: Size) -> float:
    """Return the estimated number of tetrahedra inside a surface at the requested sizes.

    The result is at least the number of elements of the surface itself.
    """
    return max(InsideSamples.of(surface).estimate(size), _estimate_n_triangles(surface, size))


class InsideSamples(NamedTuple):
    """Points evenly distributed in the region that a surface encloses.

    Holes in the surface reduce the accuracy.
    """

    points: FloatArray
    volume: float
    """Volume of the enclosed region."""

    @classmethod
    def of(cls, surface: SimplexMesh) -> InsideSamples:
        """Sample the interior along columns through a surface."""
        return _sample_inside(surface)

    def estimate(self, size: Size) -> float:
        """Return the estimated number of tetrahedra at the requested sizes."""
        if len(self.points) == 0:
            return 0.0
        density = float((size(self.points) ** -3.0).mean())
        return ELEMENTS_PER_MEASURE[3] * self.volume * density


def _estimate_n_triangles(surface: SimplexMesh, size: Size) -> float:
    """Return the estimated number of triangles, from an even sample if there are very many."""
    step = surface.n_cells // 5_000 + 1
    if step == 1:
        return estimate_n_cells(surface, size)
    nodes, local = np.unique(surface.cells[::step], return_inverse=True)
    sample = SimplexMesh(surface.points[nodes], local.reshape(-1, 3))
    share = sample.measures.sum() / surface.measures.sum()
    return estimate_n_cells(sample, size) / float(share)


def refuse_too_many(estimate: float, max_elements: float) -> None:
    """Raise TooManyElementsError if ``estimate`` is above ``max_elements``."""
    if estimate > max_elements:
        raise TooManyElementsError(
            f"the sizes require about {estimate:.3g} elements, more than "
            f"max_elements = {max_elements:.3g}; increase the sizes or raise max_elements"
        )


def _sample_inside(surface: SimplexMesh) -> InsideSamples:
    """Return evenly distributed points in the region that a surface encloses, and its volume.

    The columns are parallel to a principal axis of the surface, so that the points turn with it.
    """
    middle, axes = _principal_axes(surface)
    local = (surface.points - middle) @ axes
    used = local[surface.cells].reshape(-1, 3)
    low = used.min(axis=0)
    extent = used.max(axis=0) - low
    axis = int(np.argmin(extent))  # for thin plates, all columns then pass through the plate
    u, v = (d for d in range(3) if d != axis)
    i, j = np.indices((_COLUMNS, _COLUMNS)).reshape(2, -1)
    # Rows are shifted by the golden ratio.  A regular grid would hit edges of regular meshes.
    at = np.column_stack([i + 0.5, j + (i + 0.5) * 0.6180339887498949 % 1.0]) / _COLUMNS
    at = low[[u, v]] + at * extent[[u, v]]
    column, height = _crossings(local[surface.cells], at, (u, v, axis))
    order = np.lexsort((height, column))
    column, height = column[order], height[order]
    rank = np.arange(len(column)) - np.searchsorted(column, column)  # position in its column
    start = np.flatnonzero(rank % 2 == 0)
    start = start[start + 1 < len(column)]
    start = start[column[start] == column[start + 1]]
    length = height[start + 1] - height[start]
    area = extent[u] * extent[v] / len(at)
    total = float(length.sum())
    count = np.ceil(length / max(total / 4000.0, np.finfo(float).tiny)).astype(int)
    piece = np.repeat(np.arange(len(start)), count)
    part = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[piece]
    points = np.empty((len(piece), 3))
    points[:, [u, v]] = at[column[start[piece]]]
    points[:, axis] = height[start[piece]] + part * length[piece]
    return InsideSamples(points @ axes.T + middle, total * area)


def _principal_axes(surface: SimplexMesh) -> tuple[FloatArray, FloatArray]:
    """Return the centroid of a surface, and its principal axes as columns.

    They point to the side to which the area extends farther.  Axes of symmetric surfaces depend on
    rounding.
    """
    middles = surface.points[surface.cells].mean(axis=1)
    share = surface.measures / surface.measures.sum()
    centroid = share @ middles
    offsets = middles - centroid
    axes = np.linalg.eigh((share[:, None] * offsets).T @ offsets)[1]
    axes *= np.where(share @ (offsets @ axes) ** 3 < 0.0, -1.0, 1.0)
    return centroid, axes


def _crossings(
    corners: FloatArray, at: FloatArray, axes: tuple[int, int, int]
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return where lines along ``axes[2]`` through ``at`` cross the triangles: lines, heights."""
    u, v, w = axes
    a, b, c = (corners[:, i] for i in range(3))
    twice_area = (b[:, u] - a[:, u]) * (c[:, v] - a[:, v]) - (b[:, v] - a[:, v]) * (
        c[:, u] - a[:, u]
    )
    lowest, highest = corners[:, :, u].min(axis=1), corners[:, :, u].max(axis=1)
    lines: list[npt.NDArray[np.intp]] = []
    heights: list[FloatArray] = []
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles parallel to the lines
        for i, (x, y) in enumerate(at):
            near = np.flatnonzero((lowest <= x) & (highest >= x))
            p, q, r = a[near], b[near], c[near]
            s = ((x - p[:, u]) * (r[:, v] - p[:, v]) - (y - p[:, v]) * (r[:, u] - p[:, u])) / (
                twice_area[near]
            )
            t = ((q[:, u] - p[:, u]) * (y - p[:, v]) - (q[:, v] - p[:, v]) * (x - p[:, u])) / (
                twice_area[near]
            )
            hit = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0)
            height = p[:, w] + s * (q[:, w] - p[:, w]) + t * (r[:, w] - p[:, w])
            lines.append(np.full(int(hit.sum()), i))
            heights.append(height[hit])
    return np.concatenate(lines), np.concatenate(heights)
