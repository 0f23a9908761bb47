"""Predicted numbers of elements and nodes of a mesh with given sizes: ``predict``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes, as_whole_number, check_function
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.background.simplex import as_mesh, cut_out
from adaptsize.geometry.solid import Solid
from adaptsize.sizes import tuning
from adaptsize.sizes.budget import (
    ELEMENTS_PER_MEASURE,
    calibration,
    count_elements,
    nodes_of,
)
from adaptsize.typing import BoolArray, FloatArray

#: Of a cube with edges of length 1.
_HALF_DIAGONAL = 0.5 * np.sqrt(3.0)


#: A size as a function of points, float64[n, dim] to float64[n].
SizeAt: TypeAlias = Callable[[FloatArray], npt.ArrayLike]


class Prediction(NamedTuple):
    """Predicted numbers of a mesh."""

    cells: float
    facets: float = np.nan
    """Facets of the boundary; nan if they are not known, as nodes."""
    nodes: float = np.nan


class _Cubes(NamedTuple):
    """Cubes with a point in each; they cover what a surface encloses."""

    corners: FloatArray
    """The lower ones, in coordinates that turn with the surface."""
    sides: FloatArray
    points: FloatArray
    counts: BoolArray
    """Whether the point is inside."""
    are_inside: BoolArray
    """Whether the whole cube is known to be inside."""
    least: FloatArray
    """Lower bounds of the sizes at the centres."""
    are_exact: BoolArray
    """Whether the bounds are these sizes."""

    def only(self, which: BoolArray) -> _Cubes:
        """Return some of the cubes."""
        return _Cubes._make(values[which] for values in self)


class Enclosed:
    """The region that a surface encloses, divided into cubes that follow the sizes in it.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, which are oriented first.  The region is where the winding number is
        above one half, so that holes, cracks and overlapping bodies do little harm.

    Notes
    -----
    The integral is a sum over one random point in each cube of an octree, as in stratified
    sampling [1]_.  Cubes are divided until their edges are at most a multiple of the size at their
    centres, the same for all and at most 2, or 1 / (2 g) for gradients above 1/4, and at least 4000
    points are inside.  Cubes outside are left out, and all parts of a cube inside are inside.  In a
    cube of 2 sizes, sizes of gradient g are nowhere smaller than 1 - 1.7 g times that at the
    centre.  The standard error is that of the cubes that the surface intersects, less than 1 %.
    The points turn and move with the surface.  Further sizes use the same cubes where these are
    small enough.

    References
    ----------
    .. [1] J. M. Hammersley, D. C. Handscomb, "Monte Carlo Methods", Methuen, London (1964), 5.3.
    """

    def __init__(self, surface: SimplexMesh, n_points: int = 4000) -> None:
        surface = as_mesh("surface", surface)
        if surface.cell_dim != 2 or surface.dim != 3:
            raise ValueError(f"surface must consist of triangles in space, got {surface}")
        self.surface = surface
        self._n_points = as_whole_number("n_points", n_points, lower=1, upper=10**7)
        solid = Solid.of(surface)
        self._solid = solid
        # Only a closed surface has the same winding number in all of a cube that it leaves alone.
        self._is_closed = solid.is_closed
        self._middle, self._axes = _principal_axes(surface)
        local = ((surface.points - self._middle) @ self._axes)[surface.cells].reshape(-1, 3)
        low = local.min(axis=0)
        extent = local.max(axis=0) - low
        side = max(float(extent.max()), np.finfo(float).tiny) / 8.0
        number = np.indices(np.maximum(np.ceil(extent / side), 1).astype(int)).reshape(3, -1).T
        self._random = np.random.default_rng(20061)
        n = len(number)
        sides = np.full(n, side)
        self._cubes = self._located(low + side * number, sides, np.zeros(n, np.bool_), np.zeros(n))
        self._factor = np.inf

    def _volume_integral(self, size: SizeAt) -> float:
        """Return the integral of h^-3 over the region."""
        sides, sizes = self._at_samples(size)
        if np.isinf(self._factor) or (sides > 1.5 * self._factor * sizes).any():
            self._divide(size)
            sides, sizes = self._at_samples(size)
        with np.errstate(over="ignore"):
            return float(np.sum((sides / sizes) ** 3.0))

    def _at_samples(self, size: SizeAt) -> tuple[FloatArray, FloatArray]:
        """Return the edges of the cubes whose point is inside, and the sizes there."""
        counts = self._cubes.counts
        return self._cubes.sides[counts], np.asarray(size(self._cubes.points[counts]), np.float64)

    def _area_integral(self, size: SizeAt) -> float:
        """Return the integral of h^-2 over the surface."""
        carrier = getattr(size, "background", None)
        if isinstance(carrier, SimplexMesh) and carrier.cell_dim == 2:
            return count_elements(carrier, cast(Any, size).values) / ELEMENTS_PER_MEASURE[2]
        surface = self.surface
        # An even sample of so many triangles is enough to see whether there are too many elements.
        sample = cut_out(surface.points, surface.cells[:: surface.n_cells // 300 + 1])[0]
        share = float(sample.measures.sum() / surface.measures.sum())
        return _integral(sample, size) / share

    def _divide(self, size: SizeAt) -> None:
        """Divide cubes until they are small enough compared with the sizes at their centres.

        The size at a centre is not needed where a lower bound, by the gradient of the sizes from
        the centre of the cube before, is large enough.
        """
        known = getattr(size, "g", None)
        g, n = np.inf if known is None else known, len(self._cubes.sides)
        cubes = self._cubes._replace(least=np.zeros(n), are_exact=np.zeros(n, np.bool_))
        largest = min(2.0, 0.5 / max(g, 0.25))
        factor = 16.0  # from few large cubes on, so that too many are noticed early
        while True:
            while (large := cubes.sides > factor * cubes.least).any():
                asked = large & ~cubes.are_exact
                centres = cubes.corners[asked] + 0.5 * cubes.sides[asked, None]
                cubes.least[asked] = size(self._from_own(centres))
                cubes.are_exact[asked] = True
                split = cubes.sides > factor * cubes.least
                if len(split) + 7 * int(split.sum()) > 30 * self._n_points:
                    return
                parts = self._parts(cubes.only(split), g)
                pairs = zip(cubes, parts, strict=True)
                cubes = self._cubes = _Cubes._make(np.concatenate([a[~split], b]) for a, b in pairs)
            self._factor = factor
            if factor <= largest and np.count_nonzero(cubes.counts) >= self._n_points:
                return
            factor *= np.sqrt(0.5)

    def _parts(self, cubes: _Cubes, g: float) -> _Cubes:
        """Return the eighths of cubes, with bounds of sizes of gradient g."""
        sides = 0.5 * np.repeat(cubes.sides, 8)
        octants = np.tile(list(np.ndindex(2, 2, 2)), (len(cubes.sides), 1))
        corners = np.repeat(cubes.corners, 8, axis=0) + sides[:, None] * octants
        least = np.repeat(cubes.least, 8) - g * _HALF_DIAGONAL * sides
        return self._located(corners, sides, np.repeat(cubes.are_inside, 8), least)

    def _located(
        self, corners: FloatArray, sides: FloatArray, are_inside: BoolArray, least: FloatArray
    ) -> _Cubes:
        """Return the cubes that are not outside; ``are_inside``: which are known to be inside."""
        points = self._from_own(corners + sides[:, None] * self._random.random(corners.shape))
        counts, rest = are_inside.copy(), np.flatnonzero(~are_inside)
        counts[rest] = self._solid.contains(points[rest])
        at_surface = ~are_inside
        if self._is_closed:
            centres = self._from_own(corners[rest] + 0.5 * sides[rest, None])
            distances = self.surface.locator.weights(centres)[2]
            at_surface[rest] = distances <= _HALF_DIAGONAL * sides[rest]
        are_exact = np.zeros(len(sides), np.bool_)
        cubes = _Cubes(corners, sides, points, counts, ~at_surface, least, are_exact)
        return cubes.only(counts | at_surface)

    def _from_own(self, points: FloatArray) -> FloatArray:
        return points @ self._axes.T + self._middle


def predict(
    domain: AnyMesh | Enclosed, size: npt.ArrayLike | SizeAt, *, backend: str | None = None
) -> Prediction:
    r"""Return the predicted numbers of elements and nodes of the given sizes in a domain.

    The cells are those of regular simplices of edge h,

    .. math:: c_d \int h^{-d} \, dx, \qquad c_1 = 1, \; c_2 = 4 / \sqrt 3, \; c_3 = 6 \sqrt 2,

    where d is the dimension of the cells, and so are the facets of the boundary, with d - 1.  With
    T cells and B boundary facets, the nodes are

    .. math:: T + B / 2, \qquad T / 2 + B / 2, \qquad (6 / q - 1) \, T + B / 4

    for segments, triangles and tetrahedra.  These are Euler's formulas without the Euler
    characteristic, which is a few nodes.  In space, q = 5.13 tetrahedra are around an inner edge
    and half as many around a boundary edge.

    Parameters
    ----------
    domain : SimplexMesh, PartitionedMesh or Enclosed
        A mesh, or the region that a surface encloses.
    size : array_like of float, shape (n_points,), or callable
        Requested edge lengths, positive: at the nodes, and linear in each cell, or at points.
        Cells with ``inf`` at a node are ignored.  A PartitionedMesh needs an array, an Enclosed
        region a callable.  The facets of the latter are those of the sizes on ``size.background``
        if that is a surface, else on a sample of the given one.
    backend : str, optional
        Predict what this mesh generator makes.  Without it, generators make about this number of
        triangles, but more tetrahedra, because these cannot all be regular.

    Returns
    -------
    Prediction
        Of a PartitionedMesh without facets and nodes (nan).

    Raises
    ------
    ValueError
        If the sizes have another shape or are not positive.

    Notes
    -----
    The integral over a cell of linear sizes is exact up to rounding.  With a callable, cells are
    halved along their longest edges until the sizes are linear up to 2 %, or the edges half as long
    as the sizes.  The integral over an Enclosed region has a standard error below 1 %.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> predicted = predict(mesh, [0.1, 0.1, 0.1])
    >>> round(predicted.cells), round(predicted.nodes)
    (115, 75)
    >>> round(predict(mesh, lambda x: 0.1 + 0.0 * x[:, 0]).cells)
    115
    """
    domain = as_mesh("domain", domain, PartitionedMesh, Enclosed)
    if isinstance(domain, Enclosed):
        check_function("size", size, "points")
        found = integrated(domain, cast(SizeAt, size), backend)
        cells = max(found.cells, found.facets)  # in a layer thinner than the sizes
        return Prediction(cells, found.facets, nodes_of(3, cells, found.facets))
    d = domain.cell_dim
    if callable(size):
        domain = as_mesh("domain", domain)
        mesh = cast(SimplexMesh, domain)
        facets = _integral(mesh.boundary().mesh, size) if _has_facets(mesh) else 0.0
        return _predicted(d, _integral(mesh, size), facets, backend)
    h = domain.ranks.agree(lambda: as_sizes("size", size, domain.nodal_shape))
    inner = count_elements(domain, h) / ELEMENTS_PER_MEASURE[d]
    if isinstance(domain, PartitionedMesh):
        return Prediction(_predicted(d, inner, 0.0, backend).cells)
    facets = 0.0
    if _has_facets(domain):
        skin = domain.boundary()
        facets = count_elements(skin.mesh, h[skin.nodes]) / ELEMENTS_PER_MEASURE[d - 1]
    return _predicted(d, inner, facets, backend)


def integrated(domain: Enclosed, size: SizeAt, backend: str | None) -> Prediction:
    """Return the numbers of regular cells and facets, also if these are fewer than the layers."""
    maker = "mmg inside" if backend == "mmg" else backend
    return _predicted(3, domain._volume_integral(size), domain._area_integral(size), maker)


def _has_facets(mesh: SimplexMesh) -> bool:
    """Whether a mesh of triangles or tetrahedra has a boundary."""
    return mesh.cell_dim > 1 and bool((mesh.facet_cell_counts == 1).any())


def _predicted(d: int, inner: float, boundary: float, backend: str | None) -> Prediction:
    """Return the prediction from the integrals of h^-d, and of h^-(d - 1) over the boundary."""
    cells = calibration(backend, d) * ELEMENTS_PER_MEASURE[d] * inner
    if d == 1:
        return Prediction(cells, 2.0, nodes_of(1, cells, 2.0))
    facets = calibration(backend, d - 1) * ELEMENTS_PER_MEASURE[d - 1] * boundary
    return Prediction(cells, facets, nodes_of(d, cells, facets))


def _integral(mesh: SimplexMesh, size: SizeAt) -> float:
    """Return the integral of h^-d over a mesh of d dimensions, divided until h is known in it."""
    background = getattr(size, "background", None)
    is_known = isinstance(background, SimplexMesh) and background.dim == mesh.dim
    fine = resolved(
        mesh,
        partial(_sizes, size),
        g=getattr(size, "g", None) or GRADIENT_LIMIT,
        is_proved=getattr(size, "g", None) is not None,
        samples=cast(SimplexMesh, background).points if is_known else None,
        factor=tuning.EDGE_OF_INTEGRALS,
        accuracy=tuning.LINEAR_WITHIN,
        max_points=mesh.n_points + tuning.MOST_ADDED_NODES,
    ).mesh
    return count_elements(fine, _sizes(size, fine.points)) / ELEMENTS_PER_MEASURE[mesh.cell_dim]


def _sizes(size: SizeAt, points: FloatArray) -> FloatArray:
    return as_sizes("size(points)", size(points), (len(points),))


def _principal_axes(surface: SimplexMesh) -> tuple[FloatArray, FloatArray]:
    """Return the centroid of a surface, and its principal axes as columns.

    They point to the side to which the area extends farther.  Axes of symmetric surfaces depend on
    rounding.
    """
    middles = surface.points[surface.cells].mean(axis=1)
    share = surface.measures / surface.measures.sum()
    centroid = share @ middles
    offsets = middles - centroid
    axes = np.linalg.eigh((share[:, None] * offsets).T @ offsets)[1]
    axes *= np.where(share @ (offsets @ axes) ** 3 < 0.0, -1.0, 1.0)
    return centroid, axes
