"""Repair of defective triangulations of surfaces, by topology: what is closed stays closed.

No triangle is deleted because it has no area, since that opens a surface.  A triangle with two
corners in one place vanishes with the edge between them.  One with a corner on its opposite edge
vanishes when the triangles on the other side of this edge are divided there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush
from itertools import pairwise

import numpy as np

from adaptsize._checks import place_text
from adaptsize.background import SimplexMesh, tuning
from adaptsize.background.merging import first_at_place
from adaptsize.background.topology import components_of, have_different_nodes, unique_rows
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: A triangle is flat if its height is at most this times the distance within which points are
#: merged.  With one half, the edges that divide a flat triangle are shorter than its longest one.
_FLAT = 0.5
#: A node lies on an open edge within this times the diagonal.  It is above the rounding of the
#: single precision of STL files.
_ON_EDGE = 1e-6
#: Times that open edges are looked for, as long as there are copies of triangles.
_ROUNDS = 3
#: Triangles that may be divided per flat one.  Chains of flat triangles need one or two each.
_MOST_DIVISIONS = 50
#: Spheres that cover a long open edge where nodes on it are looked for.
_MOST_SPHERES = 64


@dataclass(frozen=True)
class Repair:
    """Repairs of one kind."""

    kind: str
    """What was done to what, as in "duplicate point{s} merged"."""
    count: int
    place: tuple[float, ...]
    """The first place."""

    def __str__(self) -> str:
        """Return count, kind and the first place."""
        text = self.kind.format(s="s" if self.count > 1 else "")
        first = "the first at" if self.count > 1 else "at"
        return f"{self.count} {text} ({first} {place_text(self.place, 4)})"


@dataclass
class RepairedTriangles:
    """Triangles without defects, and where they come from."""

    cells: IntArray
    """int32[n, 3]"""
    owner: IndexArray
    """intp[n]: the given triangle that each is, or is a part of."""
    target: IndexArray
    """intp[n_points]: the node with which each was joined, or itself."""
    repairs: list[Repair] = field(default_factory=list)
    halves: dict[tuple[int, int], int] = field(default_factory=dict)
    """The node that divides an edge, by its ends in ascending order."""

    def only(self, kept: BoolArray) -> None:
        """Keep some of the triangles."""
        self.cells, self.owner = self.cells[kept], self.owner[kept]

    def note(self, kind: str, places: FloatArray) -> None:
        """Note repairs of one kind at the given places."""
        if len(places) == 0:
            return
        for k, known in enumerate(self.repairs):
            if known.kind == kind:
                self.repairs[k] = replace(known, count=known.count + len(places))
                return
        self.repairs.append(Repair(kind, len(places), tuple(places[0].tolist())))

    def parts(self, start: int, end: int) -> Iterator[tuple[int, int]]:
        """Yield the edges into which an edge was divided, in order; itself if it was not."""
        between = self.halves.get((min(start, end), max(start, end)))
        if between is None:
            yield start, end
        else:
            yield from self.parts(start, between)
            yield from self.parts(between, end)


def repair_triangles(points: FloatArray, cells: IntArray, merged: float) -> RepairedTriangles:
    """Return triangles without copies, flat ones, and nodes on edges of others.

    Edges that belong to an even number of triangles do so afterwards.  Nodes do not move.

    Parameters
    ----------
    points : float64[n_points, 3]
    cells : int32[n, 3]
        With merged nodes.
    merged : float
        Distance within which nodes were merged.
    """
    found = RepairedTriangles(
        np.array(cells, np.int32), np.arange(len(cells)), np.arange(len(points))
    )
    _collapse(points, found)
    moved = 0.0
    for _ in range(_ROUNDS):  # copies may hide that edges are open
        moved = max(moved, _join_twins(points, found))
        _collapse(points, found)
        _join_nodes_on_edges(points, found)
        if not _remove_copies(points, found):
            break
    # Triangles whose corners lay on their opposite edges have got heights by what moved.
    if _divide_at_flat_triangles(points, found, max(_FLAT * merged, moved)):
        _remove_copies(points, found)
    return found


def _collapse(points: FloatArray, found: RepairedTriangles) -> None:
    """Remove triangles with two corners in one node: the other two edges are one."""
    have_area = have_different_nodes(found.cells)
    places = points[found.cells[~have_area, 0]]
    found.only(have_area)
    found.note("triangle{s} with corners in one place collapsed", places)


def _join_twins(points: FloatArray, found: RepairedTriangles) -> float:
    """Join nodes of open edges that are nearly equal, where edges then match.

    Return the largest distance, 0 if there are none.
    """
    mesh = _distinct(points, found.cells)
    if mesh is None:
        return 0.0
    edges = mesh.facets[mesh.facet_cell_counts == 1]
    ends = points[edges]
    lengths, most = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), _ON_EDGE * mesh.diagonal
    # Edges of slivers, whose ends are nearly equal, too, say nothing of the details of a part.
    shortest = float(lengths[lengths > most].min(initial=np.inf))
    nodes = np.unique(edges)
    near = np.arange(len(points))
    within = min(most, tuning.SHARE_OF_EDGE * shortest)
    near[nodes] = nodes[first_at_place(points[nodes], within)]
    number = unique_rows(near[edges].astype(np.int32), len(points))[1]
    joined = near[edges[np.bincount(number)[number] > 1]]
    every = np.arange(len(points))
    near = np.where(np.isin(near, joined), near, every)
    moved = np.flatnonzero(near != every)
    found.target, found.cells = near[found.target], near[found.cells].astype(np.int32)
    found.note("nearly equal point{s} on open edges joined", points[moved])
    return float(np.linalg.norm(points[moved] - points[near[moved]], axis=1).max(initial=0.0))


def _distinct(points: FloatArray, cells: IntArray) -> SimplexMesh | None:
    """Return the triangles, copies once, or None if they have no open edges."""
    if len(cells) == 0:
        return None
    first = np.unique(unique_rows(cells, len(points))[1], return_index=True)[1]
    mesh = SimplexMesh(points, cells[first])
    return mesh if (mesh.facet_cell_counts == 1).any() else None


def _remove_copies(points: FloatArray, found: RepairedTriangles) -> bool:
    """Remove triangles of the same three nodes as others, and return whether there are any.

    Of an odd number one stays.  Of an even number one stays, too, but for two cases.  None stays if
    one would leave open edges which are none without it: the two sides of a fin, which bounds
    nothing.  All stay if their edges are balanced with all of them, as where a body in another one
    has a part of its boundary.
    """
    cells = found.cells
    number = unique_rows(cells, len(points))[1] if len(cells) else np.empty(0, np.int32)
    copies = np.bincount(number)
    if copies.max(initial=0) <= 1:
        return False
    # 1 or -1 for the two orientations of the same nodes.
    order = np.argsort(cells, axis=1)
    turns = (order[:, 1] - order[:, 0]) * (order[:, 2] - order[:, 0])
    sign = np.where(turns * (order[:, 2] - order[:, 1]) > 0, 1.0, -1.0)
    total = np.bincount(number, sign)
    # The first one that is oriented as most of them.
    by_orientation = np.lexsort((np.arange(len(cells)), -sign * np.sign(total)[number], number))
    first = by_orientation[np.cumsum(copies) - copies]
    most = np.ones(len(copies), np.intp)
    is_even = copies % 2 == 0
    if is_even.any():
        mesh = SimplexMesh(points, cells[first])
        lost, balanced = _fate_of_pairs(mesh, is_even, sign[first] * total)
        most[lost], most[balanced] = 0, copies[balanced]
    kept = np.zeros(len(cells), np.bool_)
    kept[first[most > 0]] = True
    kept |= (most == copies)[number]
    gone = points[cells[~kept]].mean(axis=1)
    found.only(kept)
    found.note("duplicate triangle{s} removed", gone)
    return True


def _fate_of_pairs(
    mesh: SimplexMesh, is_even: BoolArray, total: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return which triangles vanish with all copies, and of which all copies stay.

    That is decided for patches of triangles of even multiplicity, which are connected where no
    others are.

    Parameters
    ----------
    mesh : SimplexMesh
        The triangles without copies.
    is_even : bool[n_cells]
    total : float64[n_cells]
        Copies with the orientation of the triangle, less those with the opposite one.
    """
    n, n_edges, v = mesh.n_cells, len(mesh.edges), np.arange(3)
    others = np.bincount(mesh.cell_facets[~is_even].ravel(), minlength=n_edges)
    rows = np.flatnonzero(is_even)
    edges = mesh.cell_facets[rows].ravel()
    beside = np.column_stack([np.repeat(rows, 3), n + edges])[others[edges] == 0]
    patch = np.unique(components_of(beside, n + n_edges)[rows], return_inverse=True)[1].reshape(-1)
    rims, count = np.unique(
        np.column_stack([np.repeat(patch, 3), edges]), axis=0, return_counts=True
    )
    of_patch, around = rims[:, 0], others[rims[:, 1]]
    open_if_kept = np.bincount(of_patch, around + count == 1)
    open_if_not = np.bincount(of_patch, around == 1)
    odd_if_not = np.bincount(of_patch, around % 2 == 1)
    is_attached = np.bincount(of_patch, around > 0) > 0
    cancels = np.bincount(patch, total[rows] != 0.0) == 0
    removed = np.where(
        cancels, open_if_not < open_if_kept, is_attached & (odd_if_not == 0) & (open_if_kept > 0)
    )
    ahead = mesh.cells[:, (v + 1) % 3] < mesh.cells[:, (v + 2) % 3]
    signs = np.where(ahead, 1.0, -1.0) * total[:, None]
    balance = np.bincount(mesh.cell_facets.ravel(), signs.ravel(), n_edges)
    odd = np.bincount(of_patch, balance[rims[:, 1]] != 0.0)
    balanced = is_attached & ~removed & ~cancels & (odd == 0)
    # Sheets with two sides that are attached to nothing stay, unless the rest is closed.
    loose = removed & ~is_attached
    rest = np.ones(n, np.bool_)
    rest[rows[removed[patch]]] = False
    left = np.bincount(mesh.cell_facets[rest].ravel(), minlength=n_edges)
    if not rest.any() or (left == 1).any():
        removed &= ~loose
    of_cell = np.zeros((2, n), np.bool_)
    of_cell[:, rows] = removed[patch], balanced[patch]
    return of_cell[0], of_cell[1]


def _join_nodes_on_edges(points: FloatArray, found: RepairedTriangles) -> None:
    """Divide open edges at nodes of other open edges that lie on them, where edges then match.

    Copies of a triangle count as one, and are divided all.
    """
    mesh = _distinct(points, found.cells)
    if mesh is None:
        return
    edges = mesh.facets[mesh.facet_cell_counts == 1]
    divided = {
        (int(a), int(b)): nodes
        for (a, b), nodes in zip(edges, _nodes_on(points, edges, mesh), strict=True)
        if nodes
    }
    pieces: dict[tuple[int, int], int] = defaultdict(int)
    for a, b in edges.tolist():
        for piece in _pieces(a, divided.get((a, b), []), b):
            pieces[piece] += 1
    patches = _Patches(points, found)
    joined = []
    for (start, end), nodes in divided.items():
        chain, left = [start, *nodes, end], start
        for k, node in enumerate(nodes, 1):
            beside = _pieces(chain[k - 1], [node], chain[k + 1])
            if any(pieces[piece] > 1 for piece in beside):
                patches.divide(left, end, node)
                joined.append(node)
                left = node
    patches.finish()
    found.note("node{s} on open edges of other triangles joined with these", points[joined])


def _pieces(start: int, nodes: Sequence[int], end: int) -> list[tuple[int, int]]:
    """Return the parts of an edge between nodes on it, each in ascending order."""
    return [(min(a, b), max(a, b)) for a, b in pairwise([start, *nodes, end])]


def _nodes_on(points: FloatArray, edges: IntArray, mesh: SimplexMesh) -> list[list[int]]:
    """Return the nodes of other edges that lie on each edge, in the order along it."""
    from scipy.spatial import cKDTree

    within = _ON_EDGE * mesh.diagonal
    nodes = np.unique(edges)
    tree = cKDTree(points[nodes])
    start, along = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    count = np.clip(np.ceil(length / np.median(length)), 1, _MOST_SPHERES).astype(np.intp)
    edge = np.repeat(np.arange(len(edges)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    centre = start[edge] + ((step + 0.5) / count[edge])[:, None] * along[edge]
    radius = 0.5 * length[edge] / count[edge] + within
    on: list[list[int]] = [[] for _ in edges]
    places: list[list[float]] = [[] for _ in edges]
    apexes = defaultdict(set)  # a corner of its own triangle is none
    for c, v in zip(*np.nonzero(mesh.facet_cell_counts[mesh.cell_facets] == 1), strict=True):
        apexes[tuple(np.sort(np.delete(mesh.cells[c], v)).tolist())].add(int(mesh.cells[c, v]))
    for first in range(0, len(edge), 4096):
        chunk = slice(first, first + 4096)
        near = tree.query_ball_point(centre[chunk], radius[chunk])
        row = np.repeat(edge[chunk], [len(one) for one in near])
        node = nodes[np.concatenate([np.asarray(one, np.intp) for one in near])]
        offset = points[node] - start[row]
        t = np.einsum("ij,ij->i", offset, along[row]) / np.maximum(length[row], 1e-300)
        across = np.linalg.norm(
            offset - (t / np.maximum(length[row], 1e-300))[:, None] * along[row], axis=1
        )
        good = (across <= within) & (t > within) & (t < length[row] - within)
        for k, i, at in zip(row[good].tolist(), node[good].tolist(), t[good].tolist(), strict=True):
            if i not in on[k] and i not in apexes[tuple(edges[k].tolist())]:
                on[k].append(i)
                places[k].append(at)
    return [
        [i for _, i in sorted(zip(at, found, strict=True))]
        for at, found in zip(places, on, strict=True)
    ]


def _divide_at_flat_triangles(points: FloatArray, found: RepairedTriangles, flat: float) -> bool:
    """Remove triangles with a corner on the opposite edge; return whether there are any.

    The triangles on the other side of this edge are divided at the corner.  If these are flat, too,
    their longest edges are shorter than before, so this ends.  A flat triangle that only hangs on
    others is removed.
    """
    corners = points[found.cells]
    waiting = [(-float(longest), int(cell)) for cell, longest in _flat_ones(corners, flat)]
    if not waiting:
        return False
    heapify(waiting)
    patches, places, done = _Patches(points, found), [], set[frozenset[int]]()
    left = _MOST_DIVISIONS * (len(waiting) + 10)
    while waiting and left > 0:
        cell = heappop(waiting)[1]
        if not patches.is_there[cell]:
            continue
        nodes = patches.cells[cell]
        # Triangles that others only just make flat may return, and stay then.
        if frozenset(nodes) in done:
            continue
        done.add(frozenset(nodes))
        v = _apex(points[list(nodes)])
        a, b, c = nodes[(v + 1) % 3], nodes[(v + 2) % 3], nodes[v]
        places.append(points[c])
        counts = [len(patches.at_edge(*ends)) for ends in ((a, b), (b, c), (c, a))]
        if sum(count % 2 for count in counts) > 1:
            patches.remove(cell)
            continue
        made = patches.divide(a, b, c)
        left -= 1 + len(made)
        if made:
            of_made = points[[patches.cells[k] for k in made]]
            for k, longest in _flat_ones(of_made, flat):
                heappush(waiting, (-longest, made[k]))
    patches.finish()
    found.note("triangle{s} of area 0 removed without opening the surface", np.array(places))
    return True


def _flat_ones(corners: FloatArray, flat: float) -> list[tuple[int, float]]:
    """Return the numbers and longest edges of triangles whose height is at most ``flat``."""
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.flatnonzero(np.linalg.norm(cross, axis=1) <= flat * sides)
    return list(zip(rows.tolist(), sides[rows].tolist(), strict=True))


def _apex(corners: FloatArray) -> int:
    """Return the corner opposite to the longest edge."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - np.roll(corners, -2, axis=0), axis=1)
    return int(sides.argmax())


class _Patches:
    """Triangles that can be divided one by one, with those at each node."""

    def __init__(self, points: FloatArray, found: RepairedTriangles) -> None:
        self._found = found
        self.cells: list[tuple[int, int, int]] = [(a, b, c) for a, b, c in found.cells.tolist()]
        self._owner: list[int] = found.owner.tolist()
        self.is_there = [True] * len(self.cells)
        mesh = SimplexMesh(points, found.cells)
        self._first, self._around = mesh.rings
        self._more: dict[int, list[int]] = defaultdict(list)

    def _at(self, node: int) -> list[int]:
        old = self._around[self._first[node] : self._first[node + 1]].tolist()
        return [cell for cell in (*old, *self._more[node]) if self.is_there[cell]]

    def at_edge(self, a: int, b: int) -> list[int]:
        """Return the triangles at an edge."""
        return [cell for cell in self._at(a) if b in self.cells[cell]]

    def remove(self, cell: int) -> None:
        """Remove a triangle."""
        self.is_there[cell] = False

    def divide(self, a: int, b: int, node: int) -> list[int]:
        """Divide all triangles at an edge, and return the parts; those with the node vanish."""
        made = []
        for cell in self.at_edge(a, b):
            self.remove(cell)
            nodes = self.cells[cell]
            if node in nodes:
                continue
            for end in (a, b):
                one, two, three = (node if k == end else k for k in nodes)
                made.append(len(self.cells))
                self.cells.append((one, two, three))
                self._owner.append(self._owner[cell])
                self.is_there.append(True)
                for k in (one, two, three):
                    self._more[k].append(made[-1])
        self._found.halves[min(a, b), max(a, b)] = node
        return made

    def finish(self) -> None:
        """Store the triangles."""
        there = np.array(self.is_there, np.bool_)
        self._found.cells = np.array(self.cells, np.int32).reshape(-1, 3)
        self._found.owner = np.array(self._owner, np.intp)
        self._found.only(there)
