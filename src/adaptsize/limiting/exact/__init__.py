"""Exact limiting: the size at each node straight from the bounds that it sees."""

from adaptsize.limiting.exact.api import ExactSolution, solve_exact, solve_exact_again

__all__ = ["ExactSolution", "solve_exact", "solve_exact_again"]
