"""The arguments of `limit_gradient`, checked."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_points,
    as_sizes,
    as_whole_number,
    check_type,
    describe,
)
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting.problem import PointBounds
from adaptsize.typing import FloatArray


def as_domain(
    background: SimplexMesh | CartesianGrid | Octree,
) -> SimplexMesh | CartesianGrid:
    """Return the mesh or grid that the schemes run on."""
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    return background.mesh if isinstance(background, Octree) else background


def as_bound(
    name: str, sizes: npt.ArrayLike, background: SimplexMesh | CartesianGrid | Octree
) -> FloatArray:
    """Return checked nodal sizes, inf at inactive nodes; one number is used for all nodes."""
    given = as_float_array(name, sizes)
    if given.ndim == 0:
        given = np.full(background.nodal_shape, as_sizes(name, given, ()))
    if isinstance(background, CartesianGrid) and background.active is not None:
        given = as_float_array(name, given, background.shape)
        given = np.where(background.active, given, np.inf)
    return as_sizes(name, given, background.nodal_shape)


def as_count(name: str, value: object) -> int | None:
    """Return a number of steps or threads, or None."""
    if value is None:
        return None
    return as_whole_number(name, value, lower=1, upper=2**53)


def as_point_bounds(given: tuple[npt.ArrayLike, npt.ArrayLike], dim: int) -> PointBounds:
    """Return checked bounds at points."""
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise ValueError(f"point_sources must be a pair (points, sizes), got {describe(given)}")
    points = as_points("point_sources[0]", given[0], dim)
    return PointBounds(points, as_sizes("point_sources[1]", given[1], (len(points),)))
