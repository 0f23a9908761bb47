"""Quality of elements: radius ratios, angles, and quality in a metric."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np

from adaptsize._checks import check_type
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics import Metric
from adaptsize.metrics.implied import from_regular
from adaptsize.typing import FloatArray

# Cells are processed in blocks whose numbers fit into the cache.
_CELLS_AT_ONCE = 4096


def radius_ratios(mesh: SimplexMesh) -> FloatArray:
    r"""Return the radius ratio of each cell, float64[n_cells], 0 to 1.

    It is the radius r of the inscribed sphere over the radius R of the circumscribed sphere,
    scaled to 1 for the regular simplex [1]_: ``2 r / R`` for triangles, ``3 r / R`` for
    tetrahedra.  Degenerate cells have 0.  The orientation does not matter.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles, in the plane or in space, or tetrahedra.

    Raises
    ------
    ValueError
        If the mesh consists of segments.

    Notes
    -----
    With the edge vectors e1, e2, e3 from one corner, lengths a, b, c, area A and volume V,

    .. math::

        \frac{2r}{R} = \frac{16 A^2}{abc\,(a+b+c)}, \qquad
        \frac{3r}{R} = \frac{108 V^2}
        {\sum_f A_f\; \big| |e_1|^2 e_2 \times e_3 + |e_2|^2 e_3 \times e_1
        + |e_3|^2 e_1 \times e_2 \big|}.

    References
    ----------
    .. [1] A. Liu, B. Joe, "Relationship between tetrahedron shape measures", BIT 34
       (1994) 268-287.

    Examples
    --------
    >>> radius_ratios(SimplexMesh([[0, 0], [1, 0], [0.5, 0.75**0.5]], [[0, 1, 2]])).round(12)
    array([1.])
    """
    ratios = _of_cells(mesh, _radius_ratios_of_triangles, _radius_ratios_of_tetrahedra)
    # Rounding may lift a regular cell above 1.
    return np.asarray(np.minimum(ratios, 1.0))


def minimum_angles(mesh: SimplexMesh) -> FloatArray:
    """Return the smallest angle of each triangle, or dihedral angle of each tetrahedron.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles, in the plane or in space, or tetrahedra.

    Returns
    -------
    ndarray of float64, shape (n_cells,)
        Degrees: at most 60 for triangles, at most 70.53 (arccos 1/3) for tetrahedra, and 0 for
        degenerate cells.  The orientation does not matter.

    Raises
    ------
    ValueError
        If the mesh consists of segments.

    Notes
    -----
    Let e be an edge between two faces whose other edges from the same corner are u and v.  The
    tangent of the dihedral angle at e is ``6 V |e| / ((e x u) . (e x v))``.  The arctangent is
    accurate for all angles.  The arccosine of the normals would lose half the digits
    near 0 and 180 degrees.

    Examples
    --------
    >>> minimum_angles(SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])).round(12)
    array([45.])
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
    for first in range(0, mesh.n_cells, _CELLS_AT_ONCE):
        part = slice(first, first + _CELLS_AT_ONCE)
        # Each coordinate of a corner is a contiguous row.
        corners = np.ascontiguousarray(mesh.points[mesh.cells[part]].transpose(1, 2, 0))
        corners = corners - corners[0]
        extent = np.abs(corners).max(axis=(0, 1))
        extent[extent == 0.0] = 1.0
        corners /= extent
        measures = mesh.measures[part] / extent**mesh.cell_dim
        with np.errstate(invalid="ignore"):  # 0 / 0
            values[part] = np.where(measures > 0.0, formula(corners, measures), 0.0)
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
    r"""Return how regular each cell is in a metric: 1 regular, 0 flat.

    With the linear map J from a regular simplex to the cell and the metric M in the cell, the
    result is the mean ratio [1]_

    .. math:: q = k \, \det(J^T M J)^{1/k} / \mathrm{tr}(J^T M J)

    for cells of dimension k.  M is the log-Euclidean mean of the metrics of the corners.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles or tetrahedra.
    metric : Metric
        At its nodes, with finite sizes.

    Returns
    -------
    ndarray of float64, shape (n_cells,)

    References
    ----------
    .. [1] A. Liu, B. Joe, "Relationship between tetrahedron shape measures", BIT 34 (1994)
       268-287.

    Examples
    --------
    A triangle that is regular after a stretching by 10:

    >>> from adaptsize.metrics import Metric, Metric
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0.5, 5 * np.sqrt(3)]], [[0, 1, 2]])
    >>> stretched = Metric([[1.0, 10.0]] * 3, [np.eye(2)] * 3)
    >>> metric_qualities(mesh, stretched).round(12)
    array([1.])
    >>> metric_qualities(mesh, Metric.isotropic([1.0, 1.0, 1.0], 2)).round(3)
    array([0.198])
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
