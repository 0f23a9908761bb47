"""`Solution`: the result of a scheme."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one scheme; its arrays are not modified afterwards."""

    h: FloatArray
    iterations: int
    missed_by: float | Callable[[], float]
    """The residual, or a function that computes it."""
    unfinished: str = ""
    """Message for the user if the scheme stopped before convergence; empty if it converged."""

    @property
    def converged(self) -> bool:
        """Whether the scheme converged."""
        return not self.unfinished

    @cached_property
    def residual(self) -> float:
        """Residual of the discrete equations of the scheme."""
        return self.missed_by() if callable(self.missed_by) else self.missed_by


def relative_to_largest(excess: float, h: FloatArray) -> float:
    """Return an excess of sizes relative to the largest finite one; 0 if there is no excess.

    With g(h) the smallest transformed size is 0.  If all bounds are equal, the largest is 0 too.
    """
    if excess <= 0.0:
        return 0.0
    return excess / float(h[np.isfinite(h)].max())
