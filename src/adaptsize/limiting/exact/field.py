"""The limited size as a function: sources, corners and walls determine it at any point."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptsize._kernels import exact as kernels
from adaptsize._kernels import exact_items as items
from adaptsize._kernels import exact_plane as plane
from adaptsize._kernels.exact import Entries
from adaptsize._kernels.exact_plane import Seen, Sight
from adaptsize._kernels.sight import ANY
from adaptsize.background.topology import unique_rows
from adaptsize.limiting.exact.work import along_curve, entries_of, in_chunks, with_tree
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.limiting.exact.network import Network


class Wave(NamedTuple):
    """Entries that are processed together, and their nodes."""

    seen: Seen
    nodes: IntArray
    """int32[m, dim]: nodes of each entry, padded with -1."""

    @property
    def n_entries(self) -> int:
        """Number of entries."""
        return len(self.nodes)


def wave_of(entries: Entries, nodes: IntArray) -> Wave:
    """Return a wave of sources that act in all directions."""
    m, dim = len(entries.counts), entries.places.shape[2]
    cones, kinds = np.zeros((m if dim == 2 else 0, 4)), np.full(m, ANY, np.int8)
    return Wave(Seen(entries, cones, kinds, np.full(m, -1, np.int32), np.zeros(m, np.bool_)), nodes)


class Points(NamedTuple):
    """Points at which sizes are computed."""

    places: FloatArray
    """float64[n, dim]"""
    order: IntArray
    """int32[k]: the points to process, along a Morton curve."""
    on_wall: IntArray
    """int32[n]: row of each boundary node in the sectors, -1 for other points; empty in a convex
    domain."""


@dataclass(eq=False)
class ExactField:
    """The sources that determine the size at any point of a domain.

    The entries of all waves are numbered consecutively; ``source`` arrays hold these numbers.
    """

    g: float
    sight: Sight | None
    """None in a convex domain."""
    waves: list[Wave] = field(default_factory=list)
    network: Network | None = None
    """Paths over reflex edges, in a solid that is not convex."""

    def add(self, wave: Wave) -> None:
        """Add entries."""
        self.waves.append(wave)

    @property
    def n_entries(self) -> int:
        """Number of entries of all waves."""
        return sum(wave.n_entries for wave in self.waves)

    def lower_by_last(
        self,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        threads: int,
        report: ProgressCallback,
    ) -> None:
        """Lower sizes (In/Out, with ``source``) by the entries of the last wave."""
        number = len(self.waves) - 1
        self._lower(number, points, sizes, source, threads, report)

    def lower_by_some(
        self,
        which: BoolArray,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        threads: int,
        report: ProgressCallback,
    ) -> None:
        """Lower sizes like `lower_by_last`, by some of the entries of a single wave."""
        seen = self.waves[-1].seen
        numbers = np.flatnonzero(which).astype(np.int32)
        entries = with_tree(*(rows[which] for rows in seen.entries[:3]))
        cones = seen.cones[which] if len(seen.cones) else seen.cones
        few = Seen(entries, cones, *(rows[which] for rows in seen[2:]))
        found = np.full(len(source), -1, np.int32)
        part = ExactField(self.g, self.sight, [Wave(few, self.waves[-1].nodes[which])])
        part.lower_by_last(points, sizes, found, threads, report)
        source[found >= 0] = numbers[found[found >= 0]]

    def evaluate(self, places: FloatArray, bound: FloatArray, threads: int = 1) -> FloatArray:
        """Return the minimum of ``bound`` and the allowed sizes at points of the domain."""
        sizes = bound.copy()
        if len(places) == 0:
            return sizes
        places = np.ascontiguousarray(places)
        points = Points(places, along_curve(places), np.full(len(places), -1, np.int32))
        source = np.empty(len(places), np.int32)
        for number in range(len(self.waves)):
            self._lower(number, points, sizes, source, threads, _silent)
        return sizes

    def _lower(
        self,
        number: int,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        threads: int,
        report: ProgressCallback,
    ) -> None:
        wave = self.waves[number]
        offset = sum(wave.n_entries for wave in self.waves[:number])
        entries = wave.seen.entries
        places, order, on_wall = points
        axes = (0,) * places.shape[1]
        found = np.full(len(places), -1, np.int32) if offset else source
        several = bool((entries.counts > 1).any())
        faces = True if bool((entries.counts > 2).any()) else None

        def task(first: int, last: int) -> None:
            given = (places, axes, order, first, last)
            if self.sight is not None:
                plane.lower_seen(*given, wave.seen, self.sight, self.g, sizes, found, on_wall)
            elif several:
                items.lower_by_items(*given, entries, self.g, sizes, found, faces)
            else:
                kernels.lower_sizes(*given, entries, self.g, sizes, found)

        in_chunks(task, len(order), threads, report)
        if offset:
            new: BoolArray = found >= 0
            source[new] = found[new] + offset


def field_of_cells(points: FloatArray, cells: IntArray, sizes: FloatArray, g: float) -> ExactField:
    """Return the sizes allowed around segments or triangles with linear sizes.

    This is the minimum over all points y of the cells of h(y) + g |x - y|; obstacles in between
    are ignored.  Nodes whose size is inf, and cells with such a node, have no effect.
    """
    finite = np.isfinite(sizes)
    cells = cells[finite[cells].all(axis=1)]
    field = ExactField(g, None)
    nodes = np.full((np.count_nonzero(finite), points.shape[1]), -1, np.int32)
    nodes[:, 0] = np.flatnonzero(finite)
    field.add(wave_at(points, sizes, nodes))
    sides = [cells[:, [v, w]] for v in range(cells.shape[1]) for w in range(v)]
    edges = unique_rows(np.concatenate(sides), len(points))[0]
    items = np.full((len(edges), points.shape[1]), -1, np.int32)
    items[:, :2] = edges
    if cells.shape[1] == 3:
        items = np.concatenate([items, cells])
    field.add(wave_at(points, sizes, items))
    return field


def wave_at(points: FloatArray, sizes: FloatArray, named: IntArray) -> Wave:
    """Return nodes, edges or triangles, given by their nodes padded with -1, as sources.

    Edges and triangles represent their interior only.  Their nodes, and the edges of triangles,
    are separate sources.
    """
    used = named >= 0
    places = np.where(used[:, :, None], points[named], 0.0)
    own = np.where(used, sizes[named], np.inf)
    entries, order = entries_of(places, own, used.sum(axis=1).astype(np.int8))
    return wave_of(entries, named[order])


def _silent(text: str, share: float | None) -> None:
    """Ignore a progress report."""
