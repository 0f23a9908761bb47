"""The names of `adaptsize.metrics` for type checkers; tests/test_types.py writes this file."""

from adaptsize.metrics.curvature import metric_from_curvature as metric_from_curvature
from adaptsize.metrics.function import MetricFunction as MetricFunction
from adaptsize.metrics.hessian import metric_from_hessian as metric_from_hessian
from adaptsize.metrics.layers import metric_from_layers as metric_from_layers
from adaptsize.metrics.limit import limit_metric as limit_metric
from adaptsize.metrics.metric import Metric as Metric

__all__ = [
    "Metric",
    "MetricFunction",
    "limit_metric",
    "metric_from_curvature",
    "metric_from_hessian",
    "metric_from_layers",
]
