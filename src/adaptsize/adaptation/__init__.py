"""One turn of an adaptive loop: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.turn import AdaptResult, adapt

__all__ = ["AdaptReport", "AdaptResult", "adapt"]
