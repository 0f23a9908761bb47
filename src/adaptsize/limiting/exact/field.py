"""The limited size as a function: sources, corners and walls determine it at any point."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptsize._kernels import exact as kernels
from adaptsize._kernels import exact_plane as plane
from adaptsize._kernels.sight import Sight
from adaptsize._progress import silent
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import unique_rows
from adaptsize.limiting.exact.waves import Wave, wave_at
from adaptsize.limiting.exact.work import in_chunks
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.limiting.exact.network import Network


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
    linear: bool
    """Whether edges and faces may be among the entries; their kernels take longer to compile."""
    waves: list[Wave] = field(default_factory=list)
    network: Network | None = None
    """Paths over reflex edges, in a solid that is not convex."""
    radius: float | None = None
    """Radius of a sphere around 0 along which distances run; all entries are nodes then."""

    def add(self, wave: Wave) -> None:
        """Add entries."""
        self.waves.append(wave)

    @property
    def n_entries(self) -> int:
        """Number of entries of all waves."""
        return sum(len(wave.nodes) for wave in self.waves)

    @property
    def edges(self) -> bool | None:
        """The argument ``edges`` of the kernels."""
        return True if self.linear else None

    def lower_by_last(
        self,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        threads: int,
        report: ProgressCallback,
        *,
        once: bool = False,
    ) -> None:
        """Lower sizes (In/Out, with ``source``) by the entries of the last wave.

        ``once``: whether to find out only which sizes are lowered, not by how much.
        """
        number = len(self.waves) - 1
        self._lower(number, points, sizes, source, threads, report, once=once)

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
        numbers = np.flatnonzero(which).astype(np.int32)
        found = np.full(len(source), -1, np.int32)
        part = ExactField(self.g, self.sight, self.linear, [self.waves[-1].only(which)])
        part.lower_by_last(points, sizes, found, threads, report)
        source[found >= 0] = numbers[found[found >= 0]]

    def evaluate(self, places: FloatArray, bound: FloatArray) -> FloatArray:
        """Return the minimum of ``bound`` and the allowed sizes at points of the domain."""
        sizes = bound.copy()
        if len(places) == 0:
            return sizes
        places = np.ascontiguousarray(places)
        points = Points(places, along_curve(places), np.full(len(places), -1, np.int32))
        source = np.empty(len(places), np.int32)
        for number in range(len(self.waves)):
            self._lower(number, points, sizes, source, 1, silent)
        return sizes

    def _lower(
        self,
        number: int,
        points: Points,
        sizes: FloatArray,
        source: IntArray,
        threads: int,
        report: ProgressCallback,
        *,
        once: bool = False,
    ) -> None:
        wave, sight = self.waves[number], self.sight
        offset = sum(len(wave.nodes) for wave in self.waves[:number])
        dim = points.places.shape[1]
        places, order, on_wall = (read_only(array) for array in points)
        found = np.full(len(places), -1, np.int32) if offset else source
        edges = self.edges

        def task(first: int, last: int) -> None:
            block = kernels.new_block(dim)
            entries = (wave.table, wave.boxes)
            given = (places, (0,) * dim, order, first, last, *entries, self.g, sizes, found)
            if sight is None:
                faces = edges if dim == 3 else None
                kernels.lower_sizes(*given, once, edges, faces, self.radius, block)
            else:
                rays = plane.new_rays()
                plane.lower_seen(*given, edges, on_wall, sight, block, rays)

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
    field = ExactField(g, None, True)
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
