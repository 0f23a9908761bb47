"""Metrics in the form that generators need: a function of points that returns matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from adaptsize._checks import describe, refuse_where
from adaptsize.background import SimplexMesh
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import FloatArray

#: A checked metric as a function of points.
MetricAt: TypeAlias = Callable[[FloatArray], Metric]


def as_metric_at(size: Any, mesh: SimplexMesh, hmax: float) -> MetricAt | None:
    """Return a requested metric as a function of points that checks it, or None for sizes.

    Parameters
    ----------
    size : Metric, MetricFunction, or callable that returns a Metric; anything else is a size
    mesh : SimplexMesh
        Mesh of the nodal values.
    hmax : float
        Upper limit of the sizes.

    Raises
    ------
    ValueError
        If the metric does not belong to the mesh or has infinite sizes.  The returned function
        raises it too.
    """
    if isinstance(size, Metric):
        size = MetricFunction(mesh, size)
    elif not callable(size) or not isinstance(size(mesh.points[:1]), Metric):
        return None

    def metric(points: FloatArray) -> Metric:
        there = size(points)
        if not isinstance(there, Metric) or there.sizes.shape != points.shape:
            wanted = f"a Metric with {len(points)} nodes in {points.shape[1]}-D"
            raise ValueError(f"size(points) must be {wanted}, got {describe(there)}")
        if np.isfinite(hmax):
            there = there.clip(hmax=hmax)
        bad = np.isinf(there.sizes)
        refuse_where("size", bad, there.sizes, "must be finite in all directions: pass hmax")
        return there

    metric(mesh.points)
    return metric


def mean_size(metric: MetricAt, cell_dim: int) -> Size:
    """Return the geometric mean of the sizes: that of regular cells of the same measure.

    On a surface it is the mean of the two smallest, because the largest is that along the normal.
    """

    def size(points: FloatArray) -> FloatArray:
        return np.asarray(np.exp(np.log(metric(points).sizes[:, :cell_dim]).mean(axis=1)))

    return size


def upper_triangles(matrices: FloatArray) -> FloatArray:
    """Return the rows of the upper triangles, float64[n, dim (dim + 1) / 2]."""
    i, j = np.triu_indices(matrices.shape[-1])
    return np.ascontiguousarray(matrices[:, i, j])
