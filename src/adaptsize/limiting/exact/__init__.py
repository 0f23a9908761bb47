"""Exact limiting: the size at each node directly from the visible bounds."""

from adaptsize.limiting.exact.api import ExactSolution, limit_points, solve_exact, solve_exact_again

__all__ = ["ExactSolution", "limit_points", "solve_exact", "solve_exact_again"]
