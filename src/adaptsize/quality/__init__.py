"""Mesh quality, and conformity of a mesh with a size function."""

from adaptsize.quality.conformity import Conformity, RatioStatistics, SizeLike, size_conformity
from adaptsize.quality.elements import minimum_angles, radius_ratios
from adaptsize.quality.summary import MeshSummary, summarize

__all__ = [
    "Conformity",
    "MeshSummary",
    "RatioStatistics",
    "SizeLike",
    "minimum_angles",
    "radius_ratios",
    "size_conformity",
    "summarize",
]
