"""Reports on a mesh: the comparison with the request, and a page to look at."""

from adaptsize.reporting.api import report

__all__ = ["report"]
