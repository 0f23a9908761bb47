"""Coordinates in which a part has the diagonal 1 and its middle at the origin.

Generators work with absolute coordinates and tolerances.  Far from the origin they lose digits, and
of parts of size 1e-6 they return nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.metrics import Metric
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.tensors import MetricAt
from adaptsize.typing import FloatArray

#: Generators that scale their input move nodes that they keep by rounding, by less than this.
_NOT_MOVED = 1e-13


class Frame(NamedTuple):
    """The middle and the scale of a part."""

    origin: FloatArray
    """float64[dim]"""
    scale: float
    """Length of the diagonal of its bounding box."""

    @classmethod
    def around(cls, mesh: SimplexMesh) -> Frame:
        """Return the frame of a mesh."""
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        scale = float(np.linalg.norm(high - low))
        return cls(low + 0.5 * (high - low), scale if scale > 0.0 else 1.0)

    def to_own(self, points: FloatArray) -> FloatArray:
        """Return points in the coordinates of the part."""
        return (points - self.origin) / self.scale

    def from_own(self, points: FloatArray) -> FloatArray:
        """Return points in the given coordinates."""
        return self.origin + self.scale * points

    def mesh(self, mesh: SimplexMesh) -> SimplexMesh:
        """Return a mesh in the coordinates of the part, without fields."""
        return _with_points(mesh, self.to_own(mesh.points))

    def size(self, size: Size) -> Size:
        """Return a size as a function of points in the coordinates of the part."""

        def own(points: FloatArray) -> FloatArray:
            return size(self.from_own(points)) / self.scale

        return own

    def metric(self, metric: MetricAt) -> MetricAt:
        """Return a metric as a function of points in the coordinates of the part."""

        def own(points: FloatArray) -> Metric:
            return metric(self.from_own(points)).scaled(1.0 / self.scale)

        return own

    def restored(self, new: SimplexMesh, old: SimplexMesh) -> SimplexMesh:
        """Return a mesh in the given coordinates; nodes that have not moved are exactly those."""
        from scipy.spatial import cKDTree

        points = self.from_own(new.points)
        tree = cKDTree(self.to_own(old.points))
        distance, number = tree.query(new.points, distance_upper_bound=_NOT_MOVED)
        kept = np.isfinite(distance)
        points[kept] = old.points[number[kept]]
        return _with_points(new, points)


def _with_points(mesh: SimplexMesh, points: FloatArray) -> SimplexMesh:
    return SimplexMesh(
        points,
        mesh.cells,
        cell_tags=mesh.cell_tags,
        tagged_facets=mesh.tagged_facets,
        facet_tags=mesh.facet_tags,
        tag_names=mesh.tag_names,
    )
