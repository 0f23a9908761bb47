"""The input of the exact method, and its candidate sources: nodes, edges and faces."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptsize._kernels import exact_candidates as kernels
from adaptsize._kernels.exact import new_block
from adaptsize._workers import Workers
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import unique_rows
from adaptsize.limiting.exact.field import (
    Entries,
    ExactField,
    Points,
    entries_at,
    node_entries,
)
from adaptsize.limiting.problem import PointBounds
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Sizes that differ by less than this share are equal.
EQUAL = 1e-12

#: Cells per chunk of a thread, a millisecond.
_CELLS = 1 << 15

#: Share by which sizes of paths may exceed those along edges of the mesh that they explain.
TIE = 1e-10


class Extra(NamedTuple):
    """Sources between the nodes."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""
    numbers: IntArray
    """int32[k]: numbers that follow those of the nodes."""

    @classmethod
    def of(cls, given: PointBounds, which: IntArray, n_points: int) -> Extra:
        """Return some of the given sources, in a domain with this number of nodes."""
        points = np.ascontiguousarray(given.points[which])
        return cls(points, given.sizes[which], np.int32(n_points) + which)


class ConvexNodes(NamedTuple):
    """Bounds at the nodes of a convex domain only."""

    domain: SimplexMesh | CartesianGrid
    h0: FloatArray
    """float64[n_points]"""
    g: float
    workers: Workers
    extra: Extra | None = None
    margin: float = 0.0
    """As in `Component`."""

    @classmethod
    def of(cls, component: Component) -> ConvexNodes:
        """Return the bounds at the nodes of a convex component."""
        mesh, h0, g, workers = component.mesh, component.h0, component.g, component.workers
        return cls(mesh, h0, g, workers, component.extra, component.margin)

    def places(self, nodes: IntArray) -> FloatArray:
        """Return the positions of nodes."""
        domain = self.domain
        if not isinstance(domain, CartesianGrid):
            return np.asarray(domain.points[nodes])
        index = np.stack(np.unravel_index(nodes, domain.shape), axis=1)
        return np.asarray(domain.origin + domain.spacing * index)


class Component(NamedTuple):
    """A component of the domain with bounds."""

    mesh: SimplexMesh
    h0: FloatArray
    g: float
    face_sources: bool
    workers: Workers
    extra: Extra | None = None
    linear: IntArray | None = None
    """int32[m, dim + 1]: simplices on which h0 is linear, if not the cells."""

    order: IntArray | None = None
    """int32[n_points]: the nodes along a Morton curve, if known."""
    meet: bool | None = None
    """Whether two nodes of any simplex have bounds, if known."""
    margin: float = 0.0
    """Source i makes source j unnecessary if it allows less than the bound of j by more than this.

    This is well above rounding, and above the tolerances of lines of sight.  Hence no size depends
    on which sources are found to be unnecessary, bit for bit, and neither does it depend on
    whether all other sources are known, as they are not on one of many processes.
    """
    merge: Callable[[IntArray], IntArray] | None = None
    """Adds the rows of other processes to those of `kernels.list_edges`; None on a single one."""
    complete: Callable[[Entries], Entries] | None = None
    """Adds the nodes that other processes keep to those kept here, where all bounds are few."""
    at_any_price: bool = True
    """As in `Problem`."""
    links: SimplexMesh | None = None
    """Fills a solid that is not convex, more than once perhaps, if not ``mesh``: sizes propagate
    along its edges at least, and edges and faces as sources are among its own."""

    def places(self, nodes: IntArray) -> FloatArray:
        """Return the positions of nodes."""
        return np.asarray(self.mesh.points[nodes])

    @property
    def cells(self) -> IntArray:
        """Simplices on which h0 is linear."""
        return self.mesh.cells if self.linear is None else self.linear

    @property
    def least(self) -> float:
        """The smallest bound."""
        between = np.inf if self.extra is None else self.extra.sizes.min(initial=np.inf)
        return float(min(self.h0.min(), between))

    def with_margin(self) -> Component:
        """Return the problem with the margin for a domain with these nodes and bounds."""
        return self._replace(margin=margin_for(self.least, self.g, self.mesh.diagonal))


def margin_for(least: float, g: float, diagonal: float) -> float:
    """Return the margin of a problem with a least bound in a domain of a given diagonal."""
    # A source must be better by this share of the largest size to make another one unnecessary.
    return 1e-9 * (least + g * diagonal)


def bounds_meet(cells: IntArray, h0: FloatArray, threads: int) -> bool:
    """Return whether any cell has two nodes with bounds."""
    found: list[int] = []

    def task(first: int, last: int) -> None:
        if not found and kernels.have_neighbours(cells[first:last], h0):
            found.append(first)

    Workers(threads).in_chunks(task, len(cells), _CELLS)
    return bool(found)


def entries_of_nodes(component: Component | ConvexNodes, nodes: IntArray) -> Entries:
    """Return nodes, and sources between nodes, as entries."""
    places = component.places(nodes)
    sizes, extra = component.h0[nodes], component.extra
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes, nodes = np.concatenate([sizes, extra.sizes]), np.concatenate([nodes, extra.numbers])
    return node_entries(places, sizes, nodes, component.workers.threads)


def candidates_of(component: Component) -> tuple[IntArray, BoolArray | None]:
    """Return the nodes that may be sources, and the steep cells if bounds meet in any cell."""
    mesh, cells, h0 = component.mesh, component.cells, component.h0
    threads = component.workers.threads
    if not (bounds_meet(cells, h0, threads) if component.meet is None else component.meet):
        return np.flatnonzero(np.isfinite(h0)).astype(np.int32), None
    steep, candidate = np.empty(len(cells), np.bool_), np.zeros(mesh.n_points, np.bool_)
    axes = (0,) * mesh.dim

    def task(kernel: Callable[..., None], about: float) -> Callable[[int, int], None]:
        def run(first: int, last: int) -> None:
            part, own = cells[first:last], steep[first:last]
            kernel(mesh.points, axes, part, h0, component.g, about, own, candidate)

        return run

    workers = Workers(threads)
    workers.in_chunks(task(kernels.mark_steep, component.face_sources), len(cells), _CELLS)
    workers.in_chunks(task(kernels.drop_dominated, component.margin), len(cells), _CELLS)
    return np.flatnonzero(candidate).astype(np.int32), steep


def sources_on_cells(
    component: Component,
    steep: BoolArray,
    h: FloatArray,
    found: tuple[IntArray, ExactField] | None = None,
) -> Entries:
    """Return the edges and faces of steep cells that may be sources.

    ``found``: the sources of the sizes h, and their field, in a convex domain.  There the edges and
    faces that these dominate are left out.
    """
    mesh, h0 = component.mesh, component.h0
    h = h + component.margin
    rows = _listed(kernels.list_edges, component, steep, h)
    if mesh.dim == 3:
        rows = np.concatenate([rows, _listed(kernels.list_faces, component, steep, h)])
    if component.merge is not None:
        rows = component.merge(rows)
    named = _chosen(rows, mesh.n_points)
    if found is not None:
        named = _undominated(component, named, h, *found)
    return entries_at(mesh.points, h0, named)


def _undominated(
    component: Component, named: IntArray, h: FloatArray, source: IntArray, field: ExactField
) -> IntArray:
    """Return edges and faces without those that a source of one of their nodes dominates.

    First the nodes are tested as such sources.  Then the remaining edges and faces with a node
    that keeps its bound are tested: where h0 has just become too steep, they dominate most others.
    """
    mesh, h0, g = component.mesh, component.h0, component.g
    axes = (0,) * mesh.dim
    below = h0 - component.margin

    def kept(rows: IntArray, source: IntArray, entries: Entries) -> BoolArray:
        keep = np.empty(len(rows), np.bool_)
        given = (*(read_only(array) for array in (rows, below, source)), entries.table)
        faces = True if mesh.dim == 3 else None
        block = new_block(mesh.dim)
        kernels.keep_undominated(mesh.points, axes, *given, g, faces, block, keep)
        return keep

    named = named[kept(named, source, field.groups[0])]
    used = named >= 0
    leads = (used & (source[named] < 0)).any(axis=1)
    if leads.all() or not leads.any():
        return named
    entries = entries_at(mesh.points, h0, named[leads])
    others = named[~leads]
    nodes = np.unique(others[others >= 0]).astype(np.int32)
    places = np.ascontiguousarray(mesh.points[nodes])
    points = Points(mesh.points, nodes[along_curve(places)])
    own = ExactField(g, None, True, [entries])
    _, found = own.lowered(points, h, component.workers.part(0.5, 0.5))
    others = others[kept(others, found, entries)]
    return np.concatenate([named[leads], others])


def _listed(
    kernel: Callable[..., int], component: Component, steep: BoolArray, h: FloatArray
) -> IntArray:
    """Return the edges or faces that a kernel lists, in the order of the cells."""
    mesh, n = component.mesh, len(steep)
    found = [np.empty((0, mesh.dim + 1), np.int32)] * max(1, -(-n // _CELLS))

    def task(first: int, last: int) -> None:
        given = mesh.points, (0,) * mesh.dim, component.cells[first:last], steep[first:last]
        room = 2 * int(np.count_nonzero(given[3]))  # more where most steep cells have sources
        while True:
            rows = np.empty((room, mesh.dim + 1), np.int32)
            count = kernel(*given, component.h0, h, component.g, rows)
            if count <= room:
                break
            room = count
        found[first // _CELLS] = rows[:count]

    Workers(component.workers.threads).in_chunks(task, n, _CELLS)
    return np.concatenate(found)


def _chosen(rows: IntArray, n_points: int) -> IntArray:
    """Return the edges and faces that may be sources in all their cells."""
    dim = rows.shape[1] - 1
    parts = []
    for width in range(2, dim + 1):
        own = rows[(rows[:, dim - 1] >= 0) == (width == dim)]
        unique, group = unique_rows(own[:, :width], n_points)
        allows = own[:, dim]
        kept = np.bincount(group, weights=allows & 1 == 0) == 0
        kept &= np.bincount(group, weights=allows & 2 > 0) > 0
        parts.append(np.full((int(kept.sum()), dim), -1, np.int32))
        parts[-1][:, :width] = unique[kept]
    return np.concatenate(parts)
