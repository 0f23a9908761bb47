"""A domain of several regions, whose nodes lie on the interfaces between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from adaptsize.background.topology import facets_of, marked
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.labels import Nearest
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.implicit_domain import BoundaryFacets, DistanceDomain, Field
from adaptsize.typing import BoolArray, FloatArray, IntArray


class Fields(Protocol):
    """Fields of labels, of which the smallest one decides to which label a place belongs."""

    names: list[int]
    """Of the labels, by number; 0 is the outside."""
    shifts: FloatArray
    """Subtracted from the field of each label, In/Out, in pixels."""

    @property
    def pixel(self) -> float:
        """Length of a pixel."""
        ...

    def at(self, points: FloatArray) -> Nearest:
        """Return the nearest labels at points."""
        ...

    def values(self, labels: IntArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the field of one label at each point, and its gradient."""
        ...


@dataclass(frozen=True)
class LabelledDomain(DistanceDomain):
    """The labels of a box that are not 0, each of which is a region.

    A node on facets between regions is on the walls of all the labels around it: on an interface
    of two, on the line where three meet, or at the point where four do.  The faces of the box are
    walls too.  They follow the labels in number.

    Attributes
    ----------
    fields : Fields
    measures : dict of int to float
        Area or volume that each region should have.  The fields are shifted until it has.
    """

    fields: Fields = field(kw_only=True)
    measures: dict[int, float] = field(kw_only=True)

    @property
    def may_have_corners(self) -> bool:
        """Whether convex edges of the boundary are searched for, in space.

        In the plane, corners would be fixed, and could not follow the shifts of the fields.
        """
        return self.dim == 3

    @property
    def outside(self) -> int:
        """Number of the label of the outside, -1 if there is none."""
        return self.fields.names.index(0) if 0 in self.fields.names else -1

    def corners(self) -> FloatArray:
        """Return the corners of the box that lie in a region."""
        ends = np.stack([self.lower, self.upper])
        choice = np.indices((2,) * self.dim).reshape(self.dim, -1).T
        corners = np.take_along_axis(ends, choice, axis=0)
        return np.asarray(corners[self.fields.at(corners).first != self.outside])

    def regions(self, points: FloatArray, cells: IntArray) -> IntArray:
        """Return the number of the label of each cell."""
        centres = points[cells].mean(axis=1)
        near = self.fields.at(centres)
        # A cell of the domain whose centroid is just outside.
        return np.where(near.first == self.outside, near.second, near.first).astype(np.int32)

    def skin(
        self, points: FloatArray, cells: IntArray, regions: IntArray | None = None
    ) -> BoundaryFacets:
        """Return the facets on the boundary and between regions, and the walls of their nodes."""
        n = len(points)
        regions = self.regions(points, cells) if regions is None else regions
        facets, sides = self._facets(points, cells, regions)
        on = marked(facets, n)
        each = np.repeat(np.arange(len(cells)), cells.shape[1])
        nodes = np.concatenate([cells.ravel(), facets.ravel()])
        walls = np.concatenate([regions[each], np.repeat(sides[:, 1], facets.shape[1])])
        kept = on[nodes]
        nodes, walls = np.unique(np.column_stack([nodes, walls])[kept], axis=0).T
        start = np.searchsorted(nodes, np.arange(n))
        place = np.arange(len(nodes)) - start[nodes]
        table = np.full((n, int(place.max(initial=0)) + 1), -1, np.int32)
        table[nodes, place] = walls
        return BoundaryFacets(facets, on, table)

    def _facets(
        self, points: FloatArray, cells: IntArray, regions: IntArray
    ) -> tuple[IntArray, IntArray]:
        """Return facets with different walls on their sides, and these, int32[m, 2].

        The second one of a facet of a single cell is the outside or a face of the box.
        """
        facets, cell_facets = facets_of(cells, len(points))
        n = len(facets)
        low, high = np.full(n, np.iinfo(np.int32).max), np.full(n, -1)
        np.minimum.at(low, cell_facets, regions[:, None])
        np.maximum.at(high, cell_facets, regions[:, None])
        single = np.flatnonzero(np.bincount(cell_facets.ravel(), minlength=n) == 1)
        high[single] = self._beyond(points[facets[single]], low[single])
        kept = low != high
        return facets[kept], np.column_stack([low, high])[kept].astype(np.int32)

    def _beyond(self, corners: FloatArray, regions: IntArray) -> IntArray:
        """Return for facets of the boundary the outside, or the face of the box at them."""
        to_planes = np.abs(corners[..., None] - np.stack([self.lower, self.upper], axis=1))
        to_planes = to_planes.max(axis=1).reshape(len(corners), -1)  # 2 d + side
        side = to_planes.argmin(axis=1)
        if self.outside < 0:
            return np.asarray(len(self.fields.names) + side)
        centres = corners.mean(axis=1)
        own = self.fields.values(regions, centres)[0]
        outer = self.fields.values(np.full(len(centres), self.outside), centres)[0]
        depth = 0.5 * np.abs(outer - own) * self.fields.pixel
        cut = to_planes[np.arange(len(side)), side] < depth
        return np.where(cut, len(self.fields.names) + side, self.outside)

    def project(
        self,
        points: FloatArray,
        h: FloatArray,
        *,
        tolerance: float,
        max_steps: int,
        walls: IntArray | None = None,
    ) -> FloatArray:
        """Return points moved onto their walls, or without walls onto the boundary.

        A point that is far from the place where all its walls meet is moved onto those of the
        labels that are nearest to it.
        """
        points = np.clip(points, self.lower, self.upper)
        if walls is None:
            return super().project(points, h, tolerance=tolerance, max_steps=max_steps)
        moved = points.copy()
        free = (walls < 0).all(axis=1)
        moved[free] = super().project(
            points[free], h[free], tolerance=tolerance, max_steps=max_steps
        )
        left, walls = np.flatnonzero(~free), walls.copy()
        while (many := (walls >= 0).sum(axis=1) > self.dim + 1).any():  # meet nowhere
            walls[many] = self._without_farthest(points[many], walls[many])
        while len(left):
            there = self._meeting(points[left], walls[left], h[left], tolerance, max_steps)
            way = np.linalg.norm(there - points[left], axis=1)
            far = way > tuning.REACH_OF_INTERFACES * h[left]
            far &= (walls[left] >= 0).sum(axis=1) > 2
            moved[left[~far]] = there[~far]
            left = left[far]
            walls[left] = self._without_farthest(points[left], walls[left])
        # Where walls are nearly parallel, a point is between them.  The boundary comes first.
        at = np.flatnonzero((walls == self.outside).any(axis=1) & ~free & (self.outside >= 0))
        at = at[(walls[at] >= 0).sum(axis=1) > 2]
        nearest = self._with_nearest_label(moved[at], walls[at])
        moved[at] = self._meeting(moved[at], nearest, h[at], tolerance, max_steps)
        return moved

    def _fields_of(self, points: FloatArray, walls: IntArray) -> FloatArray:
        """Return the fields of the walls that are labels, -inf for others."""
        value = np.full(walls.shape, -np.inf)
        for k in range(walls.shape[1]):
            rows = np.flatnonzero((walls[:, k] >= 0) & (walls[:, k] < len(self.fields.names)))
            value[rows, k] = self.fields.values(walls[rows, k], points[rows])[0]
        return value

    def _with_nearest_label(self, points: FloatArray, walls: IntArray) -> IntArray:
        """Return the walls with only the nearest one of the labels that are not the outside."""
        value = self._fields_of(points, walls)
        value[~np.isfinite(value) | (walls == self.outside)] = np.inf
        kept = np.isinf(value)
        kept[np.arange(len(walls)), value.argmin(axis=1)] = True
        return np.where(kept, walls, -1)

    def _without_farthest(self, points: FloatArray, walls: IntArray) -> IntArray:
        """Return the walls without the label with the largest field, or without one face.

        The outside is kept, so that nodes of the boundary stay on it.
        """
        n_labels = len(self.fields.names)
        value = self._fields_of(points, walls)
        value[(walls == self.outside) & (walls >= 0)] = -1e6
        few = np.isfinite(value).sum(axis=1) <= 2
        few &= (walls >= n_labels).any(axis=1)
        value[few] = np.where(walls[few] >= n_labels, 1.0, -np.inf)
        walls = walls.copy()
        walls[np.arange(len(walls)), value.argmax(axis=1)] = -1
        return walls

    def _meeting(
        self, points: FloatArray, walls: IntArray, h: FloatArray, tolerance: float, max_steps: int
    ) -> FloatArray:
        """Return points moved to where their walls meet, by Newton steps of the least length."""
        points, active = points.copy(), np.arange(len(points))
        for _ in range(max_steps):
            move = self._steps(points[active], walls[active])
            length = np.linalg.norm(move, axis=1)
            too_long = length > h[active]
            move[too_long] *= (h[active] / np.maximum(length, 1e-300))[too_long, None]
            points[active] = np.clip(points[active] + move, self.lower, self.upper)
            active = active[length > tolerance * h[active]]
            if len(active) == 0:
                break
        return points

    def _steps(self, points: FloatArray, walls: IntArray) -> FloatArray:
        """Return the shortest moves to the zeros of the linearised differences of fields."""
        values, slopes, is_plane = self._equations(points, walls)
        # Onto the faces of the box first, and along them from there.
        move = np.where(is_plane[..., None], -values[..., None] * slopes, 0.0).sum(axis=1)
        pinned = (is_plane[..., None] & (slopes != 0.0)).any(axis=1)
        slopes = np.where(is_plane[..., None] | pinned[:, None], 0.0, slopes)
        square = np.einsum("nkd,nkd->nk", slopes, slopes)
        length = np.sqrt(square)
        safe = length > tuning.SAFE_SLOPE / self.fields.pixel
        unit = slopes / np.where(safe, length, np.inf)[..., None]
        away = np.where(safe, values / np.where(safe, length, 1.0), 0.0)
        several = safe.sum(axis=1) > 1
        move -= np.where(several[:, None], 0.0, (away[..., None] * unit).sum(axis=1))
        if several.any():
            inverse = np.linalg.pinv(unit[several], rcond=tuning.PARALLEL)
            move[several] -= np.einsum("ndk,nk->nd", inverse, away[several])
        return np.asarray(move)

    def _equations(
        self, points: FloatArray, walls: IntArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the values and gradients of equations of walls, and which are of faces.

        Of a label, it is its field less that of the first label of the point.
        """
        n_labels = len(self.fields.names)
        n, m = walls.shape
        values, slopes = np.zeros((n, m)), np.zeros((n, m, self.dim))
        is_label = (walls >= 0) & (walls < n_labels)
        first = is_label.argmax(axis=1)
        rows = np.arange(n)
        base, slope = self.fields.values(np.where(is_label.any(1), walls[rows, first], 0), points)
        for column in range(m):
            own = np.flatnonzero(is_label[:, column] & (first != column))
            value, rise = self.fields.values(walls[own, column], points[own])
            values[own, column], slopes[own, column] = value - base[own], rise - slope[own]
        is_plane = walls >= n_labels
        where, k = np.nonzero(is_plane)
        d, side = np.divmod(walls[where, k] - n_labels, 2)
        planes = np.stack([self.lower, self.upper], axis=1)
        values[where, k] = points[where, d] - planes[d, side]
        slopes[where, k, d] = 1.0
        return values, slopes, is_plane

    def to_walls(self, points: FloatArray, depths: FloatArray) -> FloatArray:
        """Return the distance to the boundary, or to interfaces inside if they are nearer."""
        return np.minimum(depths, 0.5 * self.fields.pixel * self.fields.at(points).gap)

    def normals(
        self, points: FloatArray, h: FloatArray, walls: IntArray | None = None
    ) -> FloatArray:
        """Return the normals of the walls; 0 at points where several of them meet."""
        if walls is None:
            return super().normals(points, h)
        n_labels = len(self.fields.names)
        _, slopes, is_plane = self._equations(points, walls)
        n_walls = ((walls >= 0) & (walls < n_labels)).sum(axis=1) - 1 + is_plane.sum(axis=1)
        normals = np.where((n_walls == 1)[:, None], slopes.sum(axis=1), 0.0)
        length = np.linalg.norm(normals, axis=1)
        return np.asarray(normals / np.where(length > 0.0, length, 1.0)[:, None])

    def adjust(self, points: FloatArray, cells: IntArray, regions: IntArray) -> bool:
        """Shift the fields so that the regions get their measures; return whether they have them.

        An interface of area A between regions a and b, at which the difference of their fields
        has the slope s, moves by (shift a - shift b) / s.
        """
        names, outside = self.fields.names, self.outside
        corners = points[cells]
        size = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / (2, 6)[self.dim - 2]
        made = np.bincount(regions, size, len(names))
        wanted = np.array([self.measures.get(name, 0.0) for name in names])
        short = wanted - made
        inner = np.arange(len(names)) != outside
        if (np.abs(short) <= tuning.CLOSE_MEASURE * wanted)[inner].all():
            return True
        facets, sides = self._facets(points, cells, regions)
        between = sides[:, 1] < len(names)
        facets, (a, b) = facets[between], sides[between].T
        centres = points[facets].mean(axis=1)
        slope = self.fields.values(a, centres)[1] - self.fields.values(b, centres)[1]
        steep = np.maximum(np.linalg.norm(slope, axis=1), tuning.LEAST_SLOPE / self.fields.pixel)
        areas = np.linalg.norm(facet_normals(points[facets]), axis=1) / (self.dim - 1)
        rate = areas / steep
        matrix = np.zeros((len(names), len(names)))
        for one, other in ((a, b), (b, a)):
            np.add.at(matrix, (one, one), rate)
            np.add.at(matrix, (one, other), -rate)
        step = np.zeros(len(names))
        solved = np.linalg.lstsq(matrix[np.ix_(inner, inner)], short[inner], rcond=1e-9)[0]
        step[inner] = np.clip(solved, -tuning.LABEL_STEP, tuning.LABEL_STEP)
        most = tuning.MOST_LABEL_SHIFT
        self.fields.shifts[:] = np.clip(self.fields.shifts + step, -most, most)
        return False


def distance_to_outside(fields: Fields) -> Field:
    """Return the function that is negative in all labels but that of the outside."""
    outside = fields.names.index(0) if 0 in fields.names else -1

    def distance(points: FloatArray) -> FloatArray:
        near = fields.at(points)
        if outside < 0:
            return np.full(len(points), -1e3 * fields.pixel)
        away = np.where(near.first == outside, near.gap, -near.gap)
        deep = np.flatnonzero((near.first != outside) & (near.second != outside))
        beyond = fields.values(np.full(len(deep), outside), points[deep])[0]
        away[deep] = near.least[deep] - beyond
        return np.asarray(0.5 * fields.pixel * away)

    return distance
