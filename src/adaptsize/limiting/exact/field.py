"""Entries of the exact method, with a tree over them, and the sizes that they allow at points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from adaptsize._kernels import exact as kernels
from adaptsize._kernels import exact_plane as plane
from adaptsize._kernels.sight import Sight, new_rays
from adaptsize._workers import Workers, in_all_threads
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import unique_rows
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Entries per chunk of a thread, a part of a millisecond.
_ENTRIES = 1 << 13


class Entries(NamedTuple):
    """Entries that are processed together, along a Morton curve."""

    table: FloatArray
    """float64[m, dim * (dim + 1)], or more columns in the plane (see exact.py, exact_plane.py)."""
    boxes: FloatArray
    """The tree over them (see trees.py)."""
    nodes: IntArray
    """int32[m, dim]: nodes of each entry, padded with -1."""

    @property
    def places(self) -> FloatArray:
        """float64[m, dim, dim]: vertices, the first one repeated where there are fewer."""
        dim = self.nodes.shape[1]
        return self.table[:, : dim * dim].reshape(-1, dim, dim)

    @property
    def sizes(self) -> FloatArray:
        """float64[m, dim]: bounds at the vertices, padded with inf."""
        dim = self.nodes.shape[1]
        return self.table[:, dim * dim : dim * (dim + 1)]

    def only(self, which: BoolArray) -> Entries:
        """Return some of the entries."""
        return _with_tree(self.table[which], self.nodes[which])


def _with_tree(table: FloatArray, nodes: IntArray) -> Entries:
    m, dim = nodes.shape
    entries = Entries(table, np.empty(0), nodes)
    places, sizes = entries.places, entries.sizes
    lower, upper, value = np.empty((m, dim)), np.empty((m, dim)), np.empty(m)

    def bound(first: int, last: int) -> None:
        own = slice(first, last)
        lower[own] = upper[own] = places[own, 0]
        value[own] = sizes[own, 0]
        for v in range(
            1, dim
        ):  # column by column, a third of the time of the minimum along an axis
            np.minimum(lower[own], places[own, v], out=lower[own])
            np.maximum(upper[own], places[own, v], out=upper[own])
            np.minimum(value[own], sizes[own, v], out=value[own])

    in_all_threads(bound, m, _ENTRIES)
    return entries._replace(boxes=boxes_over(lower, upper, value))


def sorted_entries(table: FloatArray, nodes: IntArray) -> Entries:
    """Return entries in any order as entries."""
    order = along_curve(table[:, : nodes.shape[1]])
    return _with_tree(table[order], nodes[order])


def node_table(places: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return the table of nodes."""
    m, dim = places.shape
    table = np.full((m, dim * (dim + 1)), np.inf)
    for v in range(dim):
        table[:, v * dim : (v + 1) * dim] = places
    table[:, dim * dim] = sizes
    return table


# The tables are the largest arrays of the exact method.  They are made in their final order: there
# is never a second one.


def node_entries(
    places: FloatArray, sizes: FloatArray, names: IntArray, threads: int = 1
) -> Entries:
    """Return nodes as entries."""
    order = along_curve(places, threads)
    nodes = np.full(places.shape, -1, np.int32)
    nodes[:, 0] = names[order]
    return _with_tree(node_table(places[order], sizes[order]), nodes)


def entries_at(points: FloatArray, sizes: FloatArray, named: IntArray) -> Entries:
    """Return nodes, edges or triangles, given by their nodes padded with -1, as entries.

    Edges and triangles represent their interior only.  Their nodes, and the edges of triangles,
    are separate entries.
    """
    m, dim = named.shape
    named = named[along_curve(points[named[:, 0]])]
    table = np.empty((m, dim * (dim + 1)))
    for v in range(dim):
        used = np.where(named[:, v] >= 0, named[:, v], named[:, 0])
        table[:, v * dim : (v + 1) * dim] = points[used]
        table[:, dim * dim + v] = np.where(named[:, v] >= 0, sizes[used], np.inf)
    return _with_tree(table, named)


class Points(NamedTuple):
    """Points at which sizes are computed."""

    places: FloatArray
    """float64[n, dim]"""
    order: IntArray
    """int32[k]: the points to process, along a Morton curve."""
    on_wall: IntArray = np.empty(0, np.int32)
    """int32[n]: row of each boundary node in the sectors, -1 for other points; empty in a convex
    domain."""


@dataclass(eq=False)
class ExactField:
    """The sources that determine the size at any point of a domain.

    The entries of all groups are numbered consecutively; ``source`` arrays hold these numbers.
    """

    g: float
    sight: Sight | None
    """None in a convex domain."""
    linear: bool
    """Whether edges and faces may be among the entries; their kernels take longer to compile."""
    groups: list[Entries] = field(default_factory=list)
    radius: float | None = None
    """Radius of a sphere around 0 along which distances run; all entries are nodes then."""

    @property
    def table(self) -> FloatArray:
        """The table of the entries of all groups."""
        return np.concatenate([entries.table for entries in self.groups])

    @property
    def nodes(self) -> IntArray:
        """The nodes of the entries of all groups."""
        return np.concatenate([entries.nodes for entries in self.groups])

    def lower_by_last(
        self,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        workers: Workers,
        *,
        once: bool = False,
    ) -> None:
        """Lower sizes (In/Out, with ``source``) by the last entries; ``once``: by any of them."""
        entries, sight, edges = self.groups[-1], self.sight, True if self.linear else None
        dim = points.places.shape[1]
        places, order, on_wall = (read_only(array) for array in points)
        offset = sum(len(before.nodes) for before in self.groups[:-1])
        found = np.full(len(source), -1, np.int32) if offset else source

        def task(first: int, last: int) -> None:
            block = kernels.new_block(dim)
            tree, lowered = (entries.table, entries.boxes), (sizes, found)
            given = (places, (0,) * dim, order, (first, last), tree, self.g, lowered)
            if sight is None:
                faces = edges if dim == 3 else None
                kernels.lower_sizes(*given, once, edges, faces, self.radius, block)
            else:
                plane.lower_seen(*given, edges, on_wall, sight, block, new_rays())

        workers.in_chunks(task, len(order))
        if offset:
            lowered: BoolArray = found >= 0
            source[lowered] = found[lowered] + offset

    def keep_survivors(self, margin: float, workers: Workers) -> None:
        """Drop those of the last entries, all nodes, that another one undercuts by a margin."""
        entries = self.groups[-1]
        order = np.arange(len(entries.nodes), dtype=np.int32)
        points = Points(entries.table[:, : entries.nodes.shape[1]].copy(), order)
        if self.sight is not None:
            points = points._replace(on_wall=entries.table[:, plane.ROW].astype(np.int32))
        sizes, source = entries.sizes[:, 0] - margin, np.full(len(order), -1, np.int32)
        self.lower_by_last(points, sizes, source, workers, once=True)
        self.groups[-1] = entries.only(source < 0)

    def lowered(
        self, points: Points, bound: FloatArray, workers: Workers
    ) -> tuple[FloatArray, IntArray]:
        """Return bounds, lowered by all entries, and these entries; -1 where a bound is kept."""
        sizes, source = bound.copy(), np.full(len(bound), -1, np.int32)
        for k in range(len(self.groups)):
            replace(self, groups=self.groups[: k + 1]).lower_by_last(points, sizes, source, workers)
        return sizes, source

    def evaluate(self, places: FloatArray, bound: FloatArray) -> FloatArray:
        """Return the minimum of ``bound`` and the allowed sizes at points of the domain."""
        if len(places) == 0:
            return bound.copy()
        places = np.ascontiguousarray(places)
        points = Points(places, along_curve(places), np.full(len(places), -1, np.int32))
        return self.lowered(points, bound, Workers(1))[0]


@dataclass(eq=False)
class ComponentSolution:
    """Sizes and their sources."""

    h: FloatArray
    source: IntArray
    """int32[n]: number of the entry in ``field``; -1 if the bound is kept, or if only ``nodes``
    names the source."""
    field: ExactField
    bend: FloatArray | None = None
    """float64[n, dim]: last bend of the path, nan if there is none; None if it follows from
    ``field``."""
    proved: BoolArray | None = None
    """bool[n]: nodes whose size is proved exact; None if all are."""
    lower: FloatArray | None = None
    """float64[n]: lower bounds, if not all nodes are proved."""
    nodes: IntArray | None = None
    """int32[n, dim]: the nodes of each source; None if they follow from ``source``."""
    finished: bool = True
    """Whether the search for paths around reflex edges was completed."""
    propagated: bool = False
    """Whether paths over reflex edges were propagated from node to node instead."""
    later: Callable[[], ExactField] | None = None
    """Makes ``between``."""
    interpolates: bool = False
    """Whether the sizes between the nodes are interpolated, and lowered by ``between``."""

    @cached_property
    def between(self) -> ExactField:
        """The sources for points between the nodes."""
        return self.field if self.later is None else self.later()

    def named(self) -> IntArray:
        """Return the nodes of the source of each size, padded with -1; the own one of a bound."""
        if self.nodes is not None:
            return self.nodes
        every = self.field.nodes
        nodes = np.full((len(self.source), every.shape[1]), -1, np.int32)
        nodes[:, 0] = np.arange(len(nodes))
        has = self.source >= 0
        nodes[has] = every[self.source[has]]
        return nodes

    def bends(self) -> FloatArray:
        """Return the last bend of the path to each node, nan if none; no rows if convex."""
        if self.bend is not None:
            return self.bend
        table = self.field.table
        if self.field.sight is None:
            return np.empty((0, self.field.groups[0].nodes.shape[1]))
        bend = np.full((len(self.source), 2), np.nan)
        nodes = np.flatnonzero(self.source >= 0)
        nodes = nodes[table[self.source[nodes], plane.CORNER] > 0.0]
        bend[nodes] = table[self.source[nodes], :2]
        return bend


def field_of_nodes(
    entries: Entries,
    g: float,
    margin: float,
    workers: Workers,
    radius: float | None = None,
    *,
    linear: bool = False,
) -> ExactField:
    """Return the field of the nodes that keep their bounds in a convex domain or on a sphere."""
    field = ExactField(g, None, linear, [entries], radius)
    field.keep_survivors(margin, workers)
    return field


def field_of_cells(points: FloatArray, cells: IntArray, sizes: FloatArray, g: float) -> ExactField:
    """Return the sizes allowed around segments or triangles with linear sizes.

    This is the minimum over all points y of the cells of h(y) + g |x - y|; obstacles in between
    are ignored.  Nodes whose size is inf, and cells with such a node, have no effect.
    """
    finite = np.isfinite(sizes)
    cells = cells[finite[cells].all(axis=1)]
    field = ExactField(g, None, True)
    nodes = np.full((np.count_nonzero(finite), points.shape[1]), -1, np.int32)
    nodes[:, 0] = np.flatnonzero(finite)
    field.groups.append(entries_at(points, sizes, nodes))
    if len(cells) == 0:
        return field
    sides = [cells[:, [v, w]] for v in range(cells.shape[1]) for w in range(v)]
    edges = unique_rows(np.concatenate(sides), len(points))[0]
    items = np.full((len(edges), points.shape[1]), -1, np.int32)
    items[:, :2] = edges
    if cells.shape[1] == 3:
        items = np.concatenate([items, cells])
    field.groups.append(entries_at(points, sizes, items))
    return field
