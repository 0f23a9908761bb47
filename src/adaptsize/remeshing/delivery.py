"""Warnings of elements that were requested and not made."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptsize._checks import warn_caller
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.errors import ResolutionWarning
from adaptsize.quality.by_place import RequestedElements
from adaptsize.quality.requests import unserved
from adaptsize.remeshing.sizing import MetricAt, Size

#: Warnings of one mesh.
_MOST = 5


def delivered(
    new: SimplexMesh, size: Any, wanted: Size, old: SimplexMesh, metric: MetricAt | None
) -> SimplexMesh:
    """Return a mesh, and warn of the requests of which less than 80 % was served.

    Parameters
    ----------
    new : SimplexMesh
    size : SizeFunction, callable, float64[n_points] or float
        As given to `remesh`.
    wanted : callable
        The same, checked.
    old : SimplexMesh
        The mesh of nodal sizes.
    metric : callable or None
        If sizes depend on the direction, they are not compared.

    Warns
    -----
    ResolutionWarning
        For each of the worst requests: what is missing, where, and what helps.
    """
    if metric is not None:
        return new
    if np.ndim(size) == 1 and not callable(size) and old.cell_dim == old.dim:
        size = SizeFunction(old, size)
    elif not isinstance(size, SizeFunction):
        size = wanted
    found = unserved(RequestedElements.of(new, size), size)
    for one in found[:_MOST]:
        warn_caller(str(one), ResolutionWarning)
    return new
