"""Mesh quality, and conformity of a mesh with a size function.

Names are imported on first use, since a summary needs little of it.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

if TYPE_CHECKING:
    from adaptsize.quality.certificate import Demand, MeshCheck, Place, check_mesh
    from adaptsize.quality.conformity import Conformity, RatioStatistics, SizeLike, size_conformity
    from adaptsize.quality.elements import minimum_angles, radius_ratios
    from adaptsize.quality.metric import MetricQuality, metric_qualities
    from adaptsize.quality.summary import MeshSummary, summarize

_HOMES = {
    "Demand": "certificate",
    "MeshCheck": "certificate",
    "Place": "certificate",
    "check_mesh": "certificate",
    "Conformity": "conformity",
    "RatioStatistics": "conformity",
    "SizeLike": "conformity",
    "size_conformity": "conformity",
    "minimum_angles": "elements",
    "radius_ratios": "elements",
    "MetricQuality": "metric",
    "metric_qualities": "metric",
    "MeshSummary": "summary",
    "summarize": "summary",
}

__all__ = [
    "Conformity",
    "Demand",
    "MeshCheck",
    "MeshSummary",
    "MetricQuality",
    "Place",
    "RatioStatistics",
    "SizeLike",
    "check_mesh",
    "metric_qualities",
    "minimum_angles",
    "radius_ratios",
    "size_conformity",
    "summarize",
]

__getattr__, __dir__ = lazily(__name__, _HOMES)
