"""A domain given by a distance function: checked values, gradients, projection to its boundary."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, refuse_where
from adaptsize.background.topology import facets_of, marked
from adaptsize.remeshing.distmesh import tuning
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: A function of points, float64[n, dim], with one value per point.
Field: TypeAlias = Callable[[FloatArray], Any]

#: Steps of a difference quotient, in sizes: far above rounding, far below any detail.
_STEP = 1e-4


class BoundaryFacets(NamedTuple):
    """The facets of a mesh on the boundary of its domain, and on interfaces inside."""

    facets: IntArray
    nodes: BoolArray
    """Which nodes of the mesh are on them."""
    walls: IntArray | None = None
    """Numbers of the walls that each node lies on, int32[n_points, m], padded with -1."""

    def walls_of(self, nodes: npt.NDArray[np.integer]) -> IntArray | None:
        """Return the walls of some nodes; None if there is only the boundary."""
        return None if self.walls is None else self.walls[nodes]


@dataclass(frozen=True)
class DistanceDomain:
    """The points of a box where ``distance`` is negative.

    Attributes
    ----------
    distance : callable
        Takes float64[n, dim] points, negative inside.  Any function that changes its sign
        at the boundary with a nonzero slope.
    requested : callable
        Requested edge lengths in the domain.
    lower, upper : float64[dim]
    probes : float64[m, dim], by default none
        Points of the domain.  Where the size is unknown, outside, it is that at the nearest one.
    """

    distance: Field
    requested: Field
    lower: FloatArray
    upper: FloatArray
    probes: FloatArray = field(default_factory=lambda: np.empty((0, 1)))

    @property
    def may_have_corners(self) -> bool:
        """Whether corners of the boundary are searched for."""
        return True

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return len(self.lower)

    def given(self, points: FloatArray) -> FloatArray:
        """Return the values of ``distance``, float64[n], checked."""
        values = as_float_array("distance(points)", self.distance(points), (len(points),))
        refuse_where("distance(points)", ~np.isfinite(values), values, "must be finite")
        return values

    def phi(self, points: FloatArray) -> FloatArray:
        """Return the function that is negative in the domain and in the box, float64[n]."""
        if len(points) == 0:
            return np.empty(0)
        beyond = np.maximum(self.lower - points, points - self.upper).max(axis=1)
        return np.asarray(np.maximum(self.given(points), self.slope * beyond))

    def size(self, points: FloatArray) -> FloatArray:
        """Return the requested sizes, float64[n], checked.

        Outside the domain any value is accepted.  Without ``probes``, unknown sizes are NaN.
        """
        if len(points) == 0:
            return np.empty(0)
        values = np.array(self.requested(points), np.float64)
        if values.shape != (len(points),):
            raise ValueError(f"size(points) must have shape {(len(points),)}, got {values.shape}")
        bad = ~(np.isfinite(values) & (values > 0.0))
        if bad.any():
            inside = np.zeros(len(points), np.bool_)
            inside[bad] = self.phi(points[bad]) < 0.0
            text = "must be finite and positive in the domain"
            refuse_where("size(points)", inside, values, text)
            values[bad] = np.nan
            if len(self.probes):
                tree, known = self._known_sizes
                values[bad] = known[tree.query(points[bad])[1]]
        return values

    @cached_property
    def _known_sizes(self) -> tuple[Any, FloatArray]:
        """The tree of the probes, and the sizes there."""
        from scipy.spatial import cKDTree

        return cKDTree(self.probes), self.size(self.probes)

    @cached_property
    def slope(self) -> float:
        """Bound on the slope of ``distance``, estimated from samples; 1 for distances.

        It is that of the steepest gradient between the nodes of a grid.  A tenth is added: between
        the samples it may be steeper.
        """
        extent = self.upper - self.lower
        most = tuning.FIRST[self.dim] * extent / extent.max()
        counts = np.maximum(3, np.ceil(most).astype(int) + 1)
        grid = grid_of(self.lower, self.upper, counts)
        phi = self.given(grid.reshape(-1, self.dim)).reshape(counts)
        square = np.zeros(counts - 1)
        for d in range(self.dim):
            rise = np.diff(phi, axis=d) / (extent[d] / (counts[d] - 1))
            square += rise[tuple(slice(0, n - 1) for n in phi.shape)] ** 2
        return tuning.STEEPER * float(np.sqrt(square.max())) or 1.0

    def depth(self, phi: FloatArray) -> FloatArray:
        """Return a lower bound on how deep inside points are (if ``slope`` is one)."""
        return -phi / self.slope

    def gradient(self, points: FloatArray, phi: FloatArray, h: FloatArray) -> FloatArray:
        """Return differences of phi over ``1e-4 h``, float64[n, dim].

        Forward ones, or backward ones where forward ones are shallow and these steeper: beside an
        edge of the domain, forward steps along all axes may lead inside along the other face.
        """
        gradient = self._differences(points, phi, _STEP * h)
        shallow = np.flatnonzero(np.linalg.norm(gradient, axis=1) < tuning.SHALLOW * self.slope)
        back = self._differences(points[shallow], phi[shallow], -_STEP * h[shallow])
        steeper = np.linalg.norm(back, axis=1) > np.linalg.norm(gradient[shallow], axis=1)
        gradient[shallow[steeper]] = back[steeper]
        return gradient

    def _differences(self, points: FloatArray, phi: FloatArray, step: FloatArray) -> FloatArray:
        n, dim = points.shape
        moved = np.repeat(points[None], dim, axis=0)
        for d in range(dim):
            moved[d, :, d] += step
        there = self.phi(moved.reshape(-1, dim)).reshape(dim, n)
        # Rounding changes the step that is added to a coordinate.
        rises = np.stack([moved[d, :, d] - points[:, d] for d in range(dim)])
        return np.asarray(((there - phi) / rises).T)

    def depths(self, points: FloatArray, h: FloatArray) -> FloatArray:
        """Return estimates of how deep inside points are: of first order, -phi / |grad phi|."""
        phi = self.phi(points)
        slope = np.linalg.norm(self.gradient(points, phi, h), axis=1)
        return np.asarray(-phi / np.clip(slope, tuning.FLAT_GRADIENT * self.slope, self.slope))

    def regions(self, points: FloatArray, cells: IntArray) -> IntArray:
        """Return the number of the region of each cell."""
        return np.zeros(len(cells), np.int32)

    def skin(
        self,
        points: FloatArray,
        cells: IntArray,
        regions: IntArray | None = None,
    ) -> BoundaryFacets:
        """Return the facets on the boundary: those that belong to only one cell."""
        facets, cell_facets = facets_of(cells, len(points))
        single = np.bincount(cell_facets.ravel(), minlength=len(facets)) == 1
        facets = np.asarray(facets[single])
        return BoundaryFacets(facets, marked(facets, len(points)))

    def adjust(self, points: FloatArray, cells: IntArray, regions: IntArray) -> bool:
        """Adjust the boundary to a mesh; return whether nothing was changed."""
        return True

    def to_walls(self, points: FloatArray, depths: FloatArray) -> FloatArray:
        """Return the distance to the boundary, or to interfaces inside if they are nearer."""
        return depths

    def normals(
        self,
        points: FloatArray,
        h: FloatArray,
        walls: IntArray | None = None,
    ) -> FloatArray:
        """Return the directions of the gradients; 0 where it is 0."""
        gradient = self.gradient(points, self.phi(points), h)
        length = np.linalg.norm(gradient, axis=1)
        return np.asarray(gradient / np.where(length > 0.0, length, 1.0)[:, None])

    def newton_steps(self, points: FloatArray, phi: FloatArray, h: FloatArray) -> FloatArray:
        """Return the moves to the zero of the linearised phi, none longer than ``h``."""
        gradient = self.gradient(points, phi, h)
        square = np.einsum("ij,ij->i", gradient, gradient)
        safe = square > (tuning.FLAT_GRADIENT * self.slope) ** 2
        factor = np.divide(-phi, square, out=np.zeros_like(phi), where=safe)
        move = factor[:, None] * gradient
        length = np.linalg.norm(move, axis=1)
        too_long = length > h
        move[too_long] *= (h[too_long] / length[too_long])[:, None]
        return np.asarray(move)

    def project(
        self,
        points: FloatArray,
        h: FloatArray,
        *,
        tolerance: float,
        max_steps: int,
        walls: IntArray | None = None,
    ) -> FloatArray:
        """Return points moved to the boundary by Newton steps.

        Parameters
        ----------
        points : float64[n, dim]
        h : float64[n]
            Sizes there.
        tolerance : float
            Length of a step below which a point is on the boundary, in sizes.
        max_steps : int
        walls : int32[n, m], optional
            Of `BoundaryFacets`, if the domain has interfaces inside.
        """
        points, active = points.copy(), np.arange(len(points))
        for _ in range(max_steps):
            here = points[active]
            move = self.newton_steps(here, self.phi(here), h[active])
            far = np.linalg.norm(move, axis=1) > tolerance * h[active]
            active = active[far]
            if len(active) == 0:
                break
            points[active] += move[far]
        return points


def grid_of(lower: FloatArray, upper: FloatArray, counts: npt.ArrayLike) -> FloatArray:
    """Return the nodes of a regular grid over a box, float64[*counts, dim]."""
    axes = [np.linspace(a, b, n) for a, b, n in zip(lower, upper, np.asarray(counts), strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
