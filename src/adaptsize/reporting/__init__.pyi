"""The names of `adaptsize.reporting` for type checkers; tests/test_types.py writes this file."""

from adaptsize.reporting.page import report as report

__all__ = [
    "report",
]
