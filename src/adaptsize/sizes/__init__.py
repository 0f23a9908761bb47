"""Upper bounds on the size, one nodal array per cause; inf where nothing is asked."""

from adaptsize.sizes.combine import minimum
from adaptsize.sizes.curvature import size_from_curvature
from adaptsize.sizes.feature import size_from_feature
from adaptsize.sizes.sources import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
    Source,
    size_from_sources,
)

__all__ = [
    "BallSource",
    "BoundarySource",
    "BoxSource",
    "CurveSource",
    "PointSource",
    "RegionSource",
    "Source",
    "minimum",
    "size_from_curvature",
    "size_from_feature",
    "size_from_sources",
]
