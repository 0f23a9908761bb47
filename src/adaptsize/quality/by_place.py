"""Whether the elements that a size function requests are in the mesh, place by place.

The edges of a mesh say nothing about elements that were not made.  Here the requested elements are
counted, wherever the sizes are small, and compared with the cells that are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes_at, place_text
from adaptsize._size_function import SizeFunction
from adaptsize._workers import in_all_threads
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background import tuning as of_background
from adaptsize.background._mesh_arrays import centroids, lengths
from adaptsize.background.bisection import resolved
from adaptsize.background.interpolation import places_of
from adaptsize.metrics import Metric
from adaptsize.quality import tuning
from adaptsize.ranks import Communicator, SingleRank
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE
from adaptsize.typing import BoolArray, FloatArray, IndexArray

_SizeAt: TypeAlias = Callable[[FloatArray], FloatArray]

#: An edge is near its size within these bounds of length over size.
BAND = (np.sqrt(0.5), np.sqrt(2.0))
#: Nodes that are added to resolve the sizes.  A mesh near its sizes needs hardly any.
MOST_POINTS = 50_000
#: Cells per node, roughly.
_CELLS_PER_POINT = 6
#: Cells are measured in blocks whose numbers fit into the cache.
_CELLS_AT_ONCE = 4096
#: Points whose weights are summed at once.
_POINTS_AT_ONCE = 16_384


def is_in_band(ratio: FloatArray) -> BoolArray:
    """Return whether neither halving nor doubling an edge would bring it nearer to its size."""
    return np.asarray((ratio >= BAND[0]) & (ratio <= BAND[1]))


@dataclass(frozen=True)
class WorstPlace:
    """The place where the cells of a mesh are largest compared with the sizes."""

    point: tuple[float, ...]
    size: float
    """Requested size."""
    edge: float
    """Mean length of the edges of the cell there."""
    cause: str | None = None
    """What controls the size there, if the size function knows it."""

    @property
    def ratio(self) -> float:
        """Edge over size."""
        return self.edge / self.size

    def __str__(self) -> str:
        """Return the place, the size and the edge."""
        cause = "" if self.cause is None else f" ({self.cause})"
        place = place_text(self.point, 4)
        return f"edge {self.edge:.3g} for size {self.size:.3g}{cause} at {place}"


class Served(NamedTuple):
    """How many of the elements that sizes request are in a mesh."""

    elements: float
    """Number of requested elements, of regular simplices."""
    served: float
    """Share of them where the mean edge of the cell is within a factor sqrt 2 of the size."""
    too_coarse: float
    """Share of them where it is longer."""
    worst: WorstPlace


class RequestedElements(NamedTuple):
    """Points that represent the elements that sizes request in a mesh."""

    points: FloatArray
    """float64[n, dim]"""
    weights: FloatArray
    """float64[n]: elements that each represents, up to a factor common to all ranks."""
    sizes: FloatArray
    """float64[n]"""
    edges: FloatArray
    """float64[n]: mean length of the edges of the cell around."""
    cells: IndexArray
    """int[n]: that cell."""
    unit: float
    """The common factor."""
    together: int
    """How many points that follow each other are in the same part of a cell."""
    is_of_metric: bool = False

    @classmethod
    def of(
        cls,
        mesh: SimplexMesh | None,
        size: object,
        max_points: float = MOST_POINTS,
        ranks: Communicator | None = None,
    ) -> RequestedElements:
        r"""Return the elements that sizes request in a mesh.

        Their number is :math:`c_d \int h^{-d} \, dx`.  The cells are bisected, each on its own,
        until the size hardly varies in their parts, which are represented by the points of a
        quadrature rule [1]_.

        Parameters
        ----------
        mesh : SimplexMesh or None
            The mesh that is judged; None on a rank without cells.
        size : SizeFunction, callable, float64[n_points] or float
            As in `size_conformity`.
        max_points : float
            About the largest number of nodes that are added.
        ranks : Communicator, optional
            Of a mesh in parts, of which this is one; collective.

        Notes
        -----
        No request is missed, however small, if the gradient of the sizes is known to be bounded:
        those of `size_function` that come from the exact method in the plane or in a convex
        domain, or grow from a surface.  Nodal values on the mesh itself are linear in its cells.
        Other size functions are evaluated at the nodes and centroids of the mesh, at the nodes
        of their background, and more closely where any of these is small.  Beyond ``max_points``
        nodes, which is only reached if far too few cells were made, parts remain larger than the
        sizes.  Small sizes in them may then be missed.

        References
        ----------
        .. [1] A. H. Stroud, "Approximate Calculation of Multiple Integrals", Prentice-Hall,
           Englewood Cliffs (1971).
        """
        d, parts = 1, None
        sizes, points = np.empty(0), np.empty((0, 1))
        if mesh is not None:
            d = mesh.cell_dim
            h = as_sizes_at("size", size, mesh.points)
            parts = _parts(mesh, size, h, max_points)
            sizes, points = parts.at_quadrature()
        least = (ranks or SingleRank()).allreduce(float(sizes.min(initial=np.inf)), "min")
        cells, (weights, edges) = np.empty(len(sizes), np.intp), np.zeros((2, len(sizes)))
        if mesh is not None and parts is not None:
            measures, own, means = parts.measures, parts.cells, of_edges(mesh, np.mean)

            def weigh(first: int, last: int) -> None:
                rows = slice(first * (d + 1), last * (d + 1))
                cells[rows] = np.repeat(own[first:last], d + 1)
                edges[rows] = means[cells[rows]]
                if least < np.inf:
                    share = np.repeat(measures[first:last] / (d + 1), d + 1)
                    with np.errstate(over="ignore", under="ignore"):
                        weights[rows] = share * (least / sizes[rows]) ** d

            in_all_threads(weigh, len(own), _CELLS_AT_ONCE)
        with np.errstate(over="ignore", under="ignore", divide="ignore"):
            unit = ELEMENTS_PER_MEASURE[d] / np.float64(least) ** d if least < np.inf else 1.0
        return cls(points, weights, sizes, edges, cells, float(unit), d + 1)

    @classmethod
    def of_metric(
        cls,
        mesh: SimplexMesh,
        metric: Callable[[FloatArray], Metric],
        on: SimplexMesh | None = None,
        max_cells: int | None = None,
    ) -> RequestedElements:
        r"""Return the elements that a metric requests in a mesh.

        Their number is :math:`c_d \int \sqrt{\det M} \, dx`.  The size at a place is the mean edge
        of the cell there over its mean length in the metric of the place.

        Parameters
        ----------
        mesh : SimplexMesh
            The mesh that is judged.
        metric : callable
            Takes points and returns a Metric with finite sizes.
        on : SimplexMesh, optional
            The mesh on which the metric is given.  Its cells are then divided, so that nothing
            between the nodes of ``mesh`` is missed, and otherwise those of ``mesh``.
        max_cells : int, optional
            Of more cells, each that requests more than 1 / ``max_cells`` of all elements is taken,
            and an even sample of the others.
        """
        base = mesh if on is None else on
        at_nodes = _maps(metric(base.points), mesh.cell_dim)
        taken, stands_for = _representatives(base, at_nodes[1], max_cells or base.n_cells)
        parts = _metric_parts(base, metric, at_nodes, taken)
        cells = parts.cells
        weights = parts.volumes * stands_for[cells]
        if on is not None:
            cells = np.asarray(mesh.locator.nearest(parts.points)[0], np.intp)
        pairs = _pairs(mesh.cell_dim)
        corners = mesh.points[mesh.cells[cells]]
        there = _lengths(corners[:, pairs[:, 1]] - corners[:, pairs[:, 0]], parts.maps)
        edges = of_edges(mesh, np.mean)[cells]
        unit, sizes = ELEMENTS_PER_MEASURE[mesh.cell_dim], edges / there.mean(axis=1)
        return cls(parts.points, weights, sizes, edges, cells, unit, 1, True)

    @property
    def ratios(self) -> FloatArray:
        """Mean edge over size."""
        return np.asarray(self.edges / self.sizes)

    def excess(self) -> float:
        """Return the mean logarithm of edges over sizes, those that are too short counted as 0."""
        return float(np.average(np.log(np.maximum(self.ratios, 1.0)), weights=self.weights))

    def scaled(self, factor: float, points: FloatArray) -> RequestedElements:
        """Return the same in other coordinates."""
        return self._replace(points=points, sizes=factor * self.sizes, edges=factor * self.edges)

    def only(self, which: npt.NDArray[np.bool_]) -> RequestedElements:
        """Return some of them."""
        names = ("points", "weights", "sizes", "edges", "cells")
        return self._replace(**{name: getattr(self, name)[which] for name in names}, together=1)

    def served(self, size: object = None, ranks: Communicator | None = None) -> Served | None:
        """Return the shares that are in the mesh, None if nothing is requested; collective.

        A SizeFunction ``size`` adds the cause at the worst place.
        """
        ranks = ranks or SingleRank()
        sums, worst_here = self._summed()
        total, near, above = ranks.allreduce(sums, "sum").tolist()
        if not 0.0 < total < np.inf:
            return None
        places = [place for place in ranks.allgather(worst_here) if place is not None]
        worst = max(places, key=lambda place: place.ratio)
        if isinstance(size, SizeFunction) and size.report is not None:
            node = nodes_near(size, np.array([worst.point]))
            code = int(size.report.cause.ravel()[node][0])
            cause = size.report.causes[code] if code >= 0 else None
            worst = WorstPlace(worst.point, worst.size, worst.edge, cause)
        return Served(total * self.unit, near / total, above / total, worst)

    def _summed(self) -> tuple[FloatArray, WorstPlace | None]:
        """Return the weights of all, of those in the band and of those above, and the worst."""
        n = len(self.weights)
        n_chunks = -(-n // _POINTS_AT_ONCE)
        sums, largest = np.zeros((n_chunks, 3)), np.full(n_chunks, -np.inf)
        rows = np.zeros(n_chunks, np.intp)

        def add(first: int, last: int) -> None:
            chunk, own = first // _POINTS_AT_ONCE, self.weights[first:last]
            ratios = self.edges[first:last] / self.sizes[first:last]
            sums[chunk] = own.sum(), own[is_in_band(ratios)].sum(), own[ratios > BAND[1]].sum()
            ratios[~(own > 0.0)] = -np.inf
            k = int(ratios.argmax())
            rows[chunk], largest[chunk] = first + k, ratios[k]

        in_all_threads(add, n, _POINTS_AT_ONCE)
        if largest.max(initial=-np.inf) == -np.inf:
            return sums.sum(axis=0), None
        k = int(rows[largest.argmax()])
        point = tuple(self.points[k].tolist())
        return sums.sum(axis=0), WorstPlace(point, float(self.sizes[k]), float(self.edges[k]))


class _Parts(NamedTuple):
    """Parts of the cells of a mesh in which the size hardly varies."""

    corners: FloatArray
    """float64[n, d + 1, dim]"""
    sizes: FloatArray
    """float64[n, d + 1]: at the corners."""
    middle: FloatArray
    """float64[n]: at the centroids."""
    measures: FloatArray
    cells: IndexArray
    """int[n]: the cell of which each is a part."""

    def only(self, which: BoolArray) -> _Parts:
        """Return some of them."""
        return _Parts._make(values[which] for values in self)

    def at_quadrature(self) -> tuple[FloatArray, FloatArray]:
        """Return sizes and places of the d + 1 points, of equal weight, of a quadrature rule.

        The rule integrates quadratic functions exactly.  Its points lie on the lines from the
        centroid to the corners.  The sizes are linear between the centroid and the facets.
        """
        s = 1.0 / np.sqrt(self.sizes.shape[1] + 1.0)
        sizes, points = np.empty_like(self.sizes), np.empty_like(self.corners)

        def fill(first: int, last: int) -> None:
            own, at_corners = self.sizes[first:last], self.corners[first:last]
            mean, middle = own.mean(axis=1), self.middle[first:last]
            bounded = np.isfinite(mean) & np.isfinite(middle)
            # inf where a corner is
            sizes[first:last] = s * own + (1.0 - s) * np.where(bounded, middle, mean)[:, None]
            points[first:last] = (1.0 - s) * at_corners.mean(axis=1)[:, None] + s * at_corners

        in_all_threads(fill, len(sizes), _CELLS_AT_ONCE)
        return sizes.ravel(), points.reshape(-1, points.shape[2])


def _pairs(cell_dim: int) -> IndexArray:
    """Return the corners of the edges of a cell, int[k, 2]."""
    return np.array(list(combinations(range(cell_dim + 1), 2)))


def _edges_of_cells(mesh: SimplexMesh, cells: slice) -> FloatArray:
    """Return the lengths of the edges of some cells, float64[k, n], in the order of `_pairs`.

    Along the first axis, numpy reduces several times faster than along the last one.
    """
    corners = mesh.cells[cells]
    return np.array([lengths(mesh.points, corners[:, pair]) for pair in _pairs(mesh.cell_dim)])


def of_edges(mesh: SimplexMesh, summary: Callable[..., FloatArray]) -> FloatArray:
    """Return a summary of the lengths of the edges of each cell, such as `numpy.mean`."""
    found = np.empty(mesh.n_cells)

    def measure(first: int, last: int) -> None:
        found[first:last] = summary(_edges_of_cells(mesh, slice(first, last)), axis=0)

    in_all_threads(measure, mesh.n_cells, _CELLS_AT_ONCE)
    return found


def _parts(mesh: SimplexMesh, size: object, h: FloatArray, max_points: float) -> _Parts:
    """Return parts of the cells of a mesh.

    Parameters
    ----------
    h : float64[n_points]
        The sizes at the nodes.
    """
    is_plain = isinstance(size, SizeFunction) and size.sources is None and size.g is None
    at = None if is_plain and getattr(size, "background", None) is mesh else _function_of(size)
    if at is None:
        return _linear_parts(mesh, h, _CELLS_PER_POINT * max_points)
    g = _slope(size)
    samples = None if g is not None else _nodes_of(size)
    known = _is_known(mesh, h, at, g, samples)
    done, rest = np.flatnonzero(known), np.flatnonzero(~known)
    whole = _whole_cells(mesh, h, done)
    if len(rest) == 0:
        return whole
    # Cells without common nodes: none is divided because of another one.
    own = h[mesh.cells[rest]].ravel()
    apart = SimplexMesh(
        mesh.points[mesh.cells[rest]].reshape(-1, mesh.dim),
        np.arange(len(own)).reshape(len(rest), -1),
    )
    found = resolved(apart, at, g=g, samples=samples, max_points=len(own) + max_points)
    fine = found.mesh
    own = np.append(own, at(fine.points[len(own) :]))[fine.cells]
    corners = fine.points[fine.cells]
    divided = _Parts(corners, own, at(corners.mean(axis=1)), fine.measures, rest[found.parents])
    return _Parts._make(np.concatenate(pair) for pair in zip(whole, divided, strict=True))


def _whole_cells(mesh: SimplexMesh, h: FloatArray, cells: IndexArray) -> _Parts:
    """Return cells as their only parts, in which the size is linear."""
    n, k, measures = len(cells), mesh.cell_dim + 1, mesh.measures
    parts = _Parts(np.empty((n, k, mesh.dim)), np.empty((n, k)), np.empty(n), np.empty(n), cells)

    def fill(first: int, last: int) -> None:
        nodes = mesh.cells[cells[first:last]]
        parts.corners[first:last], parts.sizes[first:last] = mesh.points[nodes], h[nodes]
        parts.middle[first:last] = parts.sizes[first:last].mean(axis=1)
        parts.measures[first:last] = measures[cells[first:last]]

    in_all_threads(fill, n, _CELLS_AT_ONCE)
    return parts


def _linear_parts(mesh: SimplexMesh, h: FloatArray, max_parts: float) -> _Parts:
    """Return parts of cells in which the size is linear, divided until it hardly varies.

    Cells with inf at a node have no bound, and are left out.
    """
    longest = of_edges(mesh, np.max)
    bounded, split = np.empty((2, mesh.n_cells), np.bool_)

    def judge(first: int, last: int) -> None:
        sizes = h[mesh.cells[first:last]]
        bounded[first:last] = np.isfinite(sizes).all(axis=1)
        split[first:last] = bounded[first:last] & _is_coarse(sizes, longest[first:last])

    in_all_threads(judge, mesh.n_cells, _CELLS_AT_ONCE)
    room = max_parts - int(np.count_nonzero(split))
    if room < 0:
        split[:] = False
    done = [_whole_cells(mesh, h, np.flatnonzero(bounded & ~split))]
    parts, longest = _whole_cells(mesh, h, np.flatnonzero(split)), longest[split]
    while len(parts.cells):
        parts, longest = _halved(parts), np.tile(longest, 2)
        split = _is_coarse(parts.sizes, longest)
        room -= int(np.count_nonzero(split))
        if room < 0:
            split[:] = False
        done.append(parts.only(~split))
        parts, longest = parts.only(split), longest[split]
    if len(done) == 1:
        return done[0]
    return _Parts._make(np.concatenate(columns) for columns in zip(*done, strict=True))


def _is_coarse(sizes: FloatArray, longest: FloatArray) -> BoolArray:
    """Return in which parts of cells the size varies, given their longest edges."""
    least, largest = sizes.min(axis=1), sizes.max(axis=1)
    is_steep = largest > tuning.ABOUT_THE_SAME * least
    return np.asarray(is_steep & (longest > of_background.EDGE_OVER_SIZE * least))


def _halved(parts: _Parts) -> _Parts:
    """Return the halves of parts, divided at the edge along which the size varies most."""
    rows, corners, sizes = np.arange(len(parts.cells)), parts.corners, parts.sizes
    low, high = sizes.argmin(axis=1), sizes.argmax(axis=1)
    middle = 0.5 * (corners[rows, low] + corners[rows, high])
    between = 0.5 * (sizes[rows, low] + sizes[rows, high])
    corners, sizes = np.tile(corners, (2, 1, 1)), np.tile(sizes, (2, 1))
    for half, end in enumerate((low, high)):
        new = rows + half * len(rows)
        corners[new, end], sizes[new, end] = middle, between
    measures, cells = np.tile(0.5 * parts.measures, 2), np.tile(parts.cells, 2)
    return _Parts(corners, sizes, sizes.mean(axis=1), measures, cells)


class _MetricParts(NamedTuple):
    """Parts of the cells of a mesh in which a metric hardly varies, by their centroids."""

    points: FloatArray
    """float64[n, dim]"""
    maps: FloatArray
    """float64[n, dim, dim]: map vectors to those whose length is that in the metric."""
    volumes: FloatArray
    """float64[n]: measure in the metric."""
    cells: IndexArray
    """int[n]: the cell of which each is a part."""


def _representatives(
    mesh: SimplexMesh, density: FloatArray, n: int
) -> tuple[IndexArray, FloatArray]:
    """Return at most about 2 n cells of a mesh, and for how many cells each cell stands.

    Parameters
    ----------
    density : float64[n_points]
        Logarithm of the elements per measure.
    n : int
        Cells that request more than 1/n of all elements stand for themselves, the others are
        sampled evenly.
    """
    if mesh.n_cells <= n:
        return np.arange(mesh.n_cells), np.ones(mesh.n_cells)
    most = np.exp(density - density.max())[mesh.cells.T].max(axis=0) * mesh.measures
    is_alone = most * n > most.sum()
    others = np.flatnonzero(~is_alone)
    some = others[:: len(others) // n + 1]
    stands_for = is_alone.astype(np.float64)
    stands_for[some] = len(others) / max(len(some), 1)
    return np.flatnonzero(stands_for), stands_for


def _metric_parts(
    mesh: SimplexMesh,
    metric: Callable[[FloatArray], Metric],
    at_nodes: tuple[FloatArray, FloatArray],
    cells: IndexArray,
) -> _MetricParts:
    """Return parts of some cells of a mesh, bisected until the metric hardly varies in them.

    The edge between whose ends the density varies most is halved, or if only the centroid differs,
    the edge that is longest in the metric.
    """
    k = mesh.cell_dim
    pairs = _pairs(k)
    maps, density = at_nodes
    corners = mesh.points[mesh.cells[cells]]
    maps, density = maps[mesh.cells[cells]], density[mesh.cells[cells]]
    done: list[_MetricParts] = []
    room = tuning.MOST_PARTS_OF_CELLS
    while len(cells):
        rows, middle = np.arange(len(cells)), corners.mean(axis=1)
        there, here = _maps(metric(middle), k)
        edges = corners[:, pairs[:, 1]] - corners[:, pairs[:, 0]]
        dense = density.argmax(axis=1)
        lengths = np.maximum(_lengths(edges, maps[rows, dense]), _lengths(edges, there))
        rise = np.abs(density[:, pairs[:, 1]] - density[:, pairs[:, 0]])
        varies = rise.max(axis=1) > k * np.log(tuning.ABOUT_THE_SAME)
        is_off = np.abs(here - density.mean(axis=1)) > k * np.log(tuning.ABOUT_THE_SAME)
        split = (varies | is_off) & (lengths.max(axis=1) > of_background.EDGE_OVER_SIZE)
        room -= int(split.sum())
        if room < 0:
            split[:] = False
        whole = ~split
        volumes = _volumes(corners[whole], there[whole])
        done.append(_MetricParts(middle[whole], there[whole], volumes, cells[whole]))
        halved = np.where(varies, rise.argmax(axis=1), lengths.argmax(axis=1))[split]
        corners, maps, density, cells = (a[split] for a in (corners, maps, density, cells))
        if len(cells) == 0:
            break
        rows, ends = np.arange(len(cells)), pairs[halved]
        new = 0.5 * (corners[rows, ends[:, 0]] + corners[rows, ends[:, 1]])
        new_maps, new_density = _maps(metric(new), k)
        halves = []
        for end in ends.T:
            own = corners.copy(), maps.copy(), density.copy()
            for values, at_new in zip(own, (new, new_maps, new_density), strict=True):
                values[rows, end] = at_new
            halves.append((*own, cells))
        corners, maps, density, cells = (np.concatenate(pair) for pair in zip(*halves, strict=True))
    return _MetricParts._make(np.concatenate(columns) for columns in zip(*done, strict=True))


def _maps(metric: Metric, k: int) -> tuple[FloatArray, FloatArray]:
    """Return maps of vectors to those of the length in a metric, and the logarithmic density."""
    maps = metric.directions.swapaxes(1, 2) / metric.sizes[:, :, None]
    return maps, -np.log(metric.sizes[:, :k]).sum(axis=1)


def _lengths(edges: FloatArray, maps: FloatArray) -> FloatArray:
    """Return the lengths of the edges of cells, float64[n, m, dim], by a map for each cell."""
    return np.asarray(np.linalg.norm(edges @ maps.swapaxes(1, 2), axis=2))


def _volumes(corners: FloatArray, maps: FloatArray) -> FloatArray:
    """Return the measures of cells, by a map for each."""
    inside = (corners[:, 1:] - corners[:, :1]) @ maps.swapaxes(1, 2)
    k = inside.shape[1]
    # The product of the diagonal of R is the volume, without squares that lose digits.
    r = np.linalg.qr(inside.swapaxes(1, 2), mode="r")
    return np.asarray(np.abs(np.diagonal(r, axis1=1, axis2=2)).prod(axis=1) / math.factorial(k))


def _is_known(
    mesh: SimplexMesh,
    h: FloatArray,
    at: _SizeAt,
    g: float | None,
    samples: FloatArray | None,
) -> BoolArray:
    """Return in which cells the size is known from that at the corners."""
    if g is not None:
        known, pairs = np.empty(mesh.n_cells, np.bool_), _pairs(mesh.cell_dim)

        def judge(first: int, last: int) -> None:
            edges = _edges_of_cells(mesh, slice(first, last))
            corners = h[mesh.cells[first:last].T]
            reach = np.zeros(corners.shape)
            for length, pair in zip(edges, pairs, strict=True):
                for v in pair:
                    np.maximum(reach[v], length, out=reach[v])
            with np.errstate(invalid="ignore"):
                least = (corners - g * reach).max(axis=0)
            known[first:last] = edges.max(axis=0) <= of_background.EDGE_OVER_SIZE * least

        in_all_threads(judge, mesh.n_cells, _CELLS_AT_ONCE)
        return known
    longest, least = of_edges(mesh, np.max), h[mesh.cells.T].min(axis=0)
    least = np.minimum(least, at(centroids(mesh.points, mesh.cells)))
    if samples is not None and len(samples):
        cells, _, away = mesh.locator.nearest(samples)
        near = away <= 1e-9 * mesh.diagonal
        np.minimum.at(least, cells[near], at(samples[near]))
    return np.asarray(longest <= of_background.EDGE_OVER_SIZE * least)


def _function_of(size: object) -> _SizeAt | None:
    """Return sizes as a function that checks its values; None for nodal values."""
    if not callable(size):
        return None
    return lambda points: as_sizes_at("size", size, points)


def _slope(size: object) -> float | None:
    """Return a bound on the gradient of a size function, None if none is known."""
    if not isinstance(size, SizeFunction):
        return None
    if size.g is not None:
        return size.g
    sources = size.sources
    if sources is not None and size.report is not None:
        exact = all(part.found.proved is None for part in sources.parts)
        return size.report.g if exact else None
    if isinstance(size.background, CartesianGrid):
        steepest = _slope_on_grid(size.background, size.values)
        return steepest if steepest <= tuning.STEEP_SIZES else None
    return None


def _slope_on_grid(grid: CartesianGrid, values: FloatArray) -> float:
    """Return the largest slope of multilinear sizes; inf beside nodes without a bound."""
    squares = 0.0
    for d in range(grid.dim):
        with np.errstate(invalid="ignore"):
            steps = np.abs(np.diff(values, axis=d)) / grid.spacing[d]
        if grid.active is not None:
            both = np.moveaxis(grid.active, d, 0)
            steps = np.moveaxis(steps, d, 0)[both[1:] & both[:-1]]
        squares += float(np.nan_to_num(steps, nan=0.0, posinf=np.inf).max(initial=0.0)) ** 2
    return float(np.sqrt(squares))


def _nodes_of(size: object) -> FloatArray | None:
    """Return the nodes of the background of a size function, if it has one."""
    if not isinstance(size, SizeFunction):
        return None
    background = size.background
    if not isinstance(background, CartesianGrid):
        return background.points
    active = np.isfinite(size.values)
    if background.active is not None:
        active &= background.active
    return places_of(background)(np.flatnonzero(active))


def nodes_near(size: SizeFunction, points: FloatArray) -> IndexArray:
    """Return the nearest nodes of the background of a size function, by their flat index."""
    background = size.background
    if isinstance(background, CartesianGrid):
        place = np.rint((points - background.origin) / background.spacing).astype(np.intp)
        place = np.clip(place, 0, np.array(background.shape) - 1)
        return np.asarray(np.ravel_multi_index(tuple(place.T), background.shape))
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(background.points).query(points)[1])
