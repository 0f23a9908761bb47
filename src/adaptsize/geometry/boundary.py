"""The boundary of a flat domain, shared by all methods that use lines of sight.

The *walls* are defined as follows:

* A facet of one cell is a wall, and so are both faces of a crack or slit.
* A facet of several cells is a wall if all of them lie on the same side of it (a fold).
* Duplicate cells have no effect.
* Cells without measure are removed as long as one of their facets has no other cell, such as flat
  cells on the hull.  The remaining ones join the cells on both sides, for example between an edge
  and the two halves that it should have.
* Where the nodes on the two sides of a line do not match and no such cell fills the gap, there is
  a crack, with passages at the nodes that both sides share.

Nodes in no cell are not in the domain.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import topology as kernels
from adaptsize._kernels.sight import ANY, NARROW, WIDE
from adaptsize.background.topology import unique_rows
from adaptsize.geometry.convexity import FLAT
from adaptsize.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


class FlatBoundary(NamedTuple):
    """The walls of triangles in the plane or of tetrahedra.

    Parameters
    ----------
    facets : int32[f, dim]
        The domain to the left (2-D), normals outward (3-D).
    cells : int32[f]
        A cell with measure at each facet.
    is_simple : bool
        Whether no wall is shared by several cells.
    alias : int32[n_points]
        Representative of each node, if cells join coincident nodes.
    has_flat : bool
        Whether any cell has no measure, or so little at the boundary that it counts as
        none.
    """

    facets: IntArray
    cells: IntArray
    is_simple: bool
    alias: IntArray | None = None
    has_flat: bool = False


class PlaneBoundary(NamedTuple):
    """The boundary of a plane domain for lines of sight.

    Parameters
    ----------
    walls : float64[w, 4]
        Start and end of each straight piece, the domain to the left.
    rows : int32[n_points]
        Row of each node of the boundary, -1 inside.
    first : int32[b + 1]
        The sectors of the node in row b are ``first[b]`` to ``first[b + 1] - 1``.
    sectors : float64[k, 5]
        Cones of the sectors (see sight.py).
    corners : int32[c]
        Nodes at which shortest paths may bend.
    free : bool[c]
        Whether a path may go from one sector of the corner into another.
    slack : float
        Distance from a line below which a point is on the line.
    """

    walls: FloatArray
    rows: IntArray
    first: IntArray
    sectors: FloatArray
    corners: IntArray
    free: BoolArray
    slack: float


def flat_boundary(mesh: SimplexMesh, threads: int = 1) -> FlatBoundary:
    """Return the walls of a mesh of triangles in the plane or of tetrahedra.

    O(n_cells); facets inside the mesh are never listed.
    """
    return _walls(mesh.points, mesh.cells, threads, True)


def _walls(points: FloatArray, cells: IntArray, threads: int, may_merge: bool) -> FlatBoundary:
    n = len(points)
    sums, flat = _sums(points, cells, threads)
    if flat and may_merge:
        merged, alias = _without_short_edges(points, cells)
        if alias is not None:
            return _walls(points, merged, 1, False)._replace(alias=alias, has_flat=True)
    rows, side, cell = _facets_at(points, cells, sums != 0)
    if len(rows) == 0:  # only folds
        return FlatBoundary(rows, cell, False, has_flat=flat)
    unique, group = unique_rows(rows, n)
    if (side == 0).any():
        flat = True
        kept = _without_flat_cells(group, side, cell, len(unique))
        rows, side, cell, group = rows[kept], side[kept], cell[kept], group[kept]
    joined = np.zeros(len(unique), bool)
    joined[group[side == 0]] = True
    left, right = (np.bincount(group[side == s], minlength=len(unique)) for s in (1, -1))
    is_wall = ((left == 0) != (right == 0)) & ~joined
    owner = np.zeros(len(unique), np.int32)
    owner[group] = cell
    facets = unique[is_wall]
    flip = left[is_wall] == 0
    facets[flip, :2] = facets[flip, 1::-1]
    is_simple = bool((left + right)[is_wall].max(initial=1) == 1)
    return FlatBoundary(facets, owner[is_wall], is_simple, has_flat=flat)


def _sums(points: FloatArray, cells: IntArray, threads: int) -> tuple[npt.NDArray[np.uint64], bool]:
    """Return the sums of `kernels.sum_facets`, and whether any cell has no measure."""
    n, m = len(points), len(cells)
    axes = (0,) * points.shape[1]
    # Smallest number of cells for a second thread.
    if threads == 1 or m < 100_000:
        sums = np.zeros(n, np.uint64)
        return sums, bool(kernels.sum_facets(points, axes, cells, sums))
    marks = np.linspace(0, m, 4 * threads + 1).astype(int).tolist()
    unused = [np.zeros(n, np.uint64) for _ in range(threads)]
    every = list(unused)

    def add(first: int, last: int) -> bool:
        own = unused.pop()  # there are as many as threads
        flat = bool(kernels.sum_facets(points, axes, cells[first:last], own))
        unused.append(own)
        return flat

    with ThreadPoolExecutor(threads) as pool:
        flats = list(pool.map(add, marks[:-1], marks[1:]))
    sums = every[0]
    for own in every[1:]:
        sums += own
    return sums, any(flats)


def _facets_at(
    points: FloatArray, cells: IntArray, marked: BoolArray
) -> tuple[IntArray, npt.NDArray[np.int8], IntArray]:
    """Return the facets all of whose nodes are marked, once for each of their cells.

    Returns
    -------
    facets : int32[f, dim]
        Nodes.
    side : int8[f]
        1 if the normal of the facet, its nodes in ascending order, points out of its cell, -1 if
        into it, 0 if the cell has no measure.
    cell : int32[f]
        Its cell.
    """
    dim = cells.shape[1] - 1
    near = _cells_with(cells, marked, dim)
    own = cells[near]
    on = marked[own.T]
    at, opposite = np.nonzero((on.all(axis=0) | ~on).T)
    nodes = own[at[:, None], (opposite[:, None] + np.arange(1, dim + 1)) % (dim + 1)]
    is_odd = nodes[:, 0] > nodes[:, 1]
    if dim == 3:
        is_odd ^= (nodes[:, 1] > nodes[:, 2]) ^ (nodes[:, 0] > nodes[:, 2]) ^ (opposite % 2 == 1)
    measure = _relative_measures(points, own)[at]
    side = np.where(is_odd != (measure < 0.0), -1, 1).astype(np.int8)
    # Cells with a smaller ratio of measure to the power of the longest edge have no measure.
    side[np.abs(measure) < 1e-12] = 0
    return nodes, side, near[at]


def _relative_measures(points: FloatArray, cells: IntArray) -> FloatArray:
    """Return signed determinants of cells whose longest edge at the first node has length 1."""
    corners = [points.T[:, nodes] for nodes in cells.T]
    edges = [corner - corners[0] for corner in corners[1:]]
    longest = np.sqrt(np.maximum.reduce([np.einsum("ij,ij->j", e, e) for e in edges]))
    scale = 1.0 / np.where(longest > 0.0, longest, 1.0)
    a, b, *more = [e * scale for e in edges]
    if not more:
        return np.asarray(a[0] * b[1] - a[1] * b[0])
    normal = [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
    return np.asarray(sum(n * c for n, c in zip(normal, more[0], strict=True)))


def _cells_with(cells: IntArray, marked: BoolArray, least: int) -> IntArray:
    """Return the cells with at least so many marked nodes."""
    found = np.empty(64 + 8 * int(np.count_nonzero(marked)), np.int32)  # enough but for piles
    count = kernels.list_cells(cells, marked, least, found)
    if count > len(found):
        found = np.empty(count, np.int32)
        kernels.list_cells(cells, marked, least, found)
    return found[:count]


def _without_short_edges(points: FloatArray, cells: IntArray) -> tuple[IntArray, IntArray | None]:
    """Return the cells with coincident nodes of a cell merged, and the representatives."""
    parent = np.arange(len(points), dtype=np.int32)
    pairs = [cells[:, [v, w]] for v in range(cells.shape[1]) for w in range(v)]
    short = [rows[(points[rows[:, 0]] == points[rows[:, 1]]).all(axis=1)] for rows in pairs]
    if not any(map(len, short)):
        return cells, None
    kernels.join_cells(np.ascontiguousarray(np.concatenate(short)), parent)
    while not np.array_equal(parent, parent[parent]):
        parent = parent[parent]
    merged = parent[cells]
    ordered = np.sort(merged, axis=1)
    whole = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    return np.ascontiguousarray(merged[whole]), parent


def _without_flat_cells(
    group: IntArray, side: npt.NDArray[np.int8], cell: IntArray, n_groups: int
) -> BoolArray:
    """Return which rows are left after flat cells with a free facet are removed repeatedly."""
    kept = np.ones(len(group), bool)
    while True:
        times = np.bincount(group[kept], minlength=n_groups)
        lost = np.unique(cell[kept & (side == 0) & (times[group] == 1)])
        if len(lost) == 0:
            return kept
        kept &= ~((side == 0) & np.isin(cell, lost))


def plane_boundary(mesh: SimplexMesh, boundary: FlatBoundary) -> PlaneBoundary:
    """Return walls, sectors and corners of a mesh of triangles in the plane.

    At a node where one wall enters and one leaves, there is one sector between them.  At other
    nodes the cells are traversed from wall to wall.
    """
    points, (start, end) = mesh.points, boundary.facets.T
    n = mesh.n_points
    nodes = np.unique(boundary.facets).astype(np.int32)
    # Distances between a point and a line below this share of the diagonal are zero.
    slack = 1e-11 * float(np.hypot(*np.ptp(points[nodes], axis=0)))
    regular = np.bincount(start, minlength=n)[nodes] == 1
    regular &= np.bincount(end, minlength=n)[nodes] == 1
    leaving, entering = np.zeros(n, np.int32), np.zeros(n, np.int32)
    leaving[start] = entering[end] = np.arange(len(start))
    i = nodes[regular]
    ahead, back = points[end[leaving[i]]] - points[i], points[start[entering[i]]] - points[i]
    owner, cones = i, np.concatenate([_unit(ahead), _unit(back)], axis=1)
    if not regular.all():
        several, fans = _fans(mesh, boundary, nodes[~regular])
        owner, cones = np.concatenate([i, several]), np.concatenate([cones, fans])
    rows, first, sectors, angles = _sectors(n, nodes, owner, cones)
    if boundary.alias is not None:
        rows = rows[boundary.alias]

    turn = np.maximum.reduceat(angles, first[:-1])
    is_end = np.ones(n, np.bool_)
    is_end[nodes[regular & (np.abs(turn - np.pi) < FLAT)]] = False
    walls = np.empty((len(start), 4))
    pieces = (start, end, leaving[end], is_end[start])
    count = kernels.merge_walls(points, pieces, is_end, slack, walls)
    free = (np.diff(first) != 1) | (sectors[first[:-1], 4] == ANY)
    bends = is_end[nodes] & (free | (turn > np.pi))
    return PlaneBoundary(walls[:count], rows, first, sectors, nodes[bends], free[bends], slack)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.hypot(*vectors.T)[:, None]
    out = np.zeros_like(vectors)
    np.divide(vectors, length, out=out, where=length > 0.0)
    return out


def _sectors(
    n: int, nodes: IntArray, owner: IntArray, cones: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the rows of nodes, their sectors, and the angles of the sectors, 0 to 2 pi."""
    order = np.argsort(owner, kind="stable")
    owner, cones = owner[order], cones[order]
    rows = np.full(n, -1, np.int32)
    rows[nodes] = np.arange(len(nodes))
    first = np.concatenate([[0], np.cumsum(np.bincount(rows[owner], minlength=len(nodes)))])
    cross = cones[:, 0] * cones[:, 3] - cones[:, 1] * cones[:, 2]
    dot = cones[:, 0] * cones[:, 2] + cones[:, 1] * cones[:, 3]
    angles = np.mod(np.arctan2(cross, dot), 2.0 * np.pi)
    angles[angles < FLAT] = 2.0 * np.pi  # both faces of a slit: a sector has some width
    kinds = np.where(angles > np.pi, WIDE, NARROW)
    kinds[(cones == 0.0).all(axis=1)] = ANY
    return rows, first.astype(np.int32), np.column_stack([cones, kinds]), angles


def _fans(
    mesh: SimplexMesh, boundary: FlatBoundary, nodes: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return the sectors at nodes with several walls: their nodes and cones.

    A fan of cells begins at a wall and continues through edges that are not walls to the next
    wall.  With folded cells this may fail.  Then all directions are allowed; the walls restrict
    them sufficiently.
    """
    marked = np.zeros(mesh.n_points, np.bool_)
    marked[nodes] = True
    around = _cells_with(mesh.cells, marked, 1)
    at_wall = marked[boundary.facets].any(axis=1)
    walls = {tuple(sorted(pair)) for pair in boundary.facets[at_wall].tolist()}
    after: dict[int, dict[int, int]] = {i: {} for i in nodes.tolist()}
    folded = set()
    signed = mesh.signed_measures[around]
    for triangle, measure in zip(mesh.cells[around].tolist(), signed.tolist(), strict=True):
        cell = triangle if measure > 0.0 else triangle[::-1]
        for v, i in enumerate(cell):
            p, q = cell[(v + 1) % 3], cell[(v + 2) % 3]
            if marked[i] and after[i].setdefault(p, q) != q:
                folded.add(i)
    owner, cones = [], []
    for i in nodes.tolist():
        pairs = [] if i in folded else _sectors_at(i, after[i], walls)
        for p, q in pairs:
            arms = _unit(mesh.points[[p, q]] - mesh.points[i])
            owner.append(i)
            cones.append(arms.ravel())
        if not pairs:
            owner.append(i)
            cones.append(np.zeros(4))
    return np.array(owner, np.int32), np.array(cones).reshape(-1, 4)


def _sectors_at(
    i: int, after: dict[int, int], walls: set[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Return the first and last neighbour of each fan around node i; none if inconsistent."""
    pairs = []
    for p, next_to_p in after.items():
        if (min(i, p), max(i, p)) not in walls:
            continue
        q = next_to_p
        for _ in after:
            if (min(i, q), max(i, q)) in walls or q not in after:
                break
            q = after[q]
        if (min(i, q), max(i, q)) not in walls:
            return []
        pairs.append((p, q))
    return pairs
