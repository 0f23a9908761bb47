"""What every scheme returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one scheme; its arrays are not written into afterwards."""

    h: FloatArray
    iterations: int
    missed_by: float | Callable[[], float]
    """The residual, or how to find it."""
    converged: bool = True
    memory: Any = None
    """What the scheme wants back when it is to solve a problem that differs little."""

    @cached_property
    def residual(self) -> float:
        """By how much the scheme's own equation is missed."""
        return self.missed_by() if callable(self.missed_by) else self.missed_by
