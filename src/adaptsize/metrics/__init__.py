"""Anisotropic sizes: metrics, their limits, and their gradient limiting."""

from adaptsize.metrics.curvature import metric_from_curvature
from adaptsize.metrics.function import MetricFunction
from adaptsize.metrics.hessian import metric_from_hessian, predicted_simplices
from adaptsize.metrics.implied import implied_metric
from adaptsize.metrics.isotropic import isotropic_metric
from adaptsize.metrics.layers import metric_from_layers
from adaptsize.metrics.limit import MetricLimitingInfo, limit_metric
from adaptsize.metrics.metric import Metric

__all__ = [
    "Metric",
    "MetricFunction",
    "MetricLimitingInfo",
    "implied_metric",
    "isotropic_metric",
    "limit_metric",
    "metric_from_curvature",
    "metric_from_hessian",
    "metric_from_layers",
    "predicted_simplices",
]
