"""Exact limiting: the size at each node directly from the visible bounds."""

from adaptsize.limiting.exact.convex import limit_points
from adaptsize.limiting.exact.scheme import Exact
from adaptsize.limiting.exact.solution import ExactSolution

__all__ = ["Exact", "ExactSolution", "limit_points"]
