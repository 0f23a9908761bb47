"""Anisotropic sizes: metrics, their limits, and their gradient limiting.

Names are imported on first use, since files need the classes only.
"""

from adaptsize._lazy import lazily

_HOMES = {
    "metric_from_curvature": "curvature",
    "MetricFunction": "function",
    "metric_from_hessian": "hessian",
    "metric_from_layers": "layers",
    "limit_metric": "limit",
    "Metric": "metric",
}

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
