"""The input of the limiting schemes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.periodic import Periodicity
from adaptsize.typing import FloatArray, ProgressCallback


class PointBounds(NamedTuple):
    """Bounds at points that need not be nodes, transformed like ``h0``."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""


@dataclass(frozen=True)
class Problem:
    """Checked arguments; sizes are transformed where g depends on them (see `SizeTransform`)."""

    h0: FloatArray
    slope: Slope
    order: int
    floor: bool
    initial: FloatArray | None
    """Start of an iteration, transformed like ``h0``."""
    tol: float
    max_iter: int | None
    face_sources: bool
    threads: int | None
    point_sources: PointBounds | None
    report: ProgressCallback
    periodicity: Periodicity | None = None
