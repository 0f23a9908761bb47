"""Sources inside a solid that is given by its surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from adaptsize._checks import as_sizes
from adaptsize._kernels.inside import find_weights
from adaptsize._workers import Workers
from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.field import ExactField, Points, entries_at
from adaptsize.limiting.inside import InnerSource
from adaptsize.sizes.sources import (
    BallSource,
    BoxSource,
    CurveSource,
    PointSource,
    SizeOfPoint,
    Source,
)
from adaptsize.typing import FloatArray, IntArray

#: Samples along the longest side of a box, or the diameter of a ball.
_PER_SIDE = 5


@dataclass(frozen=True, eq=False)
class InnerLine:
    """Sizes at points, and linear along the segments between some of them."""

    points: FloatArray
    sizes: FloatArray
    segments: IntArray
    """int32[k, 2]"""
    grows: ClassVar[bool] = True

    @cached_property
    def _field(self) -> ExactField:
        nodes = np.full((len(self.points) + len(self.segments), 3), -1, np.int32)
        nodes[: len(self.points), 0] = np.arange(len(self.points))
        nodes[len(self.points) :, :2] = self.segments
        return ExactField(0.0, None, True, [entries_at(self.points, self.sizes, nodes)])

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return for each point the place from which the least size grows, and the size there."""
        field = replace(self._field, g=g)
        order = Points(points, along_curve(points), np.full(len(points), -1, np.int32))
        bound = np.full(len(points), np.inf)
        source = field.lowered(order, bound, Workers(1))[1]
        weights = np.empty((len(points), 3))
        find_weights(field.table, source, points, g, weights)
        vertices = field.nodes[source]
        of_vertices = np.where(vertices < 0, 0.0, self.sizes[vertices])
        places = np.einsum("ij,ijk->ik", weights, self.points[np.where(vertices < 0, 0, vertices)])
        return places, np.einsum("ij,ij->i", weights, of_vertices)

    def clipped(self, lower: float, upper: float) -> InnerLine:
        """Return the source with sizes clipped to two bounds."""
        return replace(self, sizes=np.clip(self.sizes, lower, upper))

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small."""
        middles = self.points[self.segments].mean(axis=1)
        return np.concatenate([self.points, middles])


@dataclass(frozen=True, eq=False)
class InnerBox:
    """A size in a box."""

    lower: FloatArray
    upper: FloatArray
    size: float
    grows: ClassVar[bool] = True

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return for each point the closest place in the box, and the size."""
        return np.clip(points, self.lower, self.upper), np.full(len(points), self.size)

    def clipped(self, lower: float, upper: float) -> InnerBox:
        """Return the source with its size clipped to two bounds."""
        return replace(self, size=float(np.clip(self.size, lower, upper)))

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small: a grid."""
        axes = [np.linspace(a, b, _PER_SIDE) for a, b in zip(self.lower, self.upper, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class InnerBall:
    """A size in a ball."""

    centre: FloatArray
    radius: float
    size: float
    grows: ClassVar[bool] = True

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return for each point the closest place in the ball, and the size."""
        away = points - self.centre
        distance = np.linalg.norm(away, axis=1)
        share = np.minimum(1.0, self.radius / np.maximum(distance, 1e-300))
        return self.centre + share[:, None] * away, np.full(len(points), self.size)

    def clipped(self, lower: float, upper: float) -> InnerBall:
        """Return the source with its size clipped to two bounds."""
        return replace(self, size=float(np.clip(self.size, lower, upper)))

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small: a grid."""
        box = InnerBox(self.centre - self.radius, self.centre + self.radius, self.size).samples
        return box[np.linalg.norm(box - self.centre, axis=1) <= self.radius * (1.0 + 1e-9)]


@dataclass(frozen=True, eq=False)
class InnerFunction:
    """The sizes that a function of points returns."""

    function: SizeOfPoint
    limits: tuple[float, float] = (0.0, np.inf)
    grows: ClassVar[bool] = False

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return the points, and the sizes there."""
        sizes = as_sizes("size(points)", self.function(points.copy()), (len(points),))
        return points.copy(), np.clip(sizes, *self.limits)

    def clipped(self, lower: float, upper: float) -> InnerFunction:
        """Return the source with sizes clipped to two bounds."""
        low, high = self.limits
        return replace(self, limits=(max(low, lower), min(max(high, lower), upper)))

    @property
    def samples(self) -> FloatArray:
        """No place where the size is small is known."""
        return np.empty((0, 3))


def inner_sources(sources: Sequence[Any]) -> tuple[InnerSource, ...]:
    """Return the sources that act inside a solid, and not only at nodes of its surface."""
    return tuple(_inner(source) for source in sources if _is_inner(source))


def at_nodes_only(sources: Sequence[Any]) -> list[Any]:
    """Return the sources that are known at the nodes of a surface: the others, and functions."""
    return [source for source in sources if not isinstance(source, _PLACED)]


#: Sources that have a place in space.
_PLACED = (PointSource, CurveSource, BoxSource, BallSource)


def _is_inner(source: Any) -> bool:
    return isinstance(source, _PLACED) or not isinstance(source, Source)


def _inner(source: Any) -> InnerSource:
    if isinstance(source, PointSource):
        return InnerLine(*source.rows(3), np.empty((0, 2), np.int32))
    if isinstance(source, CurveSource):
        return InnerLine(*source.rows(3), source.segments(3).cells)
    if isinstance(source, BoxSource):
        return InnerBox(*source.corners(3), float(source.size))
    if isinstance(source, BallSource):
        return InnerBall(source.middle(3), float(source.radius), float(source.size))
    return InnerFunction(source)
