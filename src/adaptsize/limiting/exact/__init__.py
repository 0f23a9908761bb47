"""Exact limiting: the size at each node directly from the visible bounds."""

from adaptsize.limiting.exact.scheme import Exact, ExactSolution, limit_points

__all__ = ["Exact", "ExactSolution", "limit_points"]
