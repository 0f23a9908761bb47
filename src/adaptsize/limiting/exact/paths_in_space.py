"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`.

Paths over reflex edges are extended by one edge at a time.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import exact_space as kernels
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.heap import new_heap, push_all
from adaptsize._kernels.space_paths import LONGEST, Bases, Choice, Field, Paths, new_block
from adaptsize._kernels.space_relay import Relay, propagate
from adaptsize._kernels.space_sight import Sight
from adaptsize._workers import Workers
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import places_among
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.geometry.convexity import ridges_of
from adaptsize.geometry.flat_faces import with_flat_faces
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.candidates import (
    EQUAL,
    TIE,
    Component,
    Extra,
    candidates_of,
    entries_of_nodes,
    sources_on_cells,
)
from adaptsize.limiting.exact.field import (
    ComponentSolution,
    Entries,
    ExactField,
    Points,
    node_table,
)
from adaptsize.limiting.exact.obstacles_in_space import (
    GRAZING,
    ReflexEdges,
    build_sight,
    find_reflex_edges,
)
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Largest number of iterations; each allows paths one more bend.
_ROUNDS = 200

# In rough solids the paths may grow exponentially: 250 000 on 369 nodes, in two minutes, where a
# few thousand are usual.  With more than these and so many for each node the search is given up.
_MOST_PATHS, _PATHS_PER_NODE = 2000, 2

# The search for paths takes some .6 us for each piece of a reflex edge and hidden node, as long as
# their product is small, and fast marching 1.5 us for each node.  Paths are propagated where the
# product is larger than this number times that of the nodes.  Fewer nodes than ``_FEW`` count as so
# many.
_DEAR, _FEW = 20, 1000


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
        paths, edges, bases = self.paths, self.paths.edges, self.paths.bases
        base, edge = paths.base[which], paths.edge[which]
        bent = edge >= 0
        places = bases.table[base, :9].reshape(-1, 3, 3)
        lower, upper = places.min(axis=1), places.max(axis=1)
        value = bases.table[base, 9:].min(axis=1)
        e, w = edge[bent], which[bent]
        ends = edges.start[e] + paths.part[w].T[:, :, None] * edges.along[e]
        lower[bent], upper[bent] = ends.min(axis=0), ends.max(axis=0)
        beyond = paths.image[w, 0] - np.clip(paths.image[w, 0], *paths.part[w].T)
        value[bent] = paths.offset[w] + self.g * np.hypot(beyond, paths.image[w, 1])
        order = along_curve(0.5 * (lower + upper))
        boxes = boxes_over(lower[order], upper[order], value[order])
        return Choice(which[order].astype(np.int32), boxes)

    def sources(self) -> Choice:
        """Return the straight paths from the sources."""
        return self.choice(np.arange(self.n_sources, dtype=np.int32))

    def alive(self) -> Choice:
        """Return the paths from nodes of reflex edges, and all over edges."""
        alive = np.isfinite(self.paths.offset)
        alive[: self.n_sources] = False
        return self.choice(np.flatnonzero(alive).astype(np.int32))

    def is_dear(self, n_hidden: int, n_nodes: int) -> bool:
        """Return whether paths are to be propagated, since the search would take too long."""
        return len(self.reflex_edges.pieces.edge) * n_hidden > _DEAR * max(n_nodes, _FEW)

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
        places = edges.start[pieces.edge] + peak[:, None] * edges.along[pieces.edge]
        order = np.arange(len(places), dtype=np.int32)
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
        if not self.sight.stars.points.flags.writeable:  # else the kernel is compiled again
            places = read_only(places)
        stars = self.sight.stars._replace(points=places, rows=rows)
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
        paths, edges = self.paths, self.reflex_edges.edges
        straight = paths.edge[parent] < 0
        along, normals, start = edges.along[edge], edges.normals[edge], edges.start[edge]
        middle = start + part.mean(axis=1)[:, None] * along
        foot, size, _ = self._starts(base, middle)
        several = paths.bases.counts[base] > 1
        offset = np.where(
            straight, size - 2.0 * self.g * self._extent(base, foot), paths.offset[parent]
        )
        last = paths.edge[parent]
        volume = np.einsum(
            "ra,ra->r", np.cross(edges.along[last], along), start - edges.start[last]
        )
        skew = paths.skew[parent] | several
        skew |= ~straight & (np.abs(volume) > self.sight.walls.slack)

        origin = np.where(straight[:, None], foot, self._turned(parent, middle))
        away = origin - start
        place = np.einsum("ra,ra->r", away, along)
        image = np.column_stack([place, np.linalg.norm(away - place[:, None] * along, axis=1)])
        # The previous piece starts at one point, or at any point of a part of an edge.
        before = edges.start[last] + paths.part[parent].T[:, :, None] * edges.along[last]
        ends = np.where(straight[:, None], foot, before)
        ahead = start - ends
        ahead -= np.einsum("sra,ra->sr", ahead, along)[:, :, None] * along
        far = np.linalg.norm(ahead, axis=2)
        ahead /= np.maximum(far, 1e-300)[:, :, None]
        nil = far <= 10.0 * self.sight.walls.slack
        ahead = np.where(nil[:, :, None], ahead[::-1], ahead)
        over = np.einsum("rfa,sra->srf", normals, ahead)
        # If the outside lies straight ahead, a path that bends here is not shortest.
        ok = (over.min(axis=2) <= GRAZING).any(axis=0) & ~nil.all(axis=0)
        side = over.argmin(axis=2)
        sector = np.empty((len(edge), 9))
        sector[:, :3] = np.where(
            (side[0] == side[1])[:, None], normals[np.arange(len(edge)), side[0]], 0.0
        )
        for end in range(2):
            sideways = np.cross(ahead[end], along)
            turned = np.einsum("ra,ra->r", sideways, self.reflex_edges.obstacles[edge]) < 0.0
            sector[:, 3 + 3 * end : 6 + 3 * end] = np.where(turned[:, None], -sideways, sideways)
        sector[several] = 0.0  # it may start elsewhere on its edge or face
        ok |= several
        ok &= self.depth[parent] < LONGEST
        columns = (base, parent, edge, image, offset, sector, skew, part)
        return Paths(paths.bases, edges, *columns), ok

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

    def _turned(self, path: IntArray, x: FloatArray) -> FloatArray:
        """Return the bases of paths, rotated about their last edges to opposite points x."""
        e = self.paths.edge[path]
        start, along = self.paths.edges.start[e], self.paths.edges.along[e]
        across = x - start
        across -= np.einsum("ra,ra->r", across, along)[:, None] * along
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
        f, r = self.paths.image[path].T
        turned: FloatArray = start + f[:, None] * along - r[:, None] * across
        return turned


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


class Solid(NamedTuple):
    """A solid, its reflex edges, and the nodes at which sizes are computed."""

    points: FloatArray
    """float64[n, 3]: the nodes; on one of many processes, its own and those at the boundary.

    Those on faces that are plane but for noise are in common planes."""
    surface: SimplexMesh | None
    """The boundary before nodes were moved for that; None if none was."""
    moved: float
    """How far a coordinate has been moved, at most."""
    nodes: IntArray
    """int32[k]: the nodes to solve along a Morton curve; nodes of reflex edges are among them."""
    sight: Sight
    reflex_edges: ReflexEdges


def solid_of(
    mesh: SimplexMesh,
    boundary: FlatBoundary,
    nodes: IntArray | None = None,
    around: IntArray | None = None,
) -> Solid:
    """Return a solid with all nodes of a mesh, or some of them, to solve.

    Parameters
    ----------
    mesh : SimplexMesh
        Has all cells with a node on the boundary, others do not matter.
    boundary : FlatBoundary
    nodes : int32[k], optional
        Nodes to solve besides those of reflex edges; by default all.
    around : int32[m, 4], optional
        Tetrahedra that fill the solid, more than once perhaps, with all edges and faces that may be
        sources; by default the cells.
    """
    facets = boundary.facets
    ridges = ridges_of(facets, mesh.n_points)
    points = with_flat_faces(mesh.points, facets, ridges)
    sight = build_sight(points, mesh.cells if around is None else around, facets)
    reflex_edges = find_reflex_edges(ridges, points, facets, sight.walls.slack)
    surface = None if points is mesh.points else SimplexMesh(mesh.points, facets)
    moved = float(np.abs(points - mesh.points).max())
    if nodes is None:
        return Solid(points, surface, moved, along_curve(points), sight, reflex_edges)
    nodes = np.union1d(nodes, reflex_edges.nodes).astype(np.int32)
    order = along_curve(np.ascontiguousarray(points[nodes]))
    return Solid(points, surface, moved, nodes[order], sight, reflex_edges)


class WholeSolid:
    """A solid that is not convex, of which all is known; a rank may know a part only."""

    def __init__(
        self, component: Component, solid: Solid, points: FloatArray | None = None
    ) -> None:
        """``points``: the nodes of the component as in the solid, by default all of these."""
        self.mesh = component.mesh if component.links is None else component.links
        self.h0, self.solid = component.h0, solid
        if solid.surface is not None:
            points = solid.points if points is None else points
            component = component._replace(
                mesh=SimplexMesh(points, component.mesh.cells), extra=self._moved(component.extra)
            )
        self.component = component

    def _moved(self, extra: Extra | None) -> Extra | None:
        """Return the sources between the nodes, those on the boundary moved with it."""
        solid = self.solid
        if extra is None or solid.surface is None:
            return extra
        facets, weights, away = solid.surface.locator.nearest(extra.points)
        corners = solid.points[solid.surface.cells[facets]]
        on = (away <= 10.0 * solid.moved)[:, None]
        places = np.where(on, np.einsum("iv,ivd->id", weights, corners), extra.points)
        return extra._replace(points=places)

    def candidates(self) -> tuple[IntArray, BoolArray | None]:
        """Return the result of `candidates_of`."""
        return candidates_of(self.component)

    def with_others(self, entries: Entries) -> tuple[Entries, npt.NDArray[Any]]:
        """Return sources with those that others know, and the numbers of their nodes."""
        return entries, entries.nodes

    def known(self, numbers: npt.NDArray[Any]) -> IntArray:
        """Return the nodes of sources, given their numbers; -1 for points between the nodes."""
        return np.where(numbers < len(self.h0), numbers, -1).astype(np.int32)

    def own(self, sizes: FloatArray) -> FloatArray:
        """Return the sizes at the nodes of the component."""
        return sizes

    def total(self, nodes: IntArray) -> int:
        """Return the number of nodes on all ranks."""
        return len(nodes)

    def any(self, flag: bool) -> bool:
        """Return whether a flag is set on any rank."""
        return flag

    def need_all_cells(self) -> None:
        """Raise `NeedsWholeMesh` if cells inside the solid are not known."""

    def spread(self, h: FloatArray) -> FloatArray:
        """Return sizes, lowered along edges."""
        component = self.component
        return limit_along_edges(self.mesh, h, component.g, component.workers.report)


def solve_in_solid(known: WholeSolid) -> tuple[ComponentSolution, IntArray]:
    """Return the solution, and where the known part of the path to each node starts.

    This is a node of a reflex edge, whose size comes along edges of the mesh; -1 if there is none.
    """
    component, solid = known.component, known.solid
    nodes, steep = known.candidates()
    linear = steep is not None and component.face_sources
    exact = ExactField(component.g, None, linear)
    lower, source = known.h0.copy(), np.full(len(known.h0), -1, np.int32)
    points = Points(solid.points, solid.nodes)
    numbers = []

    def lower_by(entries: Entries) -> None:
        every, names = known.with_others(entries)
        exact.groups.append(every)
        numbers.append(names)
        exact.lower_by_last(points, lower, source, component.workers)

    lower_by(entries_of_nodes(component, nodes))
    if linear and steep is not None:
        lower_by(sources_on_cells(component, steep, known.own(lower)))
    # The first of several sources that allow the same size counts: their order is that of nodes.
    named = np.concatenate(numbers)
    order = np.lexsort(named.T[::-1]).astype(np.int32)
    place = np.empty(len(order) + 1, np.int32)  # of each entry in this order
    place[order], place[-1] = np.arange(len(order)), -1
    network = _network_of(exact.table[order], known.known(named)[order], component.g, solid)
    field = Field(
        np.empty_like(lower), np.full_like(source, -1), np.full_like(solid.points, np.nan)
    )
    h, sizes, finished, propagated = _solve(known, network, field, lower, place[source])
    entry, start, bend = _origins(network, field, sizes, h)
    source = np.append(order, np.int32(-1))[entry]
    proved = h <= lower + EQUAL * np.abs(lower)
    solution = ComponentSolution(h, source, exact, bend, proved, lower, finished=finished)
    solution.propagated = propagated
    return solution, start


def _network_of(table: FloatArray, nodes: IntArray, g: float, solid: Solid) -> Network:
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


class Found(NamedTuple):
    """Limited sizes."""

    h: FloatArray
    sizes: FloatArray
    """Those of the paths over reflex edges."""
    finished: bool
    """Whether all paths were found."""
    propagated: bool
    """Whether paths were propagated instead."""


def _solve(
    known: WholeSolid, network: Network, field: Field, lower: FloatArray, nearest: IntArray
) -> Found:
    """Return the limited sizes.

    Parameters
    ----------
    known : WholeSolid
    network : Network
        The straight paths from the sources (In/Out).
    field : Field
        Out: the paths.
    lower : float64[n]
        The smallest size that the sources allow, without regard to visibility.
    nearest : int32[n]
        The source that allows it.

    Notes
    -----
    Sizes do not depend on the order in which nodes and paths are tested, bit for bit.  Where
    several sources allow nearly the same size at a node, it suffices that one of them is visible;
    the size is ``lower`` whichever is found first.  At nodes of reflex edges it matters which
    source it is, and the first one counts.
    """
    solid, h0, spread, workers = known.solid, known.h0, known.spread, known.component.workers
    nodes = solid.nodes
    nearly = lower + EQUAL * np.abs(lower)
    field.sizes[:] = nearly
    on_reflex_edge = np.isin(nodes, solid.reflex_edges.nodes)
    none = network.choice(np.empty(0, np.int32))
    network.lower(nodes[~on_reflex_edge], none, field, workers, nearest)
    hidden = nodes[on_reflex_edge | ((field.path < 0) & (h0 > lower))[nodes]]
    network.lower(hidden, network.sources(), field, workers)
    proved = (field.path >= 0) | (h0 <= lower)
    upper = spread(np.where(proved, lower, h0))
    proved |= np.isinf(upper)  # not reached by any source
    # Keep paths as short as those along edges of the mesh: they may continue over other edges.
    nearly_upper = upper + TIE * np.abs(upper) + 10.0 * network.g * solid.moved
    field.sizes[:] = np.where(proved, np.minimum(lower, upper), nearly_upper)
    hidden = nodes[~proved[nodes]]
    n_nodes = known.total(nodes)
    propagated = network.is_dear(known.total(hidden), n_nodes)
    finished = True
    if not propagated:
        before = network.copied(), Field(*(array.copy() for array in field))
        is_over = len(hidden) > 0
        if is_over:
            finished, is_over = _solve_hidden(network, field, hidden, n_nodes, workers)
        # If the search of one rank is given up, that of all is.
        propagated = known.any(is_over)
        if propagated:
            finished = True
            network.paths, network.depth, network.origin = before[0]
            for array, old in zip(field, before[1], strict=True):
                array[:] = old
    if propagated:
        known.need_all_cells()
        network.lower(hidden, network.sources(), field, workers)
        _propagate_paths(known, network, field, proved)
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    h = spread(np.where(sizes <= nearly, lower, sizes))
    return Found(h, sizes, finished, propagated)


def _propagate_paths(known: WholeSolid, network: Network, field: Field, proved: BoolArray) -> None:
    """Lower nodes (In/Out: field) from which their smallest source is not visible, approximately.

    Each node is reached by a path of one of its neighbours, or by one that bends there: see
    `adaptsize._kernels.space_relay`.  This takes a few microseconds a node.
    """
    mesh, reflex, paths, m = known.mesh, network.reflex_edges, network.paths, network.n_sources
    n, k = mesh.n_points, len(reflex.nodes)
    # Nodes that keep their bounds are straight paths, too.
    at = paths.bases.nodes[:m, 0]
    single = np.flatnonzero((paths.bases.counts[:m] == 1) & (at >= 0))
    given = field.path.copy()
    own = np.full(n, -1, np.int32)
    own[at[single]] = single
    kept = proved & (field.path < 0)
    field.path[kept] = own[kept]
    field.last[kept] = network.sight.stars.points[kept]
    beside = np.zeros(n, np.bool_)
    beside[mesh.cells[~proved[mesh.cells].all(axis=1)]] = True
    seeds = np.flatnonzero((beside | ~proved) & (field.path >= 0) & np.isfinite(field.sizes))
    pairs = np.column_stack([reflex.pieces.nodes.ravel(), np.repeat(reflex.pieces.edge, 2)])
    both = np.unique(pairs, axis=0)
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=k))])
    room = 4 * len(both) + 16
    more = Bases(*(_with_room(array, room) for array in paths.bases))
    longer = Paths(more, paths.edges, *(_with_room(array, room) for array in paths[2:]))
    relay = Relay(
        mesh.cells,
        *mesh.rings,
        ~proved,
        places_among(reflex.nodes, n),
        first.astype(np.int32),
        both[:, 1].astype(np.int32),
        m,
        np.array([len(paths.base), len(paths.bases.counts)]),
        _with_room(network.origin, room),
        new_heap(n),
        np.full(n, -1, np.int32),
    )
    push_all(relay.heap, seeds, field.sizes)
    propagate(relay, longer, field, network.sight, network.g, network.faces, new_block())
    network.paths, network.origin = longer, relay.origin
    field.path[kept] = given[kept]


def _with_room(array: npt.NDArray[Any], room: int) -> npt.NDArray[Any]:
    """Return a longer copy of an array."""
    return np.concatenate([array, np.zeros((room, *array.shape[1:]), array.dtype)])


def _solve_hidden(
    network: Network, field: Field, hidden: IntArray, n_nodes: int, workers: Workers
) -> tuple[bool, bool]:
    """Lower nodes (In/Out: field) from which their smallest source is not visible.

    Returns whether the iteration converged within _ROUNDS iterations, and whether it was given up,
    since there were too many paths.
    """
    most = _MOST_PATHS + _PATHS_PER_NODE * n_nodes
    reflex_nodes = network.reflex_edges.nodes
    network.lower(hidden, network.sources(), field, workers)
    order = np.flatnonzero(np.isin(reflex_nodes, hidden)).astype(np.int32)
    waiting = reflex_nodes[order]
    changed = np.flatnonzero(field.path[reflex_nodes] >= 0).astype(np.int32)
    fresh = np.arange(network.n_sources, dtype=np.int32)
    for _ in range(_ROUNDS):
        if len(changed) == 0 and len(fresh) == 0:
            break
        bases = network.set_reflex_nodes(changed, field.sizes[reflex_nodes[changed]])
        new = network.extend(np.concatenate([fresh, bases]), field)
        if len(network.paths.base) > most:
            return False, True
        before = field.sizes[waiting]
        network.lower(waiting, network.choice(np.concatenate([bases, new])), field, workers)
        fallen = before - field.sizes[waiting]
        changed = order[fallen > EQUAL * np.abs(before)]
        fresh = network.seen(new, workers)
    rest = hidden[~np.isin(hidden, reflex_nodes)]
    network.lower(rest, network.alive(), field, workers)
    return len(changed) == 0 and len(fresh) == 0, False


def _origins(
    network: Network, field: Field, sizes: FloatArray, h: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return where paths come from, for those of ``sizes``.

    Returns
    -------
    entry : int32[n]
        The source at the origin of the path; -1 if not known, or if there is none.
    start : int32[n]
        As in `solve_in_solid`.
    bend : float64[n, 3]
        Last bend of the path, nan if it is straight.
    """
    paths = network.paths
    m = network.n_sources
    reached = np.flatnonzero(field.path >= 0)  # none if the bounds satisfy the limit
    base, bend = np.full(len(h), -1, paths.base.dtype), np.full_like(field.last, np.nan)
    base[reached] = network.origin[paths.base[field.path[reached]]]
    base[h < sizes * (1.0 - TIE)] = -1
    bent = reached[paths.edge[field.path[reached]] >= 0]
    bend[bent] = field.last[bent]
    entry = np.where(base < m, base, -1).astype(np.int32)
    reflex_nodes = np.append(network.reflex_edges.nodes, np.int32(-1))
    start = reflex_nodes[np.where(base < m, -1, base - m)].astype(np.int32)
    return entry, start, bend
