"""What every scheme returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one scheme; its arrays are not written into afterwards."""

    h: FloatArray
    iterations: int
    missed_by: float | Callable[[], float]
    """The residual, or how to find it."""
    unfinished: str = ""
    """Why the scheme stopped before it had converged, as a text for the user; empty if it has."""
    memory: Any = None
    """What the scheme wants back when it is to solve a problem that differs little."""

    @property
    def converged(self) -> bool:
        """Whether the scheme came to its end."""
        return not self.unfinished

    @cached_property
    def residual(self) -> float:
        """By how much the scheme's own equation is missed."""
        return self.missed_by() if callable(self.missed_by) else self.missed_by


def relative_to_largest(excess: float, h: FloatArray) -> float:
    """Return an excess of sizes relative to the largest finite one; 0 if there is no excess.

    With g(h) sizes are transformed so that the smallest is 0; if all bounds are equal, so is the
    largest.
    """
    if excess <= 0.0:
        return 0.0
    return excess / float(h[np.isfinite(h)].max())
