"""Smooth fields of the labels in an image, and the interfaces between labels as their zeros."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptsize._kernels.label_fields import interpolate_field
from adaptsize.background import CartesianGrid
from adaptsize.background.grid import span_of
from adaptsize.domain_size.masks import MARGIN, Mask
from adaptsize.geometry.labels import Nearest
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Value of the fields of labels that are far away, in pixels.
_FAR = 1e3


class NearestOnGrid(NamedTuple):
    """The nearest labels at the nodes of a grid; see `Nearest`."""

    first: IntArray
    second: IntArray
    least: FloatArray
    gap: FloatArray
    third: FloatArray
    """The third smallest field, in pixels."""


class _Field(NamedTuple):
    """The field of a label in a box around it."""

    values: FloatArray
    first: IndexArray
    """Index of the first value in the grid."""

    @property
    def part(self) -> tuple[slice, ...]:
        """The box in arrays of the grid's shape."""
        ends = self.first + self.values.shape
        return tuple(slice(a, b) for a, b in zip(self.first, ends, strict=True))


@dataclass(eq=False)
class LabelFields:
    """A field for each label.  A place belongs to the label with the smallest field.

    The field of a label is the distance to its boundary in pixels, negative inside, filtered by
    ``2 G - G G`` with a Gaussian G, minus the shift of the label.  The second moments of this
    filter are zero.  A Gaussian alone moves round boundaries inwards.

    Two fields are equal at the interface of their labels, three at the lines where three labels
    meet.  The outside is a label too, so that the boundary is one of the interfaces.

    References
    ----------
    M. Jacobs, E. Merkurjev, S. Esedoglu, "Auction dynamics: a volume constrained MBO scheme", J.
    Comput. Phys. 354 (2018) 288-310, for regions by the least of several filtered and shifted
    fields.
    """

    grid: CartesianGrid
    names: list[int]
    """Of the labels, by number; 0 is the outside."""
    fields: list[_Field]
    shifts: FloatArray
    """Subtracted from the field of each label, in pixels; changed by `LabelledDomain`."""

    @property
    def pixel(self) -> float:
        """Length of a pixel, the smallest if they are not squares."""
        return float(self.grid.spacing.min())

    @classmethod
    def of(cls, mask: Mask, smoothing: float) -> LabelFields:
        """Return the fields of labels after a filter of a standard deviation in pixels."""
        names = [int(name) for name in np.unique(mask.labels[mask.image_part])]
        image = mask.image_part
        fields = [_field_of(mask.labels == name, image, smoothing) for name in names]
        return cls(mask.grid, names, fields, np.zeros(len(names)))

    @property
    def outside(self) -> int:
        """Number of the label of the outside, -1 if there is none."""
        return self.names.index(0) if 0 in self.names else -1

    def on_grid(self) -> NearestOnGrid:
        """Return the nearest labels at the nodes of the grid."""
        best = _Best(self.grid.shape, with_third=True)
        for k, own in enumerate(self.fields):
            best.insert(k, own.part, own.values - self.shifts[k])
        return NearestOnGrid(*best.nearest, best.third)

    def distance_to(
        self, k: int, nearest: NearestOnGrid, part: tuple[slice, ...] | None = None
    ) -> FloatArray:
        """Return the distance to the boundary of a label at nodes, in pixels, negative inside.

        It is approximate but for its sign.
        """
        part = (slice(None),) * self.grid.dim if part is None else part
        field = np.full(self.grid.shape, _FAR)
        field[self.fields[k].part] = self.fields[k].values - self.shifts[k]
        outside = field[part] - nearest.least[part]
        return np.where(nearest.first[part] == k, -nearest.gap[part], outside) / 2.0

    def at(self, points: FloatArray) -> Nearest:
        """Return the nearest labels at points."""
        best = _Best((len(points),))
        along = self._along(points)
        for k, own in enumerate(self.fields):
            place = along - own.first
            in_box = (place >= 0.0) & (place <= np.array(own.values.shape) - 1.0)
            near = np.flatnonzero(in_box.all(axis=1))
            found = _interpolated(own.values, place[near], with_slope=False)[0]
            best.insert(k, near, found - self.shifts[k])
        return best.nearest

    def values(self, labels: IntArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the field of one label at each point, and its gradient.

        Beyond the box of the label, they are those at the closest point of the box.
        """
        found, slopes = np.empty(len(points)), np.empty(points.shape)
        along = self._along(points)
        for k in np.unique(labels):
            rows = np.flatnonzero(labels == k)
            own = self.fields[k]
            place = np.clip(along[rows] - own.first, 0.0, np.array(own.values.shape) - 1.0)
            value, slope = _interpolated(own.values, place)
            found[rows], slopes[rows] = value - self.shifts[k], slope / self.grid.spacing
        return found, slopes

    def _along(self, points: FloatArray) -> FloatArray:
        """Return the positions of points in pixels, in the grid."""
        along = (points - self.grid.origin) / self.grid.spacing
        return np.asarray(np.clip(along, 0.0, np.array(self.grid.shape) - 1.0))


class _Best:
    """The labels with the smallest and the second smallest field."""

    def __init__(self, shape: tuple[int, ...], *, with_third: bool = False) -> None:
        self.first, self.second = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        self.least, self.next = np.full(shape, np.inf), np.full(shape, np.inf)
        self.third = np.full(shape if with_third else (), np.inf)

    def insert(self, k: int, where: Any, values: FloatArray) -> None:
        """Compare with the field of label ``k`` at some places."""
        first, least = self.first[where], self.least[where]
        wins = values < least
        closer = ~wins & (values < self.next[where])
        self.second[where] = np.where(wins, first, np.where(closer, k, self.second[where]))
        if self.third.ndim:
            after = np.where(wins | closer, self.next[where], values)
            self.third[where] = np.minimum(self.third[where], after)
        self.next[where] = np.where(wins, least, np.where(closer, values, self.next[where]))
        self.first[where] = np.where(wins, k, first)
        self.least[where] = np.where(wins, values, least)

    @property
    def nearest(self) -> Nearest:
        alone = np.isinf(self.next)
        gap = np.where(alone, _FAR, self.next) - self.least
        return Nearest(self.first, np.where(alone, self.first, self.second), self.least, gap)


def _field_of(mine: BoolArray, image: tuple[slice, ...], deviation: float) -> _Field:
    """Return the filtered distance to the boundary of a label, in a box around it.

    Beyond the border of the image, the distance is reflected with the sign of its changes reversed,
    so that boundaries continue in the direction in which they reach the border.
    """
    from scipy import ndimage

    margin = MARGIN + math.ceil(3.0 * deviation)
    low, high = span_of(mine).T
    first = np.maximum(low - margin, 0)
    last = np.minimum(high + margin + 1, mine.shape)
    start = np.maximum(first, [axis.start for axis in image])
    stop = np.minimum(last, [axis.stop for axis in image])
    own = mine[tuple(slice(a, b) for a, b in zip(start, stop, strict=True))]
    level = ndimage.distance_transform_edt(~own) - ndimage.distance_transform_edt(own)
    level -= np.copysign(0.5, level)
    beyond = np.column_stack([start - first, last - stop])
    level = np.pad(level, beyond, mode="reflect", reflect_type="odd")
    if deviation > 0.0:
        once = ndimage.gaussian_filter(level, deviation, mode="nearest")
        level = 2.0 * once - ndimage.gaussian_filter(once, deviation, mode="nearest")
    return _Field(np.ascontiguousarray(level, np.float32), first)


def _interpolated(
    values: FloatArray, place: FloatArray, *, with_slope: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Return values between nodes, multilinear, and if requested their gradients in pixels."""
    found = np.empty(len(place))
    slope = np.empty((len(place) if with_slope else 0, place.shape[1]))
    shape = np.array(values.shape, np.int64)
    interpolate_field(values.reshape(-1), shape, np.ascontiguousarray(place), found, slope)
    return found, slope
