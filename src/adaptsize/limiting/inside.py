"""Sizes inside the solid that a surface encloses: from what is seen, else along the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.heap import new_heap
from adaptsize._kernels.inside import carry, find_weights, lower_by_seen
from adaptsize._workers import Workers, in_all_threads
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import rings
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.inside import NUDGE, ON, Inside, blended
from adaptsize.limiting import tuning
from adaptsize.limiting.exact import limit_points
from adaptsize.limiting.exact.field import Entries, ExactField, Points, field_of_cells
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Sizes are lowered by more than this share only.
_LESS = 1.0 - 1e-9
#: Points per chunk of a thread; each takes up to some 100 microseconds.
_POINTS_PER_CALL = 512


class InnerSource(Protocol):
    """A source inside a solid."""

    is_graded: ClassVar[bool]
    """Whether the gradient of the sizes from `aims` is at most g."""

    def aims(self, points: FloatArray, g: float) -> tuple[FloatArray, FloatArray]:
        """Return for each point the place from which the least size grows, and the size there."""

    def clipped(self, lower: float, upper: float) -> InnerSource:
        """Return the source with sizes clipped to two bounds."""

    @property
    def samples(self) -> FloatArray:
        """Places where the size is small, float64[n, 3]."""


class Aims(NamedTuple):
    """For each point the last bend of the path from the source of its size, or the source."""

    places: FloatArray
    """float64[n, 3]"""
    moved: FloatArray
    """float64[n, 3]: the same in the frame of the surface, those on it moved inside."""
    sizes: FloatArray
    """float64[n]: sizes there."""

    def only(self, which: npt.NDArray[np.integer]) -> Aims:
        """Return some of them."""
        return Aims(self.places[which], self.moved[which], self.sizes[which])


class Limited(NamedTuple):
    """Sizes at the nodes of a surface, and where they come from."""

    h: FloatArray
    roots: IndexArray
    """The source of each size: a node, or n_points + k for the k-th of ``places``."""
    places: FloatArray
    """The given points, and those where sizes of inner sources begin to grow."""
    aims: Aims


def limit_inside(
    mesh: SimplexMesh,
    solid: tuple[Inside, FloatArray],
    bound: FloatArray,
    points: tuple[FloatArray, FloatArray],
    sources: Sequence[InnerSource],
    g: float,
    workers: Workers,
) -> Limited:
    """Return the limited sizes at the nodes of a surface, which grow inside the solid.

    The straight line to the source that would give the smallest size is tested for each node.
    Where it leaves the solid, the sources of the neighbours are tried, and the path along the edge
    from a neighbour.  The result is the length of a path inside the solid or along its surface,
    and the shortest one where it is straight.

    Parameters
    ----------
    mesh : SimplexMesh
        The surface, or parts of its facets.
    solid : tuple of Inside, float64[n_points, 3]
        With the outward normals at the nodes of ``mesh``.
    bound : float64[n_points]
    points : tuple of float64[k, 3], float64[k]
        Bounds between the nodes: places inside or on the surface, and sizes.
    sources : sequence of InnerSource
    g : float
    workers : Workers
    """
    n, inside = mesh.n_points, solid[0]
    places, sizes = np.concatenate([mesh.points, points[0]]), np.concatenate([bound, points[1]])
    found = limit_points(places, sizes, n, g, workers)
    aims, h = found.named()[:, 0].astype(np.int32), found.h
    inner = inside.nudged(places, np.concatenate([solid[1], np.zeros_like(points[0])]))
    used = np.unique(aims[aims >= n])
    inner[used], _ = inside.moved_inside(places[used])
    is_hidden = np.zeros(n, np.bool_)
    moved = np.flatnonzero(aims != np.arange(n))
    is_hidden[moved] = inside.hidden(inner[moved], inner[aims[moved]], workers)
    _take_next(inside, found.field, (places, inner, solid[1]), bound, is_hidden, h, aims)
    sizes[:n] = h
    for source in sources:
        at, size = source.aims(mesh.points, g)
        straight = size + g * np.linalg.norm(mesh.points - at, axis=1)
        better = np.flatnonzero(straight < sizes[:n] * _LESS)
        targets, lost = inside.moved_inside(at[better])
        size[better] += g * lost
        straight[better] += g * lost
        unseen = inside.hidden(inner[better], targets, workers)
        is_hidden[better[unseen]] = True
        better, targets = better[~unseen], targets[~unseen]
        aims[better] = len(places) + np.arange(len(better))
        sizes[better] = straight[better]
        places, inner = np.concatenate([places, at[better]]), np.concatenate([inner, targets])
        sizes = np.append(sizes, size[better])
    if is_hidden.any():
        _try_near(inside, (places, inner, sizes), n, is_hidden, aims, g, workers)
        tree, two_sided = inside.walls
        around = _neighbours(mesh)
        carry(tree, two_sided, g, places, inner, around, is_hidden, sizes, aims, new_heap(n))
    at_aims = Aims(places[aims], inner[aims], sizes[aims])
    return Limited(sizes[:n].copy(), _roots(aims, len(places)), places[n:], at_aims)


def _take_next(
    inside: Inside,
    field: ExactField,
    at: tuple[FloatArray, FloatArray, FloatArray],
    bound: FloatArray,
    is_hidden: BoolArray,
    h: FloatArray,
    aims: IntArray,
) -> None:
    """Set sizes at hidden nodes by the best of the sources that they see (In/Out: h, aims).

    ``at``: places, the same moved inside, and normals at the nodes.
    """
    nodes = np.flatnonzero(is_hidden)
    if len(nodes) == 0:
        return
    places, inner, normals = at
    normals = np.concatenate([normals, np.zeros((len(places) - len(normals), 3))])
    sizes, best = bound[nodes], nodes.astype(np.int32)
    for entries in field.groups:
        source = _lower_by_seen(
            inside, entries, normals, field.g, places[nodes], inner[nodes], sizes
        )
        best = np.where(source >= 0, entries.nodes[source, 0], best)
    h[nodes], aims[nodes] = sizes, best


def _lower_by_seen(
    inside: Inside,
    entries: Entries,
    normals: FloatArray,
    g: float,
    points: FloatArray,
    starts: FloatArray,
    sizes: FloatArray,
) -> IntArray:
    """Lower sizes (In/Out) by the entries seen from points; return these, -1 if none."""
    (tree, two_sided), frame = inside.walls, inside.faces.frame
    least, largest, together = tuning.MOST_HIDDEN
    most = min(max(least, together // max(len(points), 1)), largest)
    source = np.full(len(points), -1, np.int32)
    given = (
        tree, two_sided, (entries.table, entries.boxes, entries.nodes),
        read_only(normals), (read_only(frame.origin), frame.scale, NUDGE), g,
    )  # fmt: skip
    points, starts = read_only(points), read_only(starts)

    def task(first: int, last: int) -> None:
        part = slice(first, last)
        lower_by_seen(*given, points[part], starts[part], (sizes[part], source[part]), most)

    in_all_threads(task, len(points), _POINTS_PER_CALL)
    return source


def _try_near(
    inside: Inside,
    sources: tuple[FloatArray, FloatArray, FloatArray],
    n: int,
    is_hidden: BoolArray,
    aims: IntArray,
    g: float,
    workers: Workers,
) -> None:
    """Lower sizes at hidden nodes by seen sources between the nodes (In/Out: sizes, aims).

    ``sources``: places, the same moved inside, and sizes, the nodes first.
    """
    from scipy.spatial import cKDTree

    places, inner, sizes = sources
    if len(places) == n:
        return
    nodes, k = np.flatnonzero(is_hidden), np.arange(n, len(places))
    count = min(tuning.NEAREST_NODES, len(nodes))
    away, near = cKDTree(places[nodes]).query(places[n:], k=count)
    away, near = away.reshape(-1, count), nodes[near.reshape(-1, count)]
    straight = sizes[n:, None] + g * away
    row, column = np.nonzero(straight < sizes[near] * _LESS)
    node, value = near[row, column], straight[row, column]
    source = k[row]
    used = np.unique(source)
    inner[used], _ = inside.moved_inside(places[used])
    seen = ~inside.hidden(inner[node], inner[source], workers)
    order = np.flatnonzero(seen)[np.argsort(-value[seen], kind="stable")]  # the least last
    sizes[node[order]], aims[node[order]] = value[order], source[order]


def _neighbours(mesh: SimplexMesh) -> tuple[IntArray, IntArray]:
    """Return the neighbours of each node along edges, ascending, as compressed rows."""
    first, edge = rings(mesh.edges, mesh.n_points)
    node = np.repeat(np.arange(mesh.n_points, dtype=np.int32), np.diff(first))
    return first, mesh.edges[edge].sum(axis=1, dtype=np.int32) - node


def _roots(aims: IntArray, n_places: int) -> IndexArray:
    """Return the source where the path to each node begins, given its last bends."""
    further = np.arange(n_places)
    further[: len(aims)] = aims
    while True:  # each pass doubles the number of steps that are followed
        roots = further[further]
        if np.array_equal(roots, further):
            return np.asarray(roots[: len(aims)])
        further = roots


@dataclass(frozen=True, eq=False)
class InnerSizes:
    """What sizes on the surface of a solid need to grow inside it.

    Parameters
    ----------
    inside : Inside
    normals : float64[n_points, 3]
        Outward normals at the nodes that carry the sizes.
    aims : Aims, optional
        By default the nodes themselves.
    sources : tuple of InnerSource
    """

    inside: Inside
    normals: FloatArray
    aims: Aims | None = None
    sources: tuple[InnerSource, ...] = ()

    @classmethod
    def of(cls, surface: SimplexMesh) -> InnerSizes:
        """Return it for sizes at the nodes of any surface."""
        inside = Inside(Faces.of(surface))
        return cls(inside, inside.normals)

    def clipped(self, lower: float, upper: float) -> InnerSizes:
        """Return it for sizes at the nodes that were clipped to two bounds."""
        sources = tuple(source.clipped(lower, upper) for source in self.sources)
        return InnerSizes(self.inside, self.normals, None, sources)

    def reordered(self, place: npt.NDArray[np.integer]) -> InnerSizes:
        """Return it for nodes in another order."""
        aims = None if self.aims is None else self.aims.only(place)
        return replace(self, normals=self.normals[place], aims=aims)


@dataclass(frozen=True, eq=False)
class SolidField:
    """The size at any point of a solid, from sizes on its surface and sources inside.

    It is the least size that a source at a place y, seen from x, allows: size(y) + g |x - y|.
    Sources are the points of the surface, on which the sizes are linear, and those inside.  If the
    best one is hidden, the size is the least of those from the sources of the nodes around the
    closest point of the surface, and from that point itself, which is always seen.
    """

    mesh: SimplexMesh
    values: FloatArray
    g: float
    inner: InnerSizes

    @cached_property
    def _straight(self) -> tuple[ExactField, FloatArray, IntArray]:
        """The sizes if nothing were hidden, with the table and the nodes of its entries."""
        field = field_of_cells(self.mesh.points, self.mesh.cells, self.values, self.g)
        return field, field.table, field.nodes

    def evaluate(self, points: FloatArray, bound: FloatArray) -> FloatArray:
        """Return the minimum of ``bound`` and the sizes at points, those outside taken as near."""
        return self.with_hidden(points, bound)[0]

    def with_hidden(self, points: FloatArray, bound: FloatArray) -> tuple[FloatArray, IndexArray]:
        """Return the sizes, and the points from which the best source is hidden."""
        if len(points) == 0:
            return bound.copy(), np.empty(0, np.intp)
        points = np.ascontiguousarray(points)
        inside, workers = self.inner.inside, Workers.of(None)
        sizes, best = self._best(points, bound, workers)
        starts = inside.faces.frame.of(points)
        has = np.flatnonzero(sizes < bound)
        hidden = has[inside.hidden(starts[has], best.moved[has], workers, strict=True)]
        if len(hidden):
            sizes[hidden] = self._around(points[hidden], best.only(hidden), bound[hidden])
        return sizes, hidden

    def of_inner_sources(self, points: FloatArray, bound: FloatArray) -> FloatArray:
        """Return the minimum of ``bound`` and the sizes from the sources inside that are seen."""
        least, at = least_of(self.inner.sources, points, self.g)
        better = np.flatnonzero(least < bound)
        inside, sizes = self.inner.inside, bound.copy()
        starts = inside.faces.frame.of(points[better])
        ends = inside.moved_inside(at[better])[0]
        better = better[~inside.hidden(starts, ends, Workers.of(None))]
        sizes[better] = least[better]
        return sizes

    def _best(
        self, points: FloatArray, bound: FloatArray, workers: Workers
    ) -> tuple[FloatArray, Aims]:
        """Return the sizes if nothing were hidden, and from where."""
        field, table, nodes = self._straight
        order = Points(points, along_curve(points), np.full(len(points), -1, np.int32))
        sizes, source = field.lowered(order, bound, workers)
        weights = np.empty((len(points), 3))
        find_weights(table, source, read_only(points), self.g, weights)
        places = np.einsum("ij,ijk->ik", weights, table[source, :9].reshape(-1, 3, 3))
        normals = np.einsum("ij,ijk->ik", weights, self.inner.normals[nodes[source]])
        moved = self.inner.inside.nudged(places, normals)
        least, at = least_of(self.inner.sources, points, self.g)
        better = least < sizes
        sizes[better], places[better] = least[better], at[better]
        moved[better], _ = self.inner.inside.moved_inside(at[better])
        lengths = np.linalg.norm(points - places, axis=1)
        return sizes, Aims(places, moved, sizes - self.g * lengths)

    def _around(self, points: FloatArray, best: Aims, bound: FloatArray) -> FloatArray:
        """Return sizes at points that do not see the best source, or are not inside."""
        inner, g = self.inner, self.g
        around, weights, away = self.mesh.locator.weights(points)
        closest, normals = blended(self.mesh, inner.normals, around, weights)
        nodal = np.where(weights > 0.0, self.values[around], 0.0)
        sizes = np.minimum(bound, np.einsum("ij,ij->i", weights, nodal) + g * away)
        frame = inner.inside.faces.frame
        outside = np.einsum("ij,ij->i", points - closest, normals) > 0.0
        begin = np.where(outside[:, None], closest, points)
        starts = frame.of(begin)
        near = outside | (away * frame.scale < ON)
        starts[near] = inner.inside.nudged(closest[near], normals[near])
        lost = np.where(outside, g * away, 0.0)
        several = [best, *(self._aims_of(around[:, v]) for v in range(3))]
        for source in inner.sources:
            places, at_places = source.aims(begin, g)
            moved, beyond = inner.inside.moved_inside(places)
            several.append(Aims(places, moved, at_places + g * beyond))
        for aims in several:
            value = aims.sizes + g * np.linalg.norm(begin - aims.places, axis=1) + lost
            better = np.flatnonzero(value < sizes * _LESS)
            hidden = inner.inside.hidden(starts[better], aims.moved[better], Workers(1))
            better = better[~hidden]
            sizes[better] = value[better]
        if not inner.inside.is_crossed:
            sizes = self._of_next(begin, starts, sizes - lost) + lost
        return np.asarray(np.minimum(sizes, bound))

    def _of_next(self, points: FloatArray, starts: FloatArray, sizes: FloatArray) -> FloatArray:
        """Return the sizes that the best of the seen sources on the surface allow."""
        for entries in self._straight[0].groups:
            _lower_by_seen(
                self.inner.inside, entries, self.inner.normals, self.g, points, starts, sizes
            )
        return sizes

    def _aims_of(self, nodes: IntArray) -> Aims:
        """Return the aims of nodes."""
        if self.inner.aims is not None:
            return self.inner.aims.only(nodes)
        places = self.mesh.points[nodes]
        moved = self.inner.inside.nudged(places, self.inner.normals[nodes])
        return Aims(places, moved, self.values[nodes])


def least_of(
    sources: Sequence[InnerSource], points: FloatArray, g: float
) -> tuple[FloatArray, FloatArray]:
    """Return the least sizes that inner sources allow if nothing is hidden, and from where."""
    least, places = np.full(len(points), np.inf), points.copy()
    for source in sources:
        at, sizes = source.aims(points, g)
        straight = sizes + g * np.linalg.norm(points - at, axis=1)
        better = straight < least
        least[better], places[better] = straight[better], at[better]
    return least, places
