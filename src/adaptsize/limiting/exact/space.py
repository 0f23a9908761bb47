"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_array
from scipy.sparse.csgraph import connected_components

from adaptsize._kernels import exact_space as kernels
from adaptsize._kernels.exact import BLOCK, Entries
from adaptsize._kernels.exact_space import (
    LONGEST,
    Bases,
    Choice,
    Edges,
    Field,
    Sight,
    Stars,
    Walls,
    Ways,
)
from adaptsize.background.topology import unique_rows
from adaptsize.limiting.edge_based import solve_edge_based
from adaptsize.limiting.exact.work import along_curve, boxes_over, in_chunks
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.geometry.boundary import FlatBoundary

# Share of the diagonal that counts as no distance.
_SLACK = 1e-11

# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12

# Share by which ways may be longer than those along edges of the mesh.
_TIE = 1e-10

# Angle between a way and the faces of an edge that counts as none.
_GRAZING = 1e-9

# Cells of less volume over the cube of their longest edge count as without any.
_NO_VOLUME = 1e-12

SIZE = 32

# Rounds in which ways may get one more bend each.
_ROUNDS = 200


class _Options(TypedDict):
    """How to run kernels."""

    threads: int
    report: ProgressCallback


class SpaceResult(NamedTuple):
    """Limited sizes in a solid."""

    h: FloatArray
    """float64[n]"""
    entry: IntArray
    """int32[n]: the source at the origin of the way, -1 where there is none."""
    bend: FloatArray
    """float64[n, 3]: last place where the way bends, nan where it is straight."""
    proved: BoolArray
    """bool[n]: nothing can be smaller, as ``h`` is ``lower``."""
    lower: FloatArray
    """float64[n]: the least that all sources allow, sight left out."""
    network: Network | None
    """All that decides the size at any point; None if every node sees what limits it."""
    finished: bool
    """Whether sizes had stopped falling along reflex edges after so many rounds."""


class _Ridges(NamedTuple):
    """Edges of the boundary."""

    ends: IntArray
    """int32[r, 2]"""
    normals: FloatArray
    """float64[r, 2, 3]: unit normals of the two facets there."""
    inner: FloatArray
    """float64[r, 3]: from a reflex edge into the outside."""
    is_reflex: BoolArray
    is_sharp: BoolArray
    """Whether the two facets are not in one plane, or not two."""
    is_odd: BoolArray
    """Whether there are not two facets with an area."""


class _Knots(NamedTuple):
    """Reflex edges and their nodes."""

    nodes: IntArray
    """int32[k]: nodes of reflex and odd edges, along a Morton curve."""
    edges: Edges
    obstacles: FloatArray
    """float64[e, 3]: from each edge into the outside."""
    knot: IntArray
    """int32[p], with ``edge``: the pairs of a node and an edge it lies on."""
    edge: IntArray
    beside: csr_array
    """(e, e): the node of two edges, numbers in ``nodes`` from 1 on."""


def build_sight(mesh: SimplexMesh, boundary: FlatBoundary) -> Sight:
    """Return the boundary of a mesh of tetrahedra, for lines of sight."""
    points, facets = mesh.points, boundary.facets
    corners = points[facets]
    diagonal, rounding = _scales(points, facets)
    origin, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    area = np.linalg.norm(normal, axis=1)
    height = _heights(corners, area)
    keep = height > _NO_VOLUME * diagonal
    order = np.flatnonzero(keep)
    order = order[along_curve(np.ascontiguousarray(corners[keep].mean(axis=1)))]
    square = area[order, None] ** 2
    rows = np.empty((len(order), 14))
    rows[:, :3] = origin[order]
    rows[:, 3:6] = normal[order] / area[order, None]
    rows[:, 6:9] = np.cross(e2[order], normal[order]) / square
    rows[:, 9:12] = np.cross(normal[order], e1[order]) / square
    slack = _SLACK * diagonal
    # The normal of a sliver is uncertain, and so is on which side of it a far point lies.
    rows[:, 12] = np.maximum(slack, 4.0 * rounding * diagonal / height[order])
    rows[:, 13] = np.minimum(slack / height[order], 1e-3)
    boxes, n_leaves = boxes_over(
        corners[order].min(axis=1), corners[order].max(axis=1), np.zeros(len(order))
    )
    return Sight(Walls(rows, boxes, n_leaves, slack), _stars_at(mesh, np.unique(facets)))


def _scales(points: FloatArray, facets: IntArray) -> tuple[float, float]:
    """Return the diagonal of the domain, and the rounding error of a coordinate."""
    used = points[facets]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=(0, 1))))
    return diagonal, float(np.finfo(float).eps * np.abs(used).max())


def _heights(corners: FloatArray, area: FloatArray) -> FloatArray:
    """Return the least heights of triangles, given twice their areas."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    heights = np.zeros_like(area)
    np.divide(area, longest, out=heights, where=longest > 0.0)
    return heights


def _stars_at(mesh: SimplexMesh, nodes: IntArray) -> Stars:
    """Return the cells with volume at nodes of the boundary."""
    rows = np.full(mesh.n_points, -1, np.int32)
    rows[nodes] = np.arange(len(nodes))
    cells = mesh.cells[(rows[mesh.cells] >= 0).any(axis=1)]
    edges = mesh.points[cells[:, 1:]] - mesh.points[cells[:, :1]]
    volume = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2]))
    longest = np.abs(edges).max(axis=(1, 2), initial=0.0)
    flat = np.abs(volume) <= _NO_VOLUME * longest**3
    turned = volume < 0.0
    cells[turned, 2:] = cells[turned, 3:1:-1]
    cells = cells[~flat]
    # Even permutations: the three others are right-handed, seen from the first.
    around = [[0, 1, 2, 3], [1, 0, 3, 2], [2, 0, 1, 3], [3, 0, 2, 1]]
    star = np.concatenate([cells[:, order] for order in around])
    star = star[rows[star[:, 0]] >= 0]
    row = rows[star[:, 0]]
    star = star[np.argsort(row, kind="stable"), 1:]
    first = np.zeros(len(nodes) + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(row, minlength=len(nodes)))
    return Stars(mesh.points, rows, first, np.ascontiguousarray(star))


def _ridges_of(points: FloatArray, facets: IntArray) -> _Ridges:
    """Return the edges of a boundary and how it turns there."""
    corners = points[facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    heights = _heights(corners, areas)
    diagonal, rounding = _scales(points, facets)
    thin = heights <= _NO_VOLUME * diagonal
    units = np.where(thin[:, None], 0.0, normals / np.where(thin, 1.0, areas)[:, None])
    ends = np.concatenate([facets[:, [v, (v + 1) % 3]] for v in range(3)])
    apex = np.concatenate([facets[:, (v + 2) % 3] for v in range(3)])
    owner = np.tile(np.arange(len(facets)), 3)
    forward = ends[:, 0] < ends[:, 1]
    edges, number = unique_rows(ends, len(points))
    is_odd = (np.bincount(number) != 2) | (np.bincount(number, weights=forward) != 1.0)
    sides = np.zeros((len(edges), 2), np.int64)
    sides[number[forward], 0] = np.flatnonzero(forward)
    sides[number[~forward], 1] = np.flatnonzero(~forward)
    is_odd |= thin[owner[sides]].any(axis=1)

    along = points[edges[:, 1]] - points[edges[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    to_apex = points[apex[sides]] - points[edges[:, :1]]
    in_face = to_apex - np.einsum("rsa,ra->rs", to_apex, along)[:, :, None] * along[:, None]
    in_face /= np.maximum(np.linalg.norm(in_face, axis=2), 1e-300)[:, :, None]
    normal = units[owner[sides]]
    rise = np.einsum("ra,ra->r", normal[:, 0], to_apex[:, 1])
    reach = np.linalg.norm(to_apex[:, 1], axis=1)
    height = np.maximum(heights[owner[sides[:, 0]]], 1e-300)
    nil = 16.0 * rounding * (1.0 + reach / height)
    is_crack = (np.abs(rise) <= nil) & (np.einsum("ra,ra->r", normal[:, 0], normal[:, 1]) < 0.0)
    is_reflex = ((rise > nil) | is_crack) & ~is_odd
    inner = normal.sum(axis=1) + in_face.sum(axis=1)
    is_sharp = is_odd | is_crack | (np.abs(rise) > nil)
    return _Ridges(edges, normal, inner, is_reflex, is_sharp, is_odd)


def _chains_of(points: FloatArray, ridges: _Ridges, slack: float) -> IntArray:
    """Return for each reflex edge the number of the straight chain that it belongs to.

    A chain goes on at nodes with no other edge between facets of different planes.
    """
    ends = ridges.ends[ridges.is_reflex]
    n = len(points)
    sharp = np.bincount(ridges.ends[ridges.is_sharp].ravel(), minlength=n)
    reflex = np.bincount(ends.ravel(), minlength=n)
    number = np.tile(np.arange(len(ends)), 2)
    flat = ends.T.ravel()
    passed = (sharp[flat] == 2) & (reflex[flat] == 2)
    order = np.argsort(flat[passed], kind="stable")
    pairs = number[passed][order].reshape(-1, 2)
    along = points[ends[:, 1]] - points[ends[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    turn = np.linalg.norm(np.cross(along[pairs[:, 0]], along[pairs[:, 1]]), axis=1)
    pairs = pairs[turn < _GRAZING]
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(ends), len(ends)))
    chain = connected_components(graph, directed=False)[1]
    # What is not straight after all falls apart.
    first = np.zeros(chain.max(initial=-1) + 1, np.int64)
    first[chain[::-1]] = np.arange(len(ends))[::-1]
    rep = first[chain]
    away = points[ends] - points[ends[rep, 0]][:, None]
    away -= np.einsum("rsa,ra->rs", away, along[rep])[:, :, None] * along[rep][:, None]
    bent = np.zeros(len(first), bool)
    bent[chain[(np.linalg.norm(away, axis=2) > 0.1 * slack).any(axis=1)]] = True
    loose = bent[chain]
    chain[loose] = len(first) + np.arange(np.count_nonzero(loose))
    return np.unique(chain, return_inverse=True)[1].ravel().astype(np.int32)


def find_knots(points: FloatArray, boundary: FlatBoundary, slack: float) -> _Knots:
    """Return the reflex edges of a boundary, straight chains merged, and their nodes."""
    ridges = _ridges_of(points, boundary.facets)
    chain = _chains_of(points, ridges, slack)
    ends = ridges.ends[ridges.is_reflex]
    n_edges = chain.max(initial=-1) + 1
    rep = np.zeros(n_edges, np.int64)
    rep[chain[::-1]] = np.arange(len(ends))[::-1]
    origin = points[ends[rep, 0]]
    along = points[ends[rep, 1]] - origin
    along /= np.linalg.norm(along, axis=1)[:, None]
    place = np.einsum("rsa,ra->rs", points[ends] - origin[chain][:, None], along[chain])
    lowest, highest = np.full(n_edges, np.inf), np.full(n_edges, -np.inf)
    np.minimum.at(lowest, chain, place.min(axis=1))
    np.maximum.at(highest, chain, place.max(axis=1))
    reflex = np.flatnonzero(ridges.is_reflex)[rep]
    edges = Edges(
        origin + lowest[:, None] * along,
        along,
        highest - lowest,
        np.ascontiguousarray(ridges.normals[reflex]),
    )
    nodes = np.unique(ridges.ends[ridges.is_reflex | ridges.is_odd]).astype(np.int32)
    if len(nodes):
        nodes = nodes[along_curve(np.ascontiguousarray(points[nodes]))]
    number = np.zeros(len(points), np.int32)
    number[nodes] = np.arange(len(nodes))
    pairs = np.unique(np.column_stack([number[ends].ravel(), np.repeat(chain, 2)]), axis=0)
    knot, edge = np.ascontiguousarray(pairs.T.astype(np.int32))
    ones = np.ones(len(knot))
    lies_on = csr_array((ones, (knot, edge)), shape=(len(nodes), n_edges))
    named = csr_array((ones + knot, (edge, knot)), shape=(n_edges, len(nodes)))
    beside = (named @ lies_on).astype(np.int64)
    beside.setdiag(0)
    beside.eliminate_zeros()
    return _Knots(nodes, edges, ridges.inner[reflex], knot, edge, beside)


@dataclass(eq=False)
class Network:
    """Sources, nodes of reflex edges, and ways over these edges."""

    g: float
    sight: Sight
    knots: _Knots
    ways: Ways
    n_sources: int
    depth: IntArray
    """int32[w]: number of edges of each way."""
    used: Choice | None = None
    """All but the straight ways from sources, in the end."""

    @property
    def faces(self) -> bool | None:
        """None if all sources are nodes, True otherwise."""
        return True if bool((self.ways.bases.counts > 1).any()) else None

    def choice(self, which: IntArray) -> Choice:
        """Return some of the ways, with a tree over them."""
        ways, edges, bases = self.ways, self.ways.edges, self.ways.bases
        base, edge = ways.base[which], ways.edge[which]
        bent = edge >= 0
        places = np.where(
            (np.arange(3) < bases.counts[base][:, None])[:, :, None],
            bases.places[base],
            bases.places[base][:, :1],
        )
        lower, upper = places.min(axis=1), places.max(axis=1)
        value = bases.sizes[base].min(axis=1)
        e, w = edge[bent], which[bent]
        ends = np.stack([edges.start[e], edges.start[e] + edges.length[e, None] * edges.along[e]])
        lower[bent], upper[bent] = ends.min(axis=0), ends.max(axis=0)
        beyond = ways.image[w, 0] - np.clip(ways.image[w, 0], 0.0, edges.length[e])
        value[bent] = ways.offset[w] + self.g * np.hypot(beyond, ways.image[w, 1])
        order = along_curve(0.5 * (lower + upper)) if len(which) else np.empty(0, np.int32)
        boxes, n_leaves = boxes_over(lower[order], upper[order], value[order])
        return Choice(which[order].astype(np.int32), boxes, n_leaves)

    def sources(self) -> Choice:
        """Return the straight ways from the sources."""
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
        """Lower sizes (In/Out: field) at the points ``order`` by a choice of ways."""
        tried = np.full(len(points), -1, np.int32) if hints is None else hints
        faces = self.faces
        size = size or (BLOCK if hints is not None else SIZE)

        def task(first: int, last: int) -> None:
            given = (points, nodes, order, (first, last, size), self.ways, choice, tried)
            kernels.lower_by_ways(*given, self.sight, self.g, field, faces)

        in_chunks(task, len(order), threads, report or _silent)

    def set_knots(self, sizes: FloatArray) -> None:
        """Set the sizes at the nodes of reflex edges."""
        m = self.n_sources
        self.ways.bases.sizes[m:, 0] = sizes
        moves = self.ways.base >= m
        self.ways.offset[moves] = self.ways.bases.sizes[self.ways.base[moves], 0]

    def extend(self, changed: IntArray, field: Field) -> IntArray:
        """Continue the ways to nodes of reflex edges over these edges and those next to them.

        Returns the ways that are new or start from a node that may have been lowered.
        """
        ways = self.ways
        edge, parent, source, node = self.candidates(changed, field)
        ok = (parent >= 0) & (self.depth[parent] < LONGEST) & (ways.edge[parent] != edge)
        key, at = np.unique(_key(edge[ok], parent[ok]), return_index=True)
        old = np.flatnonzero(ways.edge >= 0)
        old_key = _key(ways.edge[old], ways.parent[old])
        again = old[np.isin(old_key, key) & (ways.base[old] >= self.n_sources)]
        at = np.flatnonzero(ok)[at[~np.isin(key, old_key)]]
        self._append(edge[at], parent[at], source[at], node[at], field)
        return np.concatenate([again, np.arange(len(ways.base), len(self.ways.base))])

    def candidates(
        self, changed: IntArray, field: Field
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return edges, the ways to continue, and the nodes to which these ways lead and may go."""
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
        """Add ways to ``source`` that go on over edges at ``node``, if they may be shortest."""
        ways, edges, points = self.ways, self.knots.edges, self.sight.stars.points
        straight = ways.edge[parent] < 0
        away = np.linalg.norm(points[source] - field.last[source], axis=1)
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
        # The last piece before comes from one place, or from between the ends of an edge.
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
        # Straight ahead is the outside: a bend there would be no shortest way.
        ok = (over.min(axis=2) <= _GRAZING).any(axis=0) & ~nil.all(axis=0)
        side = over.argmin(axis=2)
        shade = np.empty((len(node), 3, 3))
        shade[:, 0] = np.where(
            (side[0] == side[1])[:, None], normals[np.arange(len(node)), side[0]], 0.0
        )
        for end in range(2):
            beside = np.cross(ahead[end], along)
            turned = np.einsum("ra,ra->r", beside, self.knots.obstacles[edge]) < 0.0
            shade[:, 1 + end] = np.where(turned[:, None], -beside, beside)
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

    def _turned(self, way: IntArray, x: FloatArray) -> FloatArray:
        """Return the bases of ways turned about their last edges to opposite points x."""
        e = self.ways.edge[way]
        start, along = self.ways.edges.start[e], self.ways.edges.along[e]
        across = x - start
        across -= np.einsum("ra,ra->r", across, along)[:, None] * along
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
        f, r = self.ways.image[way].T
        turned: FloatArray = start + f[:, None] * along - r[:, None] * across
        return turned


def _key(edge: IntArray, parent: IntArray) -> npt.NDArray[np.int64]:
    """Return one number for an edge and a way that is continued over it."""
    return edge.astype(np.int64) << 32 | parent


def _silent(text: str, share: float | None) -> None:
    """Take a report and do nothing."""


def _network_of(
    entries: Entries, nodes: IntArray, g: float, sight: Sight, knots: _Knots
) -> Network:
    """Return a network of straight ways; the sizes at the nodes of reflex edges are inf."""
    m, k = len(entries.counts), len(knots.nodes)
    places, sizes = np.zeros((m + k, 3, 3)), np.full((m + k, 3), np.inf)
    places[:m], sizes[:m] = entries.places, entries.sizes
    places[m:, 0] = sight.stars.points[knots.nodes]
    unused = np.arange(3) >= entries.counts[:, None]
    sizes[:m][unused] = np.inf
    all_nodes = np.full((m + k, 3), -1, np.int32)
    all_nodes[:m, : nodes.shape[1]] = nodes
    all_nodes[m:, 0] = knots.nodes
    counts = np.concatenate([entries.counts, np.ones(k, np.int8)])
    none = np.full(m + k, -1, np.int32)
    ways = Ways(
        Bases(places, sizes, counts, all_nodes),
        knots.edges,
        np.arange(m + k, dtype=np.int32),
        none,
        none.copy(),
        np.zeros((m + k, 2)),
        sizes.min(axis=1),
        np.zeros((m + k, 3, 3)),
        np.zeros(m + k, np.bool_),
    )
    return Network(g, sight, knots, ways, m, np.zeros(m + k, np.int32))


def solve_in_space(
    mesh: SimplexMesh,
    h0: FloatArray,
    g: float,
    entries: Entries,
    nodes: IntArray,
    lower: FloatArray,
    nearest: IntArray,
    boundary: FlatBoundary,
    report: ProgressCallback,
    *,
    sight: Sight | None = None,
    threads: int = 1,
) -> SpaceResult:
    """Return the limited sizes in a solid that is not convex.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra.
    h0 : float64[n]
    g : float
    entries : Entries
        Survivors.
    nodes : int32[m, 3]
        Nodes of each, -1 where there are fewer.
    lower, nearest : float64[n], int32[n]
        The least that the entries allow, sight left out, and by which of them.
    boundary : FlatBoundary
    report : callable
    sight : Sight, optional
        If it has been built before.
    threads : int, optional
    """
    n = mesh.n_points
    sight = build_sight(mesh, boundary) if sight is None else sight
    network = _network_of(
        entries, nodes, g, sight, find_knots(mesh.points, boundary, sight.walls.slack)
    )
    everyone = np.arange(n, dtype=np.int32)
    with_: _Options = {"threads": threads, "report": report}
    field = Field(lower + _EQUAL * np.abs(lower), np.full(n, -1, np.int32), np.full((n, 3), np.nan))
    order = along_curve(mesh.points)
    none = network.choice(np.empty(0, np.int32))
    network.lower(mesh.points, everyone, order, none, field, hints=nearest, **with_)
    proved = (field.way >= 0) | (h0 <= lower)
    upper = _spread(mesh, np.where(proved, lower, h0), g, report)
    proved |= np.isinf(upper)  # nothing comes there
    # Ways as short as those along edges of the mesh count, too: they may go on over other edges.
    field.sizes[:] = np.where(proved, np.minimum(lower, upper), upper + _TIE * np.abs(upper))
    hidden = order[~proved[order]]
    finished = True
    if len(hidden):
        finished = _solve_hidden(network, field, hidden, everyone, with_)
    return _result(mesh, network, field, upper, lower, finished, report)


def _solve_hidden(
    network: Network, field: Field, hidden: IntArray, everyone: IntArray, with_: _Options
) -> bool:
    """Lower nodes (In/Out: field) that do not see what allows least at them.

    Returns whether this came to its end within _ROUNDS rounds.
    """
    points, knots = network.sight.stars.points, network.knots.nodes
    network.lower(points, everyone, hidden, network.sources(), field, **with_)
    waiting = np.isin(knots, hidden)
    order = knots[waiting]
    changed = np.flatnonzero(field.way[knots] >= 0).astype(np.int32)
    for _ in range(_ROUNDS):
        if len(changed) == 0:
            break
        network.set_knots(field.sizes[knots])
        fresh = np.concatenate([network.n_sources + changed, network.extend(changed, field)])
        if len(order) == 0:  # the ways are made, and no node of an edge waits for them
            changed = order
            break
        before = field.sizes[knots]
        network.lower(points, everyone, order, network.choice(fresh), field, **with_)
        fallen = before - field.sizes[knots]
        changed = np.flatnonzero(fallen > _EQUAL * np.abs(before)).astype(np.int32)
    network.set_knots(field.sizes[knots])
    network.used = network.choice(_in_use(network, field))
    rest = hidden[~np.isin(hidden, knots)]
    network.lower(points, everyone, rest, network.used, field, **with_)
    return len(changed) == 0


def _in_use(network: Network, field: Field) -> IntArray:
    """Return the ways from nodes of reflex edges, and those over edges that reach such a node."""
    ways, knots = network.ways, network.knots
    bent = np.flatnonzero(ways.edge >= 0)
    edge, way, _, _ = network.candidates(np.arange(len(knots.nodes), dtype=np.int32), field)
    used = np.isin(_key(ways.edge[bent], ways.parent[bent]), _key(edge, way))
    straight = network.n_sources + np.arange(len(knots.nodes))
    return np.concatenate([straight, bent[used]])


def _spread(mesh: SimplexMesh, h: FloatArray, g: float, report: ProgressCallback) -> FloatArray:
    """Return what is left of sizes when none exceeds that of a neighbour by more than g allows."""
    return solve_edge_based(mesh, h, Slope(np.array([g])), residual=False, report=report).h


def _result(
    mesh: SimplexMesh,
    network: Network,
    field: Field,
    upper: FloatArray,
    lower: FloatArray,
    finished: bool,
    report: ProgressCallback,
) -> SpaceResult:
    """Return sizes that keep to g along all edges, and their origins."""
    ways = network.ways
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    h = _spread(mesh, sizes, network.g, report)
    m = network.n_sources
    base = np.where(field.way >= 0, ways.base[field.way], -1)
    base[h < sizes - _TIE * np.abs(sizes)] = -1
    bend = np.where((ways.edge[field.way] >= 0)[:, None], field.last, np.nan)
    entry = np.where(base < m, base, -1)
    proved = h <= lower + _EQUAL * np.abs(lower)
    return SpaceResult(h, entry.astype(np.int32), bend, proved, lower, network, finished)
