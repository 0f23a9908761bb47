"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`.

Paths over reflex edges are extended by one edge at a time.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import exact_space as kernels
from adaptsize._kernels.space_paths import LONGEST, Bases, Choice, Field, Paths, new_block
from adaptsize._kernels.space_sight import Sight
from adaptsize._workers import Workers
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
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

    def choice(self, which: IntArray) -> Choice:
        """Return some of the paths, with a tree over them."""
        paths, edges, bases = self.paths, self.paths.edges, self.paths.bases
        base, edge = paths.base[which], paths.edge[which]
        bent = edge >= 0
        places = bases.table[base, :9].reshape(-1, 3, 3)
        lower, upper = places.min(axis=1), places.max(axis=1)
        value = bases.table[base, 9:].min(axis=1)
        e, w = edge[bent], which[bent]
        ends = np.stack([edges.start[e], edges.start[e] + edges.length[e, None] * edges.along[e]])
        lower[bent], upper[bent] = ends.min(axis=0), ends.max(axis=0)
        beyond = paths.image[w, 0] - np.clip(paths.image[w, 0], 0.0, edges.length[e])
        value[bent] = paths.offset[w] + self.g * np.hypot(beyond, paths.image[w, 1])
        order = along_curve(0.5 * (lower + upper))
        boxes = boxes_over(lower[order], upper[order], value[order])
        return Choice(which[order].astype(np.int32), boxes)

    def sources(self) -> Choice:
        """Return the straight paths from the sources."""
        return self.choice(np.arange(self.n_sources, dtype=np.int32))

    def lower(
        self,
        order: IntArray,
        choice: Choice,
        field: Field,
        workers: Workers,
        hints: IntArray | None = None,
    ) -> None:
        """Lower sizes (In/Out: field) at the nodes ``order`` by a choice of paths."""
        tried = np.full(len(field.sizes), -1, np.int32) if hints is None else hints
        # The code for edges and triangles is not compiled if all sources are nodes.
        faces = True if bool((self.paths.bases.counts > 1).any()) else None
        along = read_only(order)

        def task(first: int, last: int) -> None:
            given = (along, (first, last), self.paths, choice, tried)
            kernels.lower_by_paths(*given, self.sight, self.g, field, faces, new_block())

        workers.in_chunks(task, len(order))

    def set_reflex_nodes(self, sizes: FloatArray) -> None:
        """Set the sizes at the nodes of reflex edges."""
        m = self.n_sources
        self.paths.bases.table[m:, 9] = sizes
        moves = self.paths.base >= m
        self.paths.offset[moves] = self.paths.bases.table[self.paths.base[moves], 9]

    def extend(self, changed: IntArray, field: Field) -> IntArray:
        """Extend the paths to nodes of reflex edges over these edges and adjacent ones.

        Returns the paths that are new or start from a node that may have been lowered.
        """
        paths = self.paths
        edge, parent, source, node = self.candidates(changed, field)
        ok = (parent >= 0) & (self.depth[parent] < LONGEST) & (paths.edge[parent] != edge)
        key, at = np.unique(_key_of(edge[ok], parent[ok]), return_index=True)
        old = np.flatnonzero(paths.edge >= 0)
        old_key = _key_of(paths.edge[old], paths.parent[old])
        again = old[np.isin(old_key, key) & (paths.base[old] >= self.n_sources)]
        at = np.flatnonzero(ok)[at[~np.isin(key, old_key)]]
        self._append(edge[at], parent[at], source[at], node[at], field)
        return np.concatenate([again, np.arange(len(paths.base), len(self.paths.base))])

    def candidates(
        self, changed: IntArray, field: Field
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return edges, the paths to extend, the nodes where these end, and the next nodes."""
        reflex_edges = self.reflex_edges
        marked = np.zeros(len(reflex_edges.nodes), bool)
        marked[changed] = True
        here = np.flatnonzero(marked[reflex_edges.corner])
        node, edge = reflex_edges.nodes[reflex_edges.corner[here]], reflex_edges.edge[here]
        near = reflex_edges.adjacent[edge].tocoo()
        node = np.concatenate([node, node[near.row]])
        source = node
        edge = np.concatenate([edge, near.col])
        goal = np.concatenate([node[: len(here)], reflex_edges.nodes[near.data - 1]])
        return edge, field.path[source], source, goal

    def _append(
        self,
        edge: IntArray,
        parent: IntArray,
        source: IntArray,
        node: IntArray,
        field: Field,
    ) -> None:
        """Add paths to ``source`` that continue over edges at ``node``, if they may be shortest."""
        paths, edges, points = self.paths, self.reflex_edges.edges, self.sight.stars.points
        straight = paths.edge[parent] < 0
        away = np.linalg.norm(points[source] - field.last[source], axis=1)
        away += 2.0 * self._extent(paths.base[parent], field.last[source])
        offset = np.where(straight, field.sizes[source] - self.g * away, paths.offset[parent])
        along, normals = edges.along[edge], edges.normals[edge]
        volume = np.einsum(
            "ra,ra->r",
            np.cross(edges.along[paths.edge[parent]], along),
            edges.start[edge] - edges.start[paths.edge[parent]],
        )
        skew = paths.skew[parent] | (~straight & (np.abs(volume) > self.sight.walls.slack))

        origin = np.where(straight[:, None], field.last[source], self._turned(parent, points[node]))
        piece = points[node] - origin
        rise = np.einsum("ra,ra->r", piece, along)
        place = np.einsum("ra,ra->r", points[node] - edges.start[edge], along)
        away = np.linalg.norm(piece - rise[:, None] * along, axis=1)
        image = np.column_stack([place - rise, away])
        # The previous piece starts at one point, or at any point between the ends of an edge.
        before = edges.start[paths.edge[parent]]
        after = before + (edges.length[:, None] * edges.along)[paths.edge[parent]]
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
        sector = np.empty((len(node), 9))
        sector[:, :3] = np.where(
            (side[0] == side[1])[:, None], normals[np.arange(len(node)), side[0]], 0.0
        )
        for end in range(2):
            sideways = np.cross(ahead[end], along)
            turned = np.einsum("ra,ra->r", sideways, self.reflex_edges.obstacles[edge]) < 0.0
            sector[:, 3 + 3 * end : 6 + 3 * end] = np.where(turned[:, None], -sideways, sideways)
        self.depth = np.concatenate([self.depth, self.depth[parent[ok]] + 1])
        ancestor, kept = parent[ok], (edge[ok], image[ok], offset[ok], sector[ok], skew[ok])
        added = (paths.base[ancestor], ancestor, *kept)
        longer = [np.concatenate(pair) for pair in zip(paths[2:], added, strict=True)]
        self.paths = Paths(paths.bases, paths.edges, *longer)

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


def solid_of(mesh: SimplexMesh, boundary: FlatBoundary, nodes: IntArray | None = None) -> Solid:
    """Return a solid with all nodes of a mesh, or some of them, to solve.

    Parameters
    ----------
    mesh : SimplexMesh
        Has all cells with a node on the boundary, others do not matter.
    boundary : FlatBoundary
    nodes : int32[k], optional
        Nodes to solve besides those of reflex edges; by default all.
    """
    facets = boundary.facets
    ridges = ridges_of(facets, mesh.n_points)
    points = with_flat_faces(mesh.points, facets, ridges)
    sight = build_sight(points, mesh.cells, facets)
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
        self.mesh, self.h0, self.solid = component.mesh, component.h0, solid
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
    h, sizes, finished = _solve(known, network, field, lower, place[source])
    entry, start, bend = _origins(network, field, sizes, h)
    source = np.append(order, np.int32(-1))[entry]
    proved = h <= lower + EQUAL * np.abs(lower)
    return ComponentSolution(h, source, exact, bend, proved, lower, finished=finished), start


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
    )
    return Network(g, solid.sight, solid.reflex_edges, paths, m, np.zeros(m + k, np.int32))


def _solve(
    known: WholeSolid, network: Network, field: Field, lower: FloatArray, nearest: IntArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Return the limited sizes, those of paths over reflex edges, and whether all were found.

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
    finished = len(hidden) == 0 or _solve_hidden(network, field, hidden, workers)
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    return spread(np.where(sizes <= nearly, lower, sizes)), sizes, finished


def _solve_hidden(network: Network, field: Field, hidden: IntArray, workers: Workers) -> bool:
    """Lower nodes (In/Out: field) from which their smallest source is not visible.

    Returns whether the iteration converged within _ROUNDS iterations.
    """
    reflex_nodes = network.reflex_edges.nodes
    network.lower(hidden, network.sources(), field, workers)
    waiting = np.isin(reflex_nodes, hidden)
    order = reflex_nodes[waiting]
    changed = np.flatnonzero(field.path[reflex_nodes] >= 0).astype(np.int32)
    for _ in range(_ROUNDS):
        if len(changed) == 0:
            break
        network.set_reflex_nodes(field.sizes[reflex_nodes])
        fresh = np.concatenate([network.n_sources + changed, network.extend(changed, field)])
        if len(order) == 0:  # all paths are built, and no node of an edge is left
            changed = order
            break
        before = field.sizes[reflex_nodes]
        network.lower(order, network.choice(fresh), field, workers)
        fallen = before - field.sizes[reflex_nodes]
        changed = np.flatnonzero(fallen > EQUAL * np.abs(before)).astype(np.int32)
    network.set_reflex_nodes(field.sizes[reflex_nodes])
    rest = hidden[~np.isin(hidden, reflex_nodes)]
    network.lower(rest, network.choice(_in_use(network, field)), field, workers)
    return len(changed) == 0


def _in_use(network: Network, field: Field) -> IntArray:
    """Return the paths from nodes of reflex edges, and those over edges that reach such a node."""
    paths, reflex_edges = network.paths, network.reflex_edges
    bent = np.flatnonzero(paths.edge >= 0)
    edge, path, _, _ = network.candidates(np.arange(len(reflex_edges.nodes), dtype=np.int32), field)
    used = np.isin(_key_of(paths.edge[bent], paths.parent[bent]), _key_of(edge, path))
    straight = network.n_sources + np.arange(len(reflex_edges.nodes))
    return np.concatenate([straight, bent[used]])


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
    base[reached] = paths.base[field.path[reached]]
    base[h < sizes * (1.0 - TIE)] = -1
    bent = reached[paths.edge[field.path[reached]] >= 0]
    bend[bent] = field.last[bent]
    entry = np.where(base < m, base, -1).astype(np.int32)
    reflex_nodes = np.append(network.reflex_edges.nodes, np.int32(-1))
    start = reflex_nodes[np.where(base < m, -1, base - m)].astype(np.int32)
    return entry, start, bend
