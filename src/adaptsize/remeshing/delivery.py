"""Warnings of what a new mesh lacks: fields, and elements that were requested."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptsize._checks import place_text, warn_caller
from adaptsize._defaults import is_of_sizes
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.errors import ConnectionWarning, InputWarning, ResolutionWarning
from adaptsize.quality.by_place import RequestedElements
from adaptsize.quality.connections import are_doubtful, unconnected
from adaptsize.quality.layers import first_layer
from adaptsize.quality.requests import unserved
from adaptsize.remeshing import tuning
from adaptsize.remeshing.sizing import MetricAt, Size


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
    # What was found of the mesh is kept with it, for the next mesh that is made of it.
    return mesh.without_data() if mesh.point_data or mesh.cell_data else mesh


def warn_of_unconnected(mesh: SimplexMesh) -> None:
    """Warn of cells side by side that are not connected, other than those at slits.

    Warns
    -----
    InputWarning
        With their number and the first place.
    """
    for found in are_doubtful(unconnected(mesh)):
        warn_caller(f"{found}; the mesh keeps this", ConnectionWarning)


def warn_of_details(new: SimplexMesh, size: Size) -> None:
    """Warn of edges of the boundary in the plane that details keep far below their size.

    Warns
    -----
    ResolutionWarning
        With the number and the places of the worst.
    """
    boundary = new.boundary().mesh
    middles = boundary.points[boundary.cells].mean(axis=1)
    ratio = boundary.measures / size(middles)
    short = np.flatnonzero(ratio < tuning.DETAIL)
    if len(short) < tuning.FEW_DETAILS:
        return
    worst = short[np.argsort(ratio[short], kind="stable")[:3]]
    places = ", ".join(place_text(middles[k], 4) for k in worst)
    warn_caller(
        Message(
            "{} edges of the boundary are shorter than an eighth of their size, down to {:.3g}, "
            "the worst at {}: details of the boundary are smaller than the sizes, and are kept; "
            "{least_width} of polygons leaves them out",
            *(len(short), boundary.measures[worst[0]], places),
        ),
        ResolutionWarning,
    )


def warn_of_metric(
    new: SimplexMesh,
    metric: MetricAt,
    on: SimplexMesh | None,
    served: RequestedElements | None = None,
) -> None:
    """Warn of what a mesh lacks of a metric; ``on`` is the mesh at whose nodes it is given.

    ``served`` is how the mesh serves it, if that is known.

    Warns
    -----
    ResolutionWarning
        If more than 20 % of the requested elements are missing, because cells are too large.  If
        the first layer on a wall is not as high as requested.
    """
    if served is None:
        served = RequestedElements.of_metric(new, metric, on, tuning.SAMPLE)
    found = unserved(served, metric)
    finest = tuning.FINEST["plane triangles"]
    for one in found:
        text = one.missing + (
            "; a mesh that is finer there, a metric that grows more slowly, or larger least sizes "
            f"help: generators reach about {finest:g} of the domain in the plane"
        )
        warn_caller(text, ResolutionWarning)
    layer = first_layer(new, metric)
    if not found and layer is not None and layer.share < tuning.SHARE_OF_WALL:
        warn_caller(str(layer), ResolutionWarning)


def warn_of_lacks(new: SimplexMesh, size: Any, wanted: Size, old: SimplexMesh) -> RequestedElements:
    """Warn of requests that a mesh does not serve, and of details that were kept.

    Parameters
    ----------
    new : SimplexMesh
    size : SizeFunction, callable, float64[n_points] or float
        As given to `remesh`.
    wanted : callable
        The same, checked.
    old : SimplexMesh
        The mesh of nodal sizes.

    Returns
    -------
    RequestedElements
        Those at the places of the new mesh.

    Warns
    -----
    ResolutionWarning
        For each of the worst requests: what is missing, where, and what helps.  Of edges of a plane
        boundary that are much shorter than their size.
    """
    if np.ndim(size) == 1 and not callable(size) and old.cell_dim == old.dim:
        size = SizeFunction(old, size)
    elif not isinstance(size, SizeFunction):
        size = wanted
    if new.dim == new.cell_dim == 2:
        warn_of_details(new, wanted)
    elements = RequestedElements.of(new, size)
    found = unserved(elements, size)
    for one in found[: tuning.MOST_WARNINGS]:
        warn_caller(str(one), ResolutionWarning)
    return elements
