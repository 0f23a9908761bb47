"""Paths over reflex edges of a solid, extended by one edge at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import exact_space as kernels
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.space_bends import LONGEST
from adaptsize._kernels.space_paths import Bases, Choice, Field, Ways, new_block
from adaptsize._kernels.space_sight import Sight
from adaptsize._progress import silent
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.limiting.exact.reflex_edges import GRAZING, Knots
from adaptsize.limiting.exact.waves import node_table
from adaptsize.limiting.exact.work import boxes_over, in_chunks
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

SIZE = 32


@dataclass(eq=False)
class Network:
    """Sources, nodes of reflex edges, and paths over these edges."""

    g: float
    sight: Sight
    knots: Knots
    ways: Ways
    n_sources: int
    depth: IntArray
    """int32[w]: number of edges of each path."""
    used: Choice | None = None
    """All paths in use at the end, except the straight paths from sources."""

    @property
    def faces(self) -> bool | None:
        """None if all sources are nodes, True otherwise."""
        return True if bool((self.ways.bases.counts > 1).any()) else None

    def choice(self, which: IntArray) -> Choice:
        """Return some of the paths, with a tree over them."""
        ways, edges, bases = self.ways, self.ways.edges, self.ways.bases
        base, edge = ways.base[which], ways.edge[which]
        bent = edge >= 0
        places = bases.table[base, :9].reshape(-1, 3, 3)
        lower, upper = places.min(axis=1), places.max(axis=1)
        value = bases.table[base, 9:].min(axis=1)
        e, w = edge[bent], which[bent]
        ends = np.stack([edges.start[e], edges.start[e] + edges.length[e, None] * edges.along[e]])
        lower[bent], upper[bent] = ends.min(axis=0), ends.max(axis=0)
        beyond = ways.image[w, 0] - np.clip(ways.image[w, 0], 0.0, edges.length[e])
        value[bent] = ways.offset[w] + self.g * np.hypot(beyond, ways.image[w, 1])
        order = along_curve(0.5 * (lower + upper))
        boxes = boxes_over(lower[order], upper[order], value[order])
        return Choice(which[order].astype(np.int32), boxes, len(boxes) // 2)

    def sources(self) -> Choice:
        """Return the straight paths from the sources."""
        return self.choice(np.arange(self.n_sources, dtype=np.int32))

    def lower(
        self,
        points: FloatArray,
        nodes: IntArray,
        order: IntArray,
        choice: Choice,
        field: Field,
        *,
        hints: IntArray | None = None,
        size: int | None = None,
        threads: int = 1,
        report: ProgressCallback | None = None,
    ) -> None:
        """Lower sizes (In/Out: field) at the points ``order`` by a choice of paths."""
        tried = np.full(len(points), -1, np.int32) if hints is None else hints
        faces = self.faces
        size = size or (BLOCK if hints is not None else SIZE)
        places, along = read_only(points), read_only(order)

        def task(first: int, last: int) -> None:
            span = (first, last, size)
            given = (places, nodes, along, span, self.ways, choice, tried)
            kernels.lower_by_ways(*given, self.sight, self.g, field, faces, new_block())

        in_chunks(task, len(order), threads, report or silent)

    def set_knots(self, sizes: FloatArray) -> None:
        """Set the sizes at the nodes of reflex edges."""
        m = self.n_sources
        self.ways.bases.table[m:, 9] = sizes
        moves = self.ways.base >= m
        self.ways.offset[moves] = self.ways.bases.table[self.ways.base[moves], 9]

    def extend(self, changed: IntArray, field: Field) -> IntArray:
        """Extend the paths to nodes of reflex edges over these edges and adjacent ones.

        Returns the paths that are new or start from a node that may have been lowered.
        """
        ways = self.ways
        edge, parent, source, node = self.candidates(changed, field)
        ok = (parent >= 0) & (self.depth[parent] < LONGEST) & (ways.edge[parent] != edge)
        key, at = np.unique(key_of(edge[ok], parent[ok]), return_index=True)
        old = np.flatnonzero(ways.edge >= 0)
        old_key = key_of(ways.edge[old], ways.parent[old])
        again = old[np.isin(old_key, key) & (ways.base[old] >= self.n_sources)]
        at = np.flatnonzero(ok)[at[~np.isin(key, old_key)]]
        self._append(edge[at], parent[at], source[at], node[at], field)
        return np.concatenate([again, np.arange(len(ways.base), len(self.ways.base))])

    def candidates(
        self, changed: IntArray, field: Field
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return edges, the paths to extend, the nodes where these end, and the next nodes."""
        knots = self.knots
        marked = np.zeros(len(knots.nodes), bool)
        marked[changed] = True
        here = np.flatnonzero(marked[knots.knot])
        node, edge = knots.nodes[knots.knot[here]], knots.edge[here]
        beside = knots.beside[edge]
        near = beside.tocoo()
        node = np.concatenate([node, node[near.row]])
        source = node
        edge = np.concatenate([edge, near.col])
        goal = np.concatenate([node[: len(here)], knots.nodes[near.data - 1]])
        return edge, field.way[source], source, goal

    def _append(
        self,
        edge: IntArray,
        parent: IntArray,
        source: IntArray,
        node: IntArray,
        field: Field,
    ) -> None:
        """Add paths to ``source`` that continue over edges at ``node``, if they may be shortest."""
        ways, edges, points = self.ways, self.knots.edges, self.sight.stars.points
        straight = ways.edge[parent] < 0
        away = np.linalg.norm(points[source] - field.last[source], axis=1)
        away += 2.0 * self._extent(ways.base[parent], field.last[source])
        offset = np.where(straight, field.sizes[source] - self.g * away, ways.offset[parent])
        along, normals = edges.along[edge], edges.normals[edge]
        volume = np.einsum(
            "ra,ra->r",
            np.cross(edges.along[ways.edge[parent]], along),
            edges.start[edge] - edges.start[ways.edge[parent]],
        )
        skew = ways.skew[parent] | (~straight & (np.abs(volume) > self.sight.walls.slack))

        origin = np.where(straight[:, None], field.last[source], self._turned(parent, points[node]))
        piece = points[node] - origin
        rise = np.einsum("ra,ra->r", piece, along)
        place = np.einsum("ra,ra->r", points[node] - edges.start[edge], along)
        away = np.linalg.norm(piece - rise[:, None] * along, axis=1)
        image = np.column_stack([place - rise, away])
        # The previous piece starts at one point, or at any point between the ends of an edge.
        before = edges.start[ways.edge[parent]]
        after = before + (edges.length[:, None] * edges.along)[ways.edge[parent]]
        ends = np.where(straight[:, None], field.last[source], np.stack([before, after]))
        ahead = edges.start[edge] - ends
        ahead -= np.einsum("sra,ra->sr", ahead, along)[:, :, None] * along
        size = np.linalg.norm(ahead, axis=2)
        ahead /= np.maximum(size, 1e-300)[:, :, None]
        nil = size <= 10.0 * self.sight.walls.slack
        ahead = np.where(nil[:, :, None], ahead[::-1], ahead)
        over = np.einsum("rfa,sra->srf", normals, ahead)
        # If the outside lies straight ahead, a path that bends here is not shortest.
        ok = (over.min(axis=2) <= GRAZING).any(axis=0) & ~nil.all(axis=0)
        side = over.argmin(axis=2)
        shade = np.empty((len(node), 9))
        shade[:, :3] = np.where(
            (side[0] == side[1])[:, None], normals[np.arange(len(node)), side[0]], 0.0
        )
        for end in range(2):
            beside = np.cross(ahead[end], along)
            turned = np.einsum("ra,ra->r", beside, self.knots.obstacles[edge]) < 0.0
            shade[:, 3 + 3 * end : 6 + 3 * end] = np.where(turned[:, None], -beside, beside)
        self.depth = np.concatenate([self.depth, self.depth[parent[ok]] + 1])
        self.ways = Ways(
            ways.bases,
            ways.edges,
            np.concatenate([ways.base, ways.base[parent[ok]]]),
            np.concatenate([ways.parent, parent[ok]]),
            np.concatenate([ways.edge, edge[ok]]),
            np.concatenate([ways.image, image[ok]]),
            np.concatenate([ways.offset, offset[ok]]),
            np.concatenate([ways.shade, shade[ok]]),
            np.concatenate([ways.skew, skew[ok]]),
        )

    def _extent(self, base: IntArray, foot: FloatArray) -> FloatArray:
        """Return the largest distance of a point in each base, where a path starts, to a vertex.

        On an edge or face, other points of the path start elsewhere.  By the triangle inequality,
        sizes are above those from ``foot`` less g times twice this distance.
        """
        bases = self.ways.bases
        away = bases.table[base, :9].reshape(-1, 3, 3) - foot[:, None]
        extent: FloatArray = np.linalg.norm(away, axis=2).max(axis=1)
        return np.where(bases.counts[base] > 1, extent, 0.0)

    def _turned(self, way: IntArray, x: FloatArray) -> FloatArray:
        """Return the bases of paths, rotated about their last edges to opposite points x."""
        e = self.ways.edge[way]
        start, along = self.ways.edges.start[e], self.ways.edges.along[e]
        across = x - start
        across -= np.einsum("ra,ra->r", across, along)[:, None] * along
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
        f, r = self.ways.image[way].T
        turned: FloatArray = start + f[:, None] * along - r[:, None] * across
        return turned


def key_of(edge: IntArray, parent: IntArray) -> npt.NDArray[np.int64]:
    """Return one number for an edge and a path that is extended over it."""
    return edge.astype(np.int64) << 32 | parent


def network_of(table: FloatArray, nodes: IntArray, g: float, sight: Sight, knots: Knots) -> Network:
    """Return a network of straight paths; the sizes at the nodes of reflex edges are inf.

    Parameters
    ----------
    table : float64[m, 12]
        Entries (see exact.py).
    nodes : int32[m, 3]
        Their nodes, padded with -1.
    g, sight, knots
    """
    m, k = len(table), len(knots.nodes)
    ends = node_table(sight.stars.points[knots.nodes], np.full(k, np.inf))
    all_nodes = np.full((m + k, 3), -1, np.int32)
    all_nodes[:m] = nodes
    all_nodes[m:, 0] = knots.nodes
    table = np.concatenate([table, ends])
    counts = np.concatenate([np.isfinite(table[:m, 9:]).sum(axis=1), np.ones(k)]).astype(np.int8)
    none = np.full(m + k, -1, np.int32)
    ways = Ways(
        Bases(table, counts, all_nodes),
        knots.edges,
        np.arange(m + k, dtype=np.int32),
        none,
        none.copy(),
        np.zeros((m + k, 2)),
        table[:, 9:].min(axis=1),
        np.zeros((m + k, 9)),
        np.zeros(m + k, np.bool_),
    )
    return Network(g, sight, knots, ways, m, np.zeros(m + k, np.int32))
