"""Exact limiting: the size at each node directly from the visible bounds."""

from adaptsize.limiting.exact.api import ExactSolution, solve_exact, solve_exact_again

__all__ = ["ExactSolution", "solve_exact", "solve_exact_again"]
