"""Sizes for a number of elements, from bounds that depend on a scale, with a limited gradient.

Limiting takes longer than all else.  If the scale changes a little, sizes come along the same paths
from the same nodes, and change as the bounds there do.  So the number for another scale is known
from the paths of one limit, and the next limit has it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptsize.background import AnyMesh, PartitionedMesh
from adaptsize.limiting import limit_gradient
from adaptsize.sizes.budget import count_elements
from adaptsize.sizes.search import ACCURACY_OF_SCALE, Search, search_of_scale
from adaptsize.typing import FloatArray, GradientLimit, IntArray

# Predictions after each limit at most.  One is enough if the last scale is near.
_PREDICTIONS = 4

#: Takes sizes and their number of simplices, and returns another number.
Corrected: TypeAlias = Callable[[FloatArray, float], float]


class Limited(NamedTuple):
    """Bounds at nodes, and the sizes within them whose gradient is limited."""

    bound: FloatArray
    h: FloatArray
    roots: IntArray | None
    """int32[n_points]: the node from whose bound each size comes, -1 if from none; None if that is
    not known."""

    @classmethod
    def free(cls, bound: FloatArray) -> Limited:
        """Return bounds as sizes, whose gradient is not limited."""
        return cls(bound, bound, np.arange(len(bound), dtype=np.int32))

    def near(self, bound: FloatArray) -> FloatArray | None:
        """Return the sizes within slightly different bounds, None if the paths are not known."""
        if self.roots is None:
            return None
        with np.errstate(invalid="ignore"):  # inf - inf
            change = np.where(self.roots < 0, 0.0, (bound - self.bound)[self.roots])
        return np.fmin(bound, self.h + change)


class Limit(NamedTuple):
    """How sizes are bounded and limited."""

    bounded: Callable[[FloatArray], FloatArray]
    """Returns sizes within all bounds."""
    limited: Callable[[FloatArray], Limited]
    """Limits their gradient."""

    def __call__(self, h: FloatArray) -> FloatArray:
        """Apply bounds and limits."""
        return self.limited(self.bounded(h)).h


def limited(
    mesh: AnyMesh, bound: FloatArray, g: GradientLimit, periodic: FloatArray | None = None
) -> Limited:
    """Return the largest sizes within bounds whose gradient is limited; collective."""
    if isinstance(mesh, PartitionedMesh):
        return Limited(bound, limit_gradient(mesh, bound, g), None)
    h, info = limit_gradient.with_info(mesh, bound, g, periodic=periodic)
    sources = info.sources
    if sources is None or sources.transform is not None:
        return Limited(bound, h, None)
    return Limited(bound, h, sources.roots())


def sizes_for_number(
    mesh: AnyMesh,
    number: float,
    sizes: Callable[[float], FloatArray],
    limit: Limit,
    start: float,
    accuracy: float = ACCURACY_OF_SCALE,
    *,
    bounds: tuple[float, float] = (0.0, math.inf),
    corrected: Corrected | None = None,
) -> FloatArray:
    """Return limited sizes of a number of regular simplices, or of the nearest one; collective.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
    number : float
    sizes : callable
        Returns the sizes at the nodes for a positive scale, which they grow with.
    limit : Limit
    start : float
        Scale near the result.
    accuracy : float
        Logarithm of the number over the wanted one that is accepted.
    bounds : (float, float)
        The sizes are the same for all scales below the first, and above the second.
    corrected : callable, optional
        Takes sizes of about the number, if there are such, and theirs, and returns the number to be
        wanted instead.
    """
    search: Search[FloatArray] = search_of_scale(number, mesh.cell_dim, start, accuracy, bounds)
    while (factor := search.factor) is not None:
        found = limit.limited(limit.bounded(sizes(factor)))
        search.add(count_elements(mesh, found.h), found.h)
        about = _predicted(mesh, search, found, lambda scale: limit.bounded(sizes(scale)))
        if corrected is not None and about is not None:
            search, corrected = search.for_other(corrected(*about)), None
    return search.best.result


def _predicted(
    mesh: AnyMesh,
    search: Search[FloatArray],
    found: Limited,
    bounds_at: Callable[[float], FloatArray],
) -> tuple[FloatArray, float] | None:
    """Return sizes of about the wanted number on the paths of the last ones, and their number.

    None if there are none, or the paths are not known.  The next factor of the search is that for
    which the number is predicted.
    """
    sizes, number = found.h, search.trials[-1].number
    for _ in range(_PREDICTIONS):
        if search.factor is None:
            break
        near = found.near(bounds_at(search.factor))
        if near is None:
            return None
        sizes, number = near, count_elements(mesh, near)
        search.expect(number)
        if search.is_about(number):
            break
    return (sizes, number) if search.is_about(number) else None
