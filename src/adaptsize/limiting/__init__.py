"""The largest h <= h0 with |grad h| <= g."""

from adaptsize.limiting.api import limit_gradient
from adaptsize.limiting.solution import LimitingInfo

__all__ = ["LimitingInfo", "limit_gradient"]
