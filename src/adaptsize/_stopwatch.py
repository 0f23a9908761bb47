"""The time that several meshes of one request have together."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class Stopwatch:
    """The time that all meshes of a request have together; it begins with the first."""

    limit: float | None
    """Seconds; None without a limit."""
    clock: Callable[[], float] = time.monotonic
    end: float | None = None
    """When the time is over; None before the first mesh."""

    @property
    def left(self) -> float:
        """Seconds that are left, inf without a limit."""
        if self.limit is None:
            return math.inf
        return self.limit if self.end is None else self.end - self.clock()

    @property
    def is_over(self) -> bool:
        """Whether no time is left for another mesh."""
        return self.left <= 0.0

    def for_next_mesh(self) -> float | None:
        """Return the time limit of the next mesh, > 0; None without one.  Starts the time."""
        if self.limit is None:
            return None
        left = self.left
        if self.end is None:
            self.end = self.clock() + self.limit
        return max(left, sys.float_info.min)
