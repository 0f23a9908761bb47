"""Paths over reflex edges of a solid: sources, nodes of these edges, and chains of edges.

Paths are extended by one edge at a time.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import exact_space as kernels
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.space_network import bound_paths, extend_paths
from adaptsize._kernels.space_paths import LONGEST, Bases, Choice, Field, Paths, new_block
from adaptsize._kernels.space_sight import Sight
from adaptsize._workers import Workers
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.limiting.exact.candidates import EQUAL
from adaptsize.limiting.exact.field import node_table
from adaptsize.limiting.exact.obstacles_in_space import ReflexEdges
from adaptsize.limiting.exact.solid import Solid
from adaptsize.typing import BoolArray, FloatArray, IntArray


@dataclass(eq=False)
class Network:
    """Sources, nodes of reflex edges, and paths over these edges."""

    g: float
    sight: Sight
    reflex_edges: ReflexEdges
    paths: Paths
    n_sources: int
    depth: IntArray
    """int32[w]: number of edges of each path."""
    origin: IntArray
    """int32[b]: the source of each base, or the node of a reflex edge after them."""

    @property
    def faces(self) -> bool | None:
        """None if all sources are nodes; the code for others is then not compiled."""
        return True if bool((self.paths.bases.counts > 1).any()) else None

    def choice(self, which: IntArray) -> Choice:
        """Return some of the paths, with a tree over them."""
        which = which.astype(np.int32)
        lower, upper, middle = (np.empty((len(which), 3)) for _ in range(3))
        value = np.empty(len(which))
        bound_paths(self.paths, which, self.g, lower, upper, middle, value)
        order = along_curve(middle)
        return Choice(which[order], boxes_over(lower[order], upper[order], value[order]))

    def sources(self) -> Choice:
        """Return the straight paths from the sources."""
        return self.choice(np.arange(self.n_sources, dtype=np.int32))

    def alive(self) -> Choice:
        """Return the paths from nodes of reflex edges, and all over edges."""
        alive = np.isfinite(self.paths.offset)
        alive[: self.n_sources] = False
        return self.choice(np.flatnonzero(alive).astype(np.int32))

    def lower(
        self,
        order: IntArray,
        choice: Choice,
        field: Field,
        workers: Workers,
        hints: IntArray | None = None,
        sight: Sight | None = None,
    ) -> None:
        """Lower sizes (In/Out: field) at the nodes ``order`` by a choice of paths."""
        sight = self.sight if sight is None else sight
        tried = np.full(len(field.sizes), -1, np.int32) if hints is None else hints
        along = read_only(order)

        def task(first: int, last: int) -> None:
            given = (along, (first, last), self.paths, choice, tried)
            kernels.lower_by_paths(*given, sight, self.g, field, self.faces, new_block())

        workers.in_chunks(task, len(order))

    def set_reflex_nodes(self, which: IntArray, sizes: FloatArray) -> IntArray:
        """Lower the sizes at nodes of reflex edges; return the straight paths from them.

        Paths from there over edges end: they are made anew.
        """
        paths, base = self.paths, np.int32(self.n_sources) + which
        paths.bases.table[base, 9] = sizes
        paths.offset[np.isin(paths.base, base)] = np.inf
        paths.offset[base] = sizes
        return base

    def copied(self) -> tuple[Paths, IntArray, IntArray]:
        """Return the paths, their depths and origins, which the search changes."""
        table, offset = self.paths.bases.table.copy(), self.paths.offset.copy()
        bases = self.paths.bases._replace(table=table)
        return self.paths._replace(bases=bases, offset=offset), self.depth, self.origin

    def extend(self, fresh: IntArray, field: Field) -> IntArray:
        """Extend paths over reflex edges where this may lower the size of a place of the edge.

        At a place between two nodes, the size is at most that of either one plus g times the
        distance.  A path whose bound is below that nowhere lowers no size elsewhere either, since
        the path over the node is at least as short.  So no size depends on the paths left out.
        Paths that see none of some points of their last edge are not extended.

        Returns the new paths.
        """
        paths, edges, pieces = self.paths, self.reflex_edges.edges, self.reflex_edges.pieces
        h = field.sizes[self.reflex_edges.nodes][pieces.nodes]
        low, high = pieces.ends.T
        peak = np.clip(0.5 * (low + high) + 0.5 * (h[:, 1] - h[:, 0]) / self.g, low, high)
        ceiling = np.minimum(h[:, 0] + self.g * (peak - low), h[:, 1] + self.g * (high - peak))
        places = read_only(edges.start[pieces.edge] + peak[:, None] * edges.along[pieces.edge])
        order = read_only(np.arange(len(places), dtype=np.int32))
        given = (places, order, ceiling * (1.0 - EQUAL), pieces.edge)
        tested = (paths, self.choice(fresh), self.g)
        room = 16 * len(fresh) + 16 * len(places)
        while True:
            found = np.empty((room, 2), np.int32)
            count = kernels.list_extensions(*given, *tested, self.faces, new_block(), found)
            if count <= room:
                break
            room = count
        parent, piece = found[:count].T
        before = len(paths.base)
        self._append(parent, piece, h[piece])
        return np.arange(before, len(self.paths.base), dtype=np.int32)

    def seen(self, which: IntArray, workers: Workers) -> IntArray:
        """Return the paths that see a point of their last edge before they bend there.

        Only these are extended, and only paths from points.
        """
        paths, edges = self.paths, self.reflex_edges.edges
        which = which[paths.bases.counts[paths.base[which]] == 1]
        n, e = len(which), paths.edge[which]
        share = (np.arange(BLOCK) + 0.5) / BLOCK
        at = share * edges.length[e, None]
        places = edges.start[e, None] + at[:, :, None] * edges.along[e, None]
        places = np.concatenate([self.sight.stars.points, places.reshape(-1, 3)])
        size = len(places)
        order = np.arange(size - n * BLOCK, size, dtype=np.int32)
        rows = np.concatenate([self.sight.stars.rows, np.full(n * BLOCK, -1, np.int32)])
        stars = self.sight.stars._replace(points=read_only(places), rows=rows)
        hints = np.full(size, -1, np.int32)
        hints[order] = np.repeat(paths.parent[which], BLOCK)
        found = Field(np.full(size, np.inf), np.full(size, -1, np.int32), np.empty((size, 3)))
        none = self.choice(np.empty(0, np.int32))
        self.lower(order, none, found, workers, hints, self.sight._replace(stars=stars))
        seen: IntArray = which[found.path[order].reshape(n, BLOCK).max(axis=1) >= 0]
        return seen

    def _append(self, parent: IntArray, piece: IntArray, h: FloatArray) -> None:
        """Extend paths over pieces of edges; several pieces of one edge give one path.

        ``h``: float64[k, 2], the sizes at the ends of the pieces.
        """
        pieces = self.reflex_edges.pieces
        key = _key_of(pieces.edge[piece], parent)
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        number = number.ravel()
        edge, parent = pieces.edge[piece[first]], parent[first]
        ends = pieces.ends[piece]
        low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
        np.minimum.at(low, number, ends[:, 0])
        np.maximum.at(high, number, ends[:, 1])
        base = self.paths.base[parent]
        added, ok = self._extended(edge, parent, base, np.column_stack([low, high]))
        # The bound is that of the image; it is below the size from the node behind these places.
        image, offset = added.image[number], added.offset[number]
        part = _below(image, offset, ends, h, self.g)
        low[:], high[:] = np.inf, -np.inf
        np.minimum.at(low, number, part[:, 0])
        np.maximum.at(high, number, part[:, 1])
        added = added._replace(part=np.column_stack([low, high]))
        ok &= low < high
        self._put(added, ok)
        several = np.flatnonzero(ok & (self.paths.bases.counts[base] > 1))
        if len(several):
            edge, parent, part = edge[several], parent[several], added.part[several]
            base = self._points_of(edge, base[several])
            self._put(*self._extended(edge, parent, base, part))

    def _put(self, added: Paths, ok: BoolArray) -> None:
        """Add some of the given paths."""
        pairs = zip(self.paths[2:], added[2:], strict=True)
        self.depth = np.concatenate([self.depth, self.depth[added.parent[ok]] + 1])
        longer = [np.concatenate([old, new[ok]]) for old, new in pairs]
        self.paths = Paths(*self.paths[:2], *longer)

    def _points_of(self, edge: IntArray, base: IntArray) -> IntArray:
        """Return new bases, one point each of given edges and faces with linear sizes.

        Where a path over several edges starts on an edge or face is not searched for: it is where
        the middle of the first edge gets the least size from.
        """
        edges, bases = self.paths.edges, self.paths.bases
        middle = edges.start[edge] + 0.5 * edges.length[edge, None] * edges.along[edge]
        places, sizes, nodes = self._starts(base, middle)
        table = np.concatenate([bases.table, node_table(places, sizes)])
        counts = np.concatenate([bases.counts, np.ones(len(edge), np.int8)])
        more = Bases(table, counts, np.concatenate([bases.nodes, nodes]))
        self.paths = self.paths._replace(bases=more)
        self.origin = np.concatenate([self.origin, self.origin[base]])
        return np.arange(len(bases.counts), len(counts), dtype=np.int32)

    def _extended(
        self, edge: IntArray, parent: IntArray, base: IntArray, part: FloatArray
    ) -> tuple[Paths, BoolArray]:
        """Return paths from bases, extended over edges, and whether these may be shortest."""
        edges, k, straight = self.paths.edges, len(edge), self.paths.edge[parent] < 0
        middle = edges.start[edge] + part.mean(axis=1)[:, None] * edges.along[edge]
        foot, size, _ = self._starts(base, middle)
        if self.faces:
            size = np.where(straight, size - 2.0 * self.g * self._extent(base, foot), size)
        found = np.empty((k, 2)), np.empty(k), np.empty((k, 9)), *np.empty((2, k), np.bool_)
        given = edge, parent, base, part
        slack = self.sight.walls.slack
        extend_paths(self.paths, self.reflex_edges.obstacles, given, (foot, size), slack, found)
        image, offset, sector, skew, ok = found
        ok &= self.depth[parent] < LONGEST
        columns = (base, parent, edge, image, offset, sector, skew, part)
        return Paths(self.paths.bases, edges, *columns), ok

    def _starts(self, base: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return the points of bases from which paths to points x are straight.

        With the sizes there, and the nodes around these points.
        """
        bases = self.paths.bases
        foot, size, nodes = bases.table[base, :3], bases.table[base, 9], bases.nodes[base]
        which = np.flatnonzero(bases.counts[base] > 1)
        if len(which):
            found = np.empty((len(which), 3)), np.empty(len(which)), nodes[which]
            kernels.find_starts(bases, base[which], x[which], self.g, new_block(), *found)
            foot[which], size[which], nodes[which] = found
        return foot, size, nodes

    def _extent(self, base: IntArray, start: FloatArray) -> FloatArray:
        """Return the largest distance of a point in each base, where a path starts, to a vertex.

        On an edge or face, other points of the path start elsewhere.  By the triangle inequality,
        sizes are above those from ``start`` less g times twice this distance.
        """
        bases = self.paths.bases
        away = bases.table[base, :9].reshape(-1, 3, 3) - start[:, None]
        extent: FloatArray = np.linalg.norm(away, axis=2).max(axis=1)
        return np.where(bases.counts[base] > 1, extent, 0.0)


def _below(
    image: FloatArray, offset: FloatArray, ends: FloatArray, h: FloatArray, g: float
) -> FloatArray:
    """Return the parts of edges where images allow less than the sizes at both ends.

    With the image at the place f and the distance r from the edge, c = (h - offset) / g, and t
    measured from an end, the bound is lower where ((t - f)^2 + r^2)^(1/2) < c + t.
    """
    part, width = ends.copy(), np.diff(ends, axis=1)[:, 0]
    for end, sign in ((0, 1.0), (1, -1.0)):
        f = sign * (image[:, 0] - ends[:, end])
        c = (h[:, end] - offset) / g
        beyond = np.hypot(f, image[:, 1]) - c
        with np.errstate(divide="ignore", invalid="ignore"):
            t = 0.5 * beyond * (beyond + 2.0 * c) / (c + f)
        t = np.where((beyond > 0.0) & (c + f > 0.0), t, 0.0)
        part[:, end] += sign * np.clip(t - 1e-9 * width, 0.0, width)
    return part


def _key_of(edge: IntArray, parent: IntArray) -> npt.NDArray[np.int64]:
    """Return one number for an edge and a path that is extended over it."""
    return edge.astype(np.int64) << 32 | parent


def network_of(table: FloatArray, nodes: IntArray, g: float, solid: Solid) -> Network:
    """Return the straight paths from entries and nodes of reflex edges, with inf as size of these.

    ``table``: float64[m, 12], entries (see exact.py); ``nodes``: int32[m, 3], their nodes, padded
    with -1.
    """
    reflex_nodes = solid.reflex_edges.nodes
    m, k = len(table), len(reflex_nodes)
    ends = node_table(solid.points[reflex_nodes], np.full(k, np.inf))
    all_nodes = np.full((m + k, 3), -1, np.int32)
    all_nodes[:m] = nodes
    all_nodes[m:, 0] = reflex_nodes
    table = np.concatenate([table, ends])
    counts = np.concatenate([np.isfinite(table[:m, 9:]).sum(axis=1), np.ones(k)]).astype(np.int8)
    none = np.full(m + k, -1, np.int32)
    paths = Paths(
        Bases(table, counts, all_nodes),
        solid.reflex_edges.edges,
        np.arange(m + k, dtype=np.int32),
        none,
        none.copy(),
        np.zeros((m + k, 2)),
        table[:, 9:].min(axis=1),
        np.zeros((m + k, 9)),
        np.zeros(m + k, np.bool_),
        np.zeros((m + k, 2)),
    )
    return Network(
        g, solid.sight, solid.reflex_edges, paths, m, np.zeros(m + k, np.int32), paths.base
    )
