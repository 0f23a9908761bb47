"""Warnings of what a new mesh lacks: fields, and elements that were requested."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptsize._checks import warn_caller
from adaptsize._defaults import is_of_sizes
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.errors import InputWarning, ResolutionWarning
from adaptsize.quality.by_place import RequestedElements
from adaptsize.quality.connections import are_doubtful, unconnected
from adaptsize.quality.requests import unserved
from adaptsize.remeshing.sizing import MetricAt, Size

#: Warnings of one mesh.
_MOST = 5


def without_fields(mesh: SimplexMesh) -> SimplexMesh:
    """Return a mesh without fields, and warn of those that the new mesh will lack.

    Warns
    -----
    InputWarning
        If there are fields other than the sizes for which a mesh was made.
    """
    names = [name for name in (*mesh.point_data, *mesh.cell_data) if not is_of_sizes(name)]
    if names:
        warn_caller(
            f"the new mesh is without the fields {', '.join(names)}: transfer_fields(old, new, "
            "fields=..., cell_fields=...) returns them there, and adapt transfers its fields",
            InputWarning,
        )
    return mesh.without_data()


def warn_of_unconnected(mesh: SimplexMesh) -> None:
    """Warn of cells side by side that are not connected, other than those at slits.

    Warns
    -----
    InputWarning
        With their number and the first place.
    """
    for found in are_doubtful(unconnected(mesh)):
        warn_caller(f"{found}; the mesh keeps this", InputWarning)


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
