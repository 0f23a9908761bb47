"""Mesh quality, and conformity of a mesh with a size function."""

from adaptsize.quality.certificate import Demand, MeshCheck, Place, check_mesh
from adaptsize.quality.conformity import Conformity, RatioStatistics, SizeLike, size_conformity
from adaptsize.quality.elements import minimum_angles, radius_ratios
from adaptsize.quality.metric import MetricQuality, metric_qualities
from adaptsize.quality.summary import MeshSummary, summarize

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
