"""Sizes of a periodic domain, limited across its sides."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.domain_size import tuning
from adaptsize.domain_size.reports import report_of
from adaptsize.limiting.periodic import as_periodicity, combined, inverse, moved
from adaptsize.remeshing.preparation import repair_mesh
from adaptsize.sizes import PointSource
from adaptsize.typing import FloatArray


def limited_across_sides(
    mesh: SimplexMesh,
    motions: npt.ArrayLike,
    compute: Callable[..., SizeFunction],
    given: Mapping[str, Any],
) -> SizeFunction:
    """Return sizes that are about the same at places on sides that are images of each other.

    Smaller sizes on one side act as sources on the opposite side, so that gradients are limited
    across it, the cells there are divided as the sizes need, and elements are counted with them.
    The nodes of the sizes need not match: cells are divided on one side only, where a detail is
    near to it.

    Parameters
    ----------
    mesh : SimplexMesh
    motions : array_like of float, shape (k, dim) or (k, dim, dim + 1)
        Translations or rotations, see `limit_gradient`.
    compute : callable
        Takes arguments of `size_function` and returns the sizes.
    given : mapping
        These arguments.
    """
    cell = as_periodicity(repair_mesh(mesh).mesh, motions)
    there = [whole for _, whole in combined(cell.maps)]
    maps = [*there, *map(inverse, there)]
    size, sources = compute(**given), list(given.get("sources") or ())
    for _ in range(tuning.MOST_TIMES_ACROSS):
        found = [one for whole in maps if (one := _lower_images(mesh, size, whole)) is not None]
        if not found:
            break
        sources += found
        size = compute(**{**given, "sources": sources})
    return size


def _lower_images(mesh: SimplexMesh, size: SizeFunction, motion: FloatArray) -> PointSource | None:
    """Return the sizes of the sides at their images, where they are smaller than those there."""
    skin = mesh.boundary().mesh
    places = _places_on(skin, size)
    cells, weights, away = skin.locator.nearest(moved(motion, places))
    on_skin = away <= tuning.ON_SIDE * mesh.diagonal
    corners = skin.points[skin.cells[cells[on_skin]]]
    images = np.einsum("nv,nvd->nd", weights[on_skin], corners)
    there, wanted = size(images), size(places[on_skin])
    lower = wanted < (1.0 - tuning.SAME_ACROSS) * there
    return PointSource(images[lower], wanted[lower]) if lower.any() else None


def _places_on(skin: SimplexMesh, size: SizeFunction) -> FloatArray:
    """Return points of a boundary about as close to each other as the sizes there."""
    nodes = size.background.points
    near = skin.locator.nearest(nodes)[2] <= tuning.ON_SIDE * skin.diagonal
    fine = resolved(
        skin, size, g=report_of(size).g, is_proved=False, samples=nodes[near], factor=1.0,
        max_points=tuning.MOST_PLACES_ON_SIDES,
    )  # fmt: skip
    return fine.mesh.points
