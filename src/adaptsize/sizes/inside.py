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
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.geometry.distance.orientation import winding_of
from adaptsize.limiting.exact.field import ExactField, Points, entries_at
from adaptsize.limiting.inside import InnerSource
from adaptsize.sizes import tuning
from adaptsize.sizes.sources import (
    BallSource,
    BoxSource,
    CurveSource,
    PointSource,
    SizeOfPoint,
    Source,
)
from adaptsize.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class InnerLine:
    """Sizes at points, and linear along the segments between some of them."""

    points: FloatArray
    sizes: FloatArray
    segments: IntArray
    """int32[k, 2]"""
    is_graded: ClassVar[bool] = True

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
        find_weights(field.table, source, read_only(points), g, weights)
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
    is_graded: ClassVar[bool] = True

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return for each point the closest place in the box, and the size."""
        return np.clip(points, self.lower, self.upper), np.full(len(points), self.size)

    def clipped(self, lower: float, upper: float) -> InnerBox:
        """Return the source with its size clipped to two bounds."""
        return replace(self, size=float(np.clip(self.size, lower, upper)))

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small: a grid."""
        axes = [
            np.linspace(a, b, tuning.SAMPLES_PER_SIDE)
            for a, b in zip(self.lower, self.upper, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class InnerBall:
    """A size in a ball."""

    centre: FloatArray
    radius: float
    size: float
    is_graded: ClassVar[bool] = True

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
        within = np.linalg.norm(box - self.centre, axis=1) <= self.radius * (1.0 + 1e-9)
        return np.asarray(box[within])


@dataclass(frozen=True, eq=False)
class InnerFunction:
    """The sizes that a function of points returns, and what grows from samples of it."""

    function: SizeOfPoint
    known: InnerLine
    limits: tuple[float, float] = (0.0, np.inf)
    is_graded: ClassVar[bool] = False

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return the points and the sizes there, or the samples that allow smaller ones."""
        at, sizes = points.copy(), np.clip(_values(self.function, points), *self.limits)
        if len(self.known.points):
            places, found = self.known.aims(points, g)
            straight = found + g * np.linalg.norm(points - places, axis=1)
            better = straight < sizes
            at[better], sizes[better] = places[better], found[better]
        return at, sizes

    def clipped(self, lower: float, upper: float) -> InnerFunction:
        """Return the source with sizes clipped to two bounds."""
        low, high = self.limits
        limits = (max(low, lower), min(max(high, lower), upper))
        return replace(self, known=self.known.clipped(lower, upper), limits=limits)

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small."""
        return self.known.points


def _values(function: SizeOfPoint, points: FloatArray) -> FloatArray:
    sizes: FloatArray = as_sizes("size(points)", function(points.copy()), (len(points),))
    return sizes


def sampled(function: SizeOfPoint, surface: SimplexMesh, hmax: float) -> InnerFunction:
    """Return a function as a source inside a surface, sampled where it is below ``hmax``.

    A lattice over the box of the surface has 32 cells along the longest side.  Its cells are
    divided where they are longer than twice the size at their centres.
    """
    lower, upper = surface.points.min(axis=0), surface.points.max(axis=0)
    step = float((upper - lower).max()) / 32.0
    number = np.maximum(np.ceil((upper - lower) / step - 1e-9), 1.0).astype(int)
    points = lower + step * (np.indices(number).reshape(3, -1).T + 0.5)
    places, found, count = [], [], 0
    while len(points):
        sizes = _values(function, points)
        small = sizes < hmax
        points, sizes = points[small], sizes[small]
        places.append(points)
        found.append(sizes)
        count += len(points)
        coarse = step > 2.0 * sizes
        if count + 8 * np.count_nonzero(coarse) > tuning.MOST_SAMPLES_OF_FUNCTION:
            break
        step *= 0.5
        corners = step * (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5)
        points = (points[coarse][:, None] + corners).reshape(-1, 3)
    at, sizes = np.concatenate(places), np.concatenate(found)
    winding, rule = winding_of(surface)
    inside = winding.contains(at, rule=rule) if len(at) else np.zeros(0, np.bool_)
    line = InnerLine(at[inside], sizes[inside], np.empty((0, 2), np.int32))
    return InnerFunction(function, line)


def inner_sources(
    sources: Sequence[Any], surface: SimplexMesh, hmax: float
) -> tuple[InnerSource, ...]:
    """Return the sources that act inside a surface, and not only at its nodes.

    Functions are sampled where they are below ``hmax``.
    """
    found: list[InnerSource] = []
    for source in sources:
        if isinstance(source, PointSource):
            found.append(InnerLine(*source.rows(3), np.empty((0, 2), np.int32)))
        elif isinstance(source, CurveSource):
            found.append(InnerLine(*source.rows(3), source.segments(3).cells))
        elif isinstance(source, BoxSource):
            found.append(InnerBox(*source.corners(3), float(source.size)))
        elif isinstance(source, BallSource):
            found.append(InnerBall(source.middle(3), float(source.radius), float(source.size)))
        elif not isinstance(source, Source):
            found.append(sampled(source, surface, hmax))
    return tuple(found)


def at_nodes_only(sources: Sequence[Any]) -> list[Any]:
    """Return the sources that are known at the nodes of a surface: the others, and functions."""
    placed = (PointSource, CurveSource, BoxSource, BallSource)
    return [source for source in sources if not isinstance(source, placed)]
