"""The signed distance to a surface or an outline, as a function of points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_near_points, as_points, describe
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import skin_of
from adaptsize.geometry.distance.orientation import winding_of
from adaptsize.geometry.distance.polygons import Polygons
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.typing import FloatArray

_Outline: TypeAlias = SimplexMesh | npt.ArrayLike | Sequence[npt.ArrayLike]


class SignedDistance:
    """Signed distance to a surface or an outline at any points, negative inside.

    `signed_distance` computes the distances of all nodes of a background.  An object of this
    class is a function: use it where a function of points is required, as in
    `mesh_from_distance`, or to set sizes by the distance from a coast, a wing or a fault.

    Parameters
    ----------
    boundary : SimplexMesh, array_like or sequence of array_like
        Triangles in space, segments in the plane, or a mesh of full dimension, whose boundary
        counts.  Or polygons in the plane, each float64[n, 2] with its corners in order.  A
        polygon is closed whether or not its last point repeats the first.  Holes are polygons
        too: a point is inside if an odd number of polygons contains it, in any orientation.

    Raises
    ------
    ValueError
        If the boundary is empty, of the wrong shape, or has coordinates that are not finite.

    Notes
    -----
    Distances are exact.  The sign of polygons is exact; that of meshes comes from winding
    numbers, which tolerate holes and defects.  A query takes O(log n) time per point for n
    facets.

    Examples
    --------
    >>> lake = SignedDistance([[(0, 0), (4, 0), (4, 2), (0, 2)], [(1, 0.5), (2, 0.5), (2, 1)]])
    >>> lake([[3.0, 1.0], [1.9, 0.6], [5.0, 1.0]]).round(3).tolist()
    [-1.0, 0.1, 1.0]
    """

    def __init__(self, boundary: _Outline) -> None:
        self._polygons: list[FloatArray] | None = None
        if not isinstance(boundary, SimplexMesh):
            self._polygons = _polygons(boundary)
            boundary = _segments(self._polygons)
        self._mesh = skin_of(boundary)[0]

    @property
    def mesh(self) -> SimplexMesh:
        """The boundary as a mesh of segments or triangles."""
        return self._mesh

    def __call__(self, points: npt.ArrayLike) -> FloatArray:
        """Return the signed distance of each point, float64[n]."""
        where = as_near_points("points", points, self.mesh.dim)
        distance = self.mesh.locator.nearest(where)[2]
        return np.where(self._domain.contains(where), -distance, distance)

    @cached_property
    def _domain(self) -> Polygons | WindingNumber:
        return winding_of(self.mesh)[0] if self._polygons is None else Polygons(self._polygons)

    def unsigned(self, points: npt.ArrayLike) -> FloatArray:
        """Return the distance of each point without a sign, float64[n], for instance to a coast."""
        return self.mesh.locator.nearest(as_near_points("points", points, self.mesh.dim))[2]

    def __repr__(self) -> str:
        """Return the number of facets."""
        return f"SignedDistance({self.mesh.n_cells} facets in {self.mesh.dim}-D)"


def _is_point(given: Any) -> bool:
    try:
        return np.ndim(given) == 1
    except ValueError:  # rows of different lengths, which are refused later
        return False


def _polygons(given: Any) -> list[FloatArray]:
    """Return the polygons without repeated last points; refuse what is not polygons."""
    is_flat = isinstance(given, str) or (isinstance(given, np.ndarray) and given.ndim == 0)
    if is_flat or not isinstance(given, Sequence | np.ndarray):
        raise ValueError(f"boundary must be a mesh or polygons, got {describe(given)}")
    if len(given) == 0:
        raise ValueError("boundary must have at least one polygon, got none")
    polygons: list[npt.ArrayLike] = [given] if _is_point(given[0]) else list(given)
    found = []
    for number, polygon in enumerate(polygons):
        corners = as_points(f"boundary[{number}]", polygon, 2)
        if len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
            corners = corners[:-1]
        if len(corners) < 3:
            raise ValueError(f"boundary[{number}] must have 3 corners or more, got {len(corners)}")
        found.append(corners)
    return found


def _segments(polygons: list[FloatArray]) -> SimplexMesh:
    pairs, first = [], 0
    for corners in polygons:
        number = np.arange(len(corners))
        pairs.append(first + np.stack([number, np.roll(number, -1)], axis=1))
        first += len(corners)
    return SimplexMesh(np.concatenate(polygons), np.concatenate(pairs))
