"""Local feature size on a Cartesian grid, from the medial axis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid
from adaptsize.geometry.marching import march_distance
from adaptsize.geometry.medial_axis import MedialAxis, _checked_distance, medial_axis
from adaptsize.typing import FloatArray, ProgressCallback


def feature_size(
    grid: CartesianGrid,
    phi: npt.ArrayLike,
    medial: MedialAxis | None = None,
    *,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    """Return the local feature size |phi| + |phi_MA| inside, inf outside."""
    values = _checked_distance(grid, phi)
    if medial is None:
        medial = medial_axis(grid, values, progress=progress)
    inside = values <= 0.0
    if grid.active is not None:
        inside &= grid.active
    with reporting(progress) as report:
        to_axis = march_distance(
            grid, medial.distances, where=inside, report=report, text="marching from the axis"
        )
    return np.where(inside, np.abs(values) + to_axis, np.inf)
