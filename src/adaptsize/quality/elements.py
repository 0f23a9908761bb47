"""Quality of elements: radius ratios, angles, and quality in a metric."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import factorial
from typing import TypeAlias

import numpy as np

from adaptsize._checks import check_type, place_text
from adaptsize._pickling import once
from adaptsize._workers import in_all_threads
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics import Metric
from adaptsize.metrics.implied import from_regular
from adaptsize.typing import BoolArray, FloatArray

# Cells are processed in blocks whose numbers fit into the cache.
_CELLS_AT_ONCE = 4096


#: Cells whose height is at most this many times the rounding of their coordinates are flat.
_ROUNDING = 16.0


def flat_cells(mesh: SimplexMesh) -> BoolArray:
    """Return whether each cell has the measure zero, up to the rounding of its coordinates."""
    is_flat, measures = np.empty(mesh.n_cells, np.bool_), mesh.measures

    def judge(first: int, last: int) -> None:
        corners, longest = mesh.points[mesh.cells[first:last]], np.zeros(last - first)
        for a, b in combinations(range(mesh.cell_dim + 1), 2):
            np.maximum(longest, np.linalg.norm(corners[:, a] - corners[:, b], axis=1), out=longest)
        rounding = _ROUNDING * np.finfo(np.float64).eps * np.abs(corners).max(axis=(1, 2))
        least = rounding * longest ** (mesh.cell_dim - 1)
        is_flat[first:last] = factorial(mesh.cell_dim) * measures[first:last] <= least

    in_all_threads(judge, mesh.n_cells, _CELLS_AT_ONCE)
    return is_flat


def folded_cells(mesh: SimplexMesh) -> BoolArray:
    """Return which cells are on the same side of a facet as their neighbour there.

    The result is kept with the mesh, as its derived data are.
    """
    return once(mesh, "_folded_cells", lambda: _folded_cells(mesh))


def _folded_cells(mesh: SimplexMesh) -> BoolArray:
    signs = np.sign(mesh.signed_measures)
    found = _with_same_side(mesh, signs)
    if not found.any():  # flat cells, which do not count, would only be fewer
        return found
    return _with_same_side(mesh, np.where(flat_cells(mesh), 0.0, signs))


def _with_same_side(mesh: SimplexMesh, side: FloatArray) -> BoolArray:
    """Return which cells, of given signs, are on the same side of a facet as their neighbour."""
    # The side follows from the sign of the cell and the order of its nodes.
    cells, sides = mesh.cells, np.empty(mesh.cells.shape)
    if cells.shape[1] == 3:  # the side of an edge that is passed in this direction
        for v in range(3):
            upward = cells[:, v - 2] < cells[:, v - 1]
            np.multiply(side, np.where(upward, 1.0, -1.0), out=sides[:, v])
    else:
        for i, j in combinations(range(cells.shape[1]), 2):
            side = np.where(cells[:, i] < cells[:, j], side, -side)
        rank = (cells[:, None, :] < cells[:, :, None]).sum(axis=2)
        sides = np.where(rank % 2 == 0, side[:, None], -side[:, None])
    sums = np.bincount(mesh.cell_facets.ravel(), sides.ravel())
    between = (mesh.facet_cell_counts == 2) & (np.abs(sums) == 2.0)
    if not between.any():
        return np.zeros(len(cells), np.bool_)
    return np.asarray(between[mesh.cell_facets].any(axis=1))


def refuse_folded(mesh: SimplexMesh) -> None:
    """Raise a ValueError that names places if cells overlap their neighbours."""
    folded = np.flatnonzero(folded_cells(mesh))
    if len(folded) == 0:
        return
    places = [place_text(x, 4) for x in mesh.points[mesh.cells[folded[:3]]].mean(axis=1)]
    more = ", ..." * (len(folded) > 3)
    raise ValueError(
        f"mesh must not be folded: {len(folded)} cells are on the same side of a facet as a "
        f"neighbour, at {', '.join(places)}{more} (needs_remeshing returns more places); move the "
        "nodes by less, or remesh before cells turn over"
    )


def radius_ratios(mesh: SimplexMesh) -> FloatArray:
    """Return the radius ratio of each cell, float64[n_cells], 0 to 1.

    See `SimplexMesh.radius_ratios`.
    """
    ratios = _of_cells(mesh, _radius_ratios_of_triangles, _radius_ratios_of_tetrahedra)
    # Rounding may lift a regular cell above 1.
    return np.asarray(np.minimum(ratios, 1.0))


def minimum_angles(mesh: SimplexMesh) -> FloatArray:
    """Return the smallest angle of each triangle, or dihedral angle of each tetrahedron.

    See `SimplexMesh.minimum_angles`.
    """
    return np.asarray(np.degrees(_of_cells(mesh, _angles_of_triangles, _angles_of_tetrahedra)))


def check_cells(mesh: AnyMesh) -> None:
    """Raise a ValueError if a mesh consists of segments."""
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")


_Formula: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


def _of_cells(mesh: SimplexMesh, of_triangles: _Formula, of_tetrahedra: _Formula) -> FloatArray:
    """Return a formula of corners, float64[k + 1, dim, m], and measures; 0 for degenerate cells.

    Each cell is scaled by its longest extent, so that products of lengths stay in the
    range of float64.
    """
    check_type("mesh", mesh, SimplexMesh)
    check_cells(mesh)
    formula, values = of_triangles if mesh.cell_dim == 2 else of_tetrahedra, np.zeros(mesh.n_cells)
    all_measures = mesh.measures

    def measure(first: int, last: int) -> None:
        part = slice(first, last)
        # Each coordinate of a corner is a contiguous row.
        corners = np.ascontiguousarray(mesh.points[mesh.cells[part]].transpose(1, 2, 0))
        corners = corners - corners[0]
        extent = np.abs(corners).max(axis=(0, 1))
        extent[extent == 0.0] = 1.0
        corners /= extent
        measures = all_measures[part] / extent**mesh.cell_dim
        with np.errstate(invalid="ignore"):  # 0 / 0
            values[part] = np.where(measures > 0.0, formula(corners, measures), 0.0)

    in_all_threads(measure, mesh.n_cells, _CELLS_AT_ONCE)
    return values


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=0))


def _lengths(vectors: FloatArray) -> FloatArray:
    return np.sqrt(_dot(vectors, vectors))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


def _radius_ratios_of_triangles(corners: FloatArray, areas: FloatArray) -> FloatArray:
    a, b, c = (_lengths(corners[i] - corners[j]) for i, j in ((1, 2), (2, 0), (0, 1)))
    return np.asarray(16.0 * areas**2 / (a * b * c * (a + b + c)))


def _radius_ratios_of_tetrahedra(corners: FloatArray, volumes: FloatArray) -> FloatArray:
    e1, e2, e3 = (corners[i] - corners[0] for i in (1, 2, 3))
    n1, n2, n3 = _cross(e2, e3), _cross(e3, e1), _cross(e1, e2)
    opposite = _cross(corners[2] - corners[1], corners[3] - corners[1])
    area = 0.5 * (_lengths(n1) + _lengths(n2) + _lengths(n3) + _lengths(opposite))
    centre = _lengths(_dot(e1, e1) * n1 + _dot(e2, e2) * n2 + _dot(e3, e3) * n3)  # 12 V R
    return np.asarray(108.0 * volumes**2 / (area * centre))


def _angles_of_triangles(corners: FloatArray, areas: FloatArray) -> FloatArray:
    angles = []
    for i in range(3):
        u, v = (corners[(i + k) % 3] - corners[i] for k in (1, 2))
        angles.append(np.arctan2(2.0 * areas, _dot(u, v)))
    return np.asarray(np.min(angles, axis=0))


def _angles_of_tetrahedra(corners: FloatArray, volumes: FloatArray) -> FloatArray:
    angles = []
    for i, j in combinations(range(4), 2):
        k, m = (v for v in range(4) if v not in (i, j))
        e, u, v = (corners[other] - corners[i] for other in (j, k, m))
        cosine = _dot(_cross(e, u), _cross(e, v))
        angles.append(np.arctan2(6.0 * volumes * _lengths(e), cosine))
    return np.asarray(np.min(angles, axis=0))


@dataclass(frozen=True)
class MetricQuality:
    """Quality of the cells of a mesh in a metric."""

    quality_min: float
    """Smallest of `metric_qualities`."""
    quality_p01: float
    """1 % quantile."""
    quality_mean: float
    complexity: float
    r"""Volume of the mesh in the metric, :math:`\int \sqrt{\det M}\,dx`."""
    predicted_elements: float
    """Number of simplices of unit edges in the metric that fill this volume."""
    requested_aspect: float
    """Largest aspect ratio of the metric."""
    largest_aspect: float
    """Largest aspect ratio of a cell: of the lengths of the ellipsoid through its corners."""

    def __str__(self) -> str:
        """Return two lines."""
        return (
            f"quality in the metric: min {self.quality_min:.4f}, 1 % {self.quality_p01:.4f}, "
            f"mean {self.quality_mean:.4f}\n"
            f"complexity {self.complexity:.4g}, for {self.predicted_elements:.4g} cells; aspect "
            f"ratio up to {self.largest_aspect:.4g}, requested up to {self.requested_aspect:.4g}"
        )


def metric_qualities(mesh: SimplexMesh, metric: Metric) -> FloatArray:
    """Return how regular each cell is in a metric: 1 regular, 0 flat.

    See `SimplexMesh.metric_qualities`.
    """
    mesh = as_mesh("mesh", mesh)
    check_type("metric", metric, Metric)
    metric.check_mesh(mesh)
    check_cells(mesh)
    k = mesh.cell_dim
    inside = metric.interpolate(mesh.cells, np.full(mesh.cells.shape, 1.0 / (k + 1)))
    # M = (R / h) (R / h)^T
    mapped = (inside.directions / inside.sizes[:, None, :]).swapaxes(1, 2) @ from_regular(mesh)
    singular = np.linalg.svd(mapped, compute_uv=False)
    squares = np.square(singular / np.maximum(singular[:, :1], np.finfo(float).tiny))
    trace = np.maximum(squares.sum(axis=1), np.finfo(float).tiny)
    return np.asarray(k * squares.prod(axis=1) ** (1.0 / k) / trace)


def metric_quality(mesh: SimplexMesh, metric: Metric) -> MetricQuality:
    """Return the quality of a mesh in a metric at its nodes."""
    qualities = metric_qualities(mesh, metric)
    stretch = np.linalg.svd(from_regular(mesh), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        aspect = stretch[:, 0] / stretch[:, -1]
    aspect[np.isnan(aspect)] = np.inf  # cells of one point
    return MetricQuality(
        quality_min=float(qualities.min()),
        quality_p01=float(np.quantile(qualities, 0.01)),
        quality_mean=float(qualities.mean()),
        complexity=metric.complexity(mesh),
        predicted_elements=metric.predicted_elements(mesh),
        requested_aspect=float(metric.aspect_ratio.max()),
        largest_aspect=float(aspect.max()),
    )
