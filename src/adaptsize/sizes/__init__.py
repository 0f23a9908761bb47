"""Upper bounds on the size, one nodal array per cause; inf where there is no bound."""

from adaptsize.sizes.by_sources import size_from_sources
from adaptsize.sizes.curvature import size_from_curvature
from adaptsize.sizes.error import size_from_error, size_from_hessian
from adaptsize.sizes.feature import size_from_feature
from adaptsize.sizes.prediction import Enclosed, predict
from adaptsize.sizes.recovery import recovered_gradient, recovered_hessian, zz_indicator
from adaptsize.sizes.separation import size_from_separation
from adaptsize.sizes.sources import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
)

__all__ = [
    "BallSource",
    "BoundarySource",
    "BoxSource",
    "CurveSource",
    "Enclosed",
    "PointSource",
    "RegionSource",
    "predict",
    "recovered_gradient",
    "recovered_hessian",
    "size_from_curvature",
    "size_from_error",
    "size_from_feature",
    "size_from_hessian",
    "size_from_separation",
    "size_from_sources",
    "zz_indicator",
]
