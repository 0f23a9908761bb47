"""Anisotropic sizes: metrics, their limits, and their gradient limiting.

Names are imported on first use, since files need the classes only.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

if TYPE_CHECKING:
    from adaptsize.metrics.curvature import metric_from_curvature
    from adaptsize.metrics.function import MetricFunction
    from adaptsize.metrics.hessian import metric_from_hessian
    from adaptsize.metrics.layers import metric_from_layers
    from adaptsize.metrics.limit import limit_metric
    from adaptsize.metrics.metric import Metric

_HOMES = {
    "metric_from_curvature": "curvature",
    "MetricFunction": "function",
    "metric_from_hessian": "hessian",
    "metric_from_layers": "layers",
    "limit_metric": "limit",
    "Metric": "metric",
}

__all__ = [
    "Metric",
    "MetricFunction",
    "limit_metric",
    "metric_from_curvature",
    "metric_from_hessian",
    "metric_from_layers",
]

__getattr__, __dir__ = lazily(__name__, _HOMES)
