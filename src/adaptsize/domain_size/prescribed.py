"""Bounds that do not depend on the shape: sources, and upper bounds from elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._causes import SOURCES, Cause
from adaptsize._checks import as_sizes
from adaptsize.background import AnyBackground, CartesianGrid
from adaptsize.sizes import PointSource, size_from_sources
from adaptsize.sizes.sources import KNOWN
from adaptsize.typing import FloatArray

Implicit: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
#: Bounds at points between the nodes: their cause, float64[k, dim] and float64[k].
BoundsByCause: TypeAlias = Sequence[tuple[Cause, FloatArray, FloatArray]]


def bounds_at_points(sources: Iterable[Any], dim: int) -> BoundsByCause:
    """Return the positions and sizes of the point sources."""
    given = [source for source in sources if isinstance(source, PointSource)]
    return [(SOURCES, *source.rows(dim)) for source in given]


def bounds_by_sources(
    background: AnyBackground, sources: Sequence[Any], g: float
) -> dict[Cause, FloatArray]:
    """Return the bound from sources at the nodes; none without sources."""
    return {SOURCES: size_from_sources(background, sources, g=g)} if len(sources) else {}


def least_size(sources: Iterable[Any], size_of: Mapping[str, float] | None) -> float:
    """Return the smallest of the sizes that are numbers; inf without any."""
    sizes = [source.size for source in sources if isinstance(source, KNOWN)]
    least = [float(np.min(size, initial=np.inf)) for size in [*sizes, *(size_of or {}).values()]]
    return min(least, default=np.inf)


def bound_at_nodes(h0: npt.ArrayLike | Implicit, background: AnyBackground) -> FloatArray:
    """Return upper bounds at the nodes of a background, from an array or a function of points."""
    if not callable(h0):
        return as_sizes("h0", h0, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return as_sizes("h0", background.sample(h0), background.shape)
    return as_sizes("h0", h0(background.points), background.nodal_shape)
