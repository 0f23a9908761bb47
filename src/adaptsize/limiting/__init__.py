"""Gradient limiting: the largest h <= h0 with |grad h| <= g."""

from adaptsize.limiting.api import limit_gradient
from adaptsize.limiting.info import LimitingInfo
from adaptsize.limiting.sources import SizeSources
from adaptsize.limiting.sphere import limit_on_sphere

__all__ = ["LimitingInfo", "SizeSources", "limit_gradient", "limit_on_sphere"]
