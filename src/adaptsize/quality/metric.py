"""Quality of cells in a metric, and how many there are for its complexity."""

from dataclasses import dataclass

import numpy as np

from adaptsize._checks import check_type
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics import Metric
from adaptsize.metrics.implied import from_regular
from adaptsize.quality.elements import check_cells
from adaptsize.typing import FloatArray


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
