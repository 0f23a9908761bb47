"""`MetricFunction`: a metric that is defined everywhere in a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt

from adaptsize._checks import as_points, check_type
from adaptsize._pickling import ReadOnlyState
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics.metric import Metric


@dataclass(frozen=True, eq=False, repr=False)
class MetricFunction(ReadOnlyState):
    """A metric at the nodes of a mesh, interpolated between them.

    It is to a `Metric` what a `SizeFunction` is to nodal sizes.  Called with points of shape
    (n, dim), it returns the metric at these points, the log-Euclidean mean of the metrics of the
    corners (`Metric.interpolate`).  Outside the mesh this is the metric at the closest point.

    Parameters
    ----------
    mesh : SimplexMesh
    metric : Metric
        At the nodes of the mesh.

    Raises
    ------
    ValueError
        If the metric does not have as many nodes and coordinates as the mesh.

    Examples
    --------
    >>> from adaptsize.metrics import Metric
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> function = MetricFunction(mesh, Metric.isotropic([0.1, 0.4, 0.4], 2))
    >>> function([[0.5, 0.0]]).sizes.round(12)
    array([[0.2, 0.2]])
    """

    mesh: SimplexMesh
    metric: Metric

    def __post_init__(self) -> None:
        object.__setattr__(self, "mesh", as_mesh("mesh", self.mesh))
        check_type("metric", self.metric, Metric)
        self.metric.check_mesh(self.mesh)

    def __repr__(self) -> str:
        return f"MetricFunction({self.metric!r} on {self.mesh!r})"

    def __call__(self, points: npt.ArrayLike) -> Metric:
        """Return the metric at points, array_like of float of shape (n, dim)."""
        x = as_points("points", points, self.mesh.dim)
        cells, weights, _ = self.mesh.locator.nearest(x)
        return self.metric.interpolate(self.mesh.cells[cells], weights)
