"""A warning where a surface does not carry the size that a source inside the solid requests."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptsize._size_function import SizeFunction
from adaptsize.errors import OutsideWarning
from adaptsize.sizes.sources import BallSource, BoxSource, CurveSource, PointSource
from adaptsize.typing import FloatArray

#: Sizes up to this factor above the requested ones are near enough.
_NEAR = 1.2


def warn_where_missed(size: SizeFunction, sources: Sequence[Any], hmin: float) -> None:
    """Warn if the sizes of a solid, carried by its surface, miss those of a source off it.

    A surface has nodes only where the solid ends.  A source inside acts on the closest of these,
    and the size grows from there back to the source.  ``hmin``: sizes are not below it anywhere.
    """
    for source in sources:
        places, requested = _samples(source, size.background.dim)
        given = size(places)
        excess = given / np.maximum(requested, hmin)
        if len(excess) == 0 or excess.max() <= _NEAR:
            continue
        worst = int(np.argmax(excess))
        place = ", ".join(f"{x:.6g}" for x in places[worst])
        warnings.warn(
            f"{type(source).__name__} requests the size {requested[worst]:.4g} at ({place}), which "
            f"is off the surface, where the size is {given[worst]:.4g}: a surface carries sizes at "
            "its own nodes only; make tetrahedra first and compute their sizes with this source",
            OutsideWarning,
            stacklevel=4,
        )


def _samples(source: Any, dim: int) -> tuple[FloatArray, FloatArray]:
    """Return points where the size that a source requests is known, and these sizes."""
    if isinstance(source, PointSource | CurveSource):
        return source.rows(dim)
    if isinstance(source, BallSource):
        centre = np.asarray(source.centre, dtype=np.float64)
    elif isinstance(source, BoxSource):
        centre = 0.5 * np.add(source.lower, source.upper, dtype=np.float64)
    else:
        return np.empty((0, dim)), np.empty(0)
    return centre[None, :], np.array([source.size], dtype=np.float64)
