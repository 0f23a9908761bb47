"""Intersections of the cells of two meshes: their measures, and products of linear functions."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.sparse import csr_array

from adaptsize._kernels.clipping import new_clipping
from adaptsize._kernels.overlap import Front, fill_overlaps, fill_rows
from adaptsize._kernels.trees import Tree
from adaptsize._workers import Workers
from adaptsize.adaptation import tuning
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import centroids, read_only
from adaptsize.background.location import in_space
from adaptsize.background.merging import hashes_of, merge_equal_points
from adaptsize.background.topology import any_of, marked, places_among, rings, unique_rows
from adaptsize.typing import FloatArray, IndexArray, IntArray, LongArray

# New nodes of one task, some milliseconds.
_NODES_AT_ONCE = 8192


class Intersections(NamedTuple):
    """Integrals over the intersections of the cells of two meshes."""

    measures: csr_array
    """Sparse [n_cells of the new mesh, n_cells of the old one]."""
    products: csr_array
    r"""The mixed mass matrix, sparse [n_points of the new mesh, n_points of the old one].

    Its entries are the integrals of :math:`\phi_i \psi_j` over the common domain, where
    :math:`\phi_i` and :math:`\psi_j` are the hat functions of the two meshes.  They are exact to
    rounding.
    """


def measures_of_overlaps(old: SimplexMesh, new: AnyMesh, workers: Workers) -> csr_array:
    """Return the measures of the intersections alone, see `intersections_of`."""
    common = _common_cells(old, new)
    order = _order_of(new, common)
    parts = _in_chunks(old, new, order, workers, products=False)
    return _measures(old, new, (order, parts), common)


def intersections_of(old: SimplexMesh, new: AnyMesh, workers: Workers) -> Intersections:
    """Return integrals over the intersections of the cells of a mesh and of those of this rank.

    Cells that are the same in both meshes are not intersected with others.  The result does not
    depend on the number of threads, to the last bit.
    """
    common = _common_cells(old, new)
    order = _order_of(new, common)
    parts = _in_chunks(old, new, order, workers, products=True)
    products = _mixed_mass(old, new, _members_of(old, new, (order, parts), common), workers)
    return Intersections(_measures(old, new, (order, parts), common), products)


#: Old nodes of each new cell, and integrals, as `fill_rows` takes them.
_Members: TypeAlias = tuple[LongArray, LongArray, IntArray, FloatArray]
#: Numbers of entries of rows, and the columns and values of these.
_Rows: TypeAlias = tuple[LongArray, IntArray, FloatArray]


class _Common(NamedTuple):
    """Cells of two meshes that are the same, with corners in the same order."""

    old: IndexArray
    """intp[n]"""
    new: IndexArray
    old_corners: IntArray
    """int32[n, k]"""
    new_corners: IntArray


def _common_cells(old: SimplexMesh, new: AnyMesh) -> _Common:
    """Return the cells with the same corners, to the last bit, in both meshes."""
    places = _same_places(old.points, new.points)
    rows, corners, keys = [], [], []
    for mesh, own, others in zip((old, new), places, places[::-1], strict=True):
        in_both = (own >= 0) & marked(others[others >= 0], old.n_points)[own]
        found = np.flatnonzero(~any_of(~in_both, mesh.cells))
        order = np.argsort(own[mesh.cells[found]], axis=1)
        rows.append(found)
        corners.append(np.take_along_axis(mesh.cells[found], order, axis=1))
        keys.append(own[corners[-1]].astype(np.int32))
    number = unique_rows(np.concatenate(keys), old.n_points)[1]
    row_of = np.full(len(number), -1)
    row_of[number[: len(keys[0])]] = np.arange(len(keys[0]))
    row = row_of[number[len(keys[0]) :]]
    are_same = row >= 0
    row = row[are_same]
    return _Common(rows[0][row], rows[1][are_same], corners[0][row], corners[1][are_same])


def _same_places(old: FloatArray, new: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return for old and new nodes the first old node at the same place, -1 for none."""
    one, other = hashes_of(old), hashes_of(new)
    order = np.argsort(one, kind="stable")
    ordered = one[order]
    first = order[np.searchsorted(ordered, one)]
    at = np.searchsorted(ordered, other).clip(max=len(order) - 1)
    found = np.where(ordered[at] == other, order[at], -1)
    kept = found >= 0
    if not (np.array_equal(old[first], old) and np.array_equal(old[found[kept]], new[kept])):
        # Two places share a hash.
        number = merge_equal_points(np.concatenate([old, new]))[1]
        place = np.full(len(number), -1)
        place[number[: len(old)][::-1]] = np.arange(len(old))[::-1]
        first, found = place[number[: len(old)]], place[number[len(old) :]]
    return first, found


def _members_of(
    old: SimplexMesh, new: AnyMesh, others: tuple[LongArray, list[_Overlaps]], common: _Common
) -> _Members:
    """Return the nodes, in the rows of the tree, and the integrals of all new cells."""
    (order, parts), k = others, old.cells.shape[1]
    # In a cell that is the same, the hat functions of the two meshes are.
    row_of_node = places_among(old.locator.node_of_point, old.n_points)
    are_same = new.cells[common.new][:, None, :] == common.new_corners[:, :, None]
    share = new.measures[common.new] / (_unit(old) * k * (k + 1.0))
    nodes = [part.nodes for part in parts]
    products = [part.products for part in parts]
    nodes.append(row_of_node[common.old_corners].ravel())
    products.append(((1.0 + are_same) * share[:, None, None]).reshape(-1, k))
    numbers = np.concatenate([*(part.n_nodes for part in parts), np.full(len(share), k)])
    which = np.concatenate([order, common.new])
    count, first = np.zeros((2, new.n_cells), np.int64)
    count[which], first[which] = numbers, np.cumsum(numbers) - numbers
    return first, count, np.concatenate(nodes), np.concatenate(products)


def _mixed_mass(old: SimplexMesh, new: AnyMesh, members: _Members, workers: Workers) -> csr_array:
    """Return the mixed mass matrix."""
    around, found = rings(new.cells, new.n_points), dict[int, _Rows]()
    cells = read_only(np.ascontiguousarray(new.cells))

    def task(first: int, last: int) -> None:
        room = int(members[1][around[1][around[0][first] : around[0][last]]].sum())
        counts, slot = np.empty(last - first, np.int64), np.zeros(old.n_points, np.int64)
        columns, values = np.empty(room, np.int32), np.empty(room)
        rows = counts, columns, values
        used = fill_rows(around, cells, members, (first, last), slot, rows)
        found[first] = counts, columns[:used], values[:used]

    workers.in_chunks(task, new.n_points, _NODES_AT_ONCE, "sums at the nodes")
    if not found:  # this rank has no nodes
        return csr_array((0, old.n_points))
    counts, columns, values = (
        np.concatenate(every) for every in zip(*(found[k] for k in sorted(found)), strict=True)
    )
    start = np.append(0, np.cumsum(counts))
    nodes = old.locator.node_of_point[columns]
    return csr_array((values * _unit(old), nodes, start), shape=(new.n_points, old.n_points))


def _order_of(new: AnyMesh, common: _Common) -> LongArray:
    """Return the other new cells in an order such that those in succession are near each other."""
    others = np.flatnonzero(~marked(common.new, new.n_cells))
    return others[along_curve(centroids(new.points, new.cells[others]))].astype(np.int64)


def _unit(old: SimplexMesh) -> float:
    """Return the measure that is 1 in the coordinates of the tree."""
    return float(old.locator.scale**-old.dim)


def _in_chunks(
    old: SimplexMesh, new: AnyMesh, order: LongArray, workers: Workers, *, products: bool
) -> list[_Overlaps]:
    """Return the integrals for new cells in a given order, for many at a time."""
    if len(order) == 0:
        return []
    points, cells = in_space(new.points * old.locator.scale), np.array(new.cells)
    neighbours = _neighbours(old)
    found: dict[int, _Overlaps] = {}

    def task(first: int, last: int) -> None:
        which = order[first:last]
        found[first] = _overlaps_of(old.locator.tree, neighbours, (points, cells), which, products)

    text = "overlaps of the cells of two meshes"
    workers.in_chunks(task, len(order), tuning.CELLS_AT_ONCE[new.dim], text)
    return [found[first] for first in sorted(found)]


def _measures(
    old: SimplexMesh, new: AnyMesh, others: tuple[LongArray, list[_Overlaps]], common: _Common
) -> csr_array:
    """Return the measures in the order of the cells."""
    order, parts = others
    ones = np.ones(len(common.new), np.int64)
    start = np.concatenate([[0], *(part.counts for part in parts), ones]).cumsum()
    found = [old.locator.cell_of_row[part.found] for part in parts]
    measures = [part.measures * _unit(old) for part in parts]
    arrays = (
        np.concatenate([*measures, new.measures[common.new]]),
        np.concatenate([*found, common.old]),
        start,
    )
    rows = np.argsort(np.concatenate([order, common.new]))
    return csr_array(arrays, shape=(new.n_cells, old.n_cells))[rows]


def _neighbours(mesh: SimplexMesh) -> IntArray:
    """Return the cell beyond each side, -1 for none or several; in the rows of the tree."""
    facets = mesh.cell_facets[mesh.locator.cell_of_row]
    rows = np.arange(mesh.n_cells)[:, None]
    sums = np.bincount(facets.ravel(), np.broadcast_to(rows, facets.shape).ravel())
    inside = mesh.facet_cell_counts[facets] == 2
    return np.where(inside, sums[facets] - rows, -1).astype(np.int32)


class _Overlaps(NamedTuple):
    """Integrals over the intersections of some new cells, in the rows of the tree."""

    counts: LongArray
    """Number of old cells that overlap each new cell."""
    found: IntArray
    measures: FloatArray
    n_nodes: LongArray
    """Number of nodes of these old cells, for each new cell."""
    nodes: IntArray
    products: FloatArray
    """Integrals over each new cell, for its corners and these nodes, float64[n, k]."""


def _overlaps_of(
    tree: Tree,
    neighbours: IntArray,
    new: tuple[FloatArray, IntArray],
    which: LongArray,
    products: bool,
) -> _Overlaps:
    """Return the integrals for some new cells."""
    cells = new[1]
    k = cells.shape[1]
    counts, n_nodes = np.zeros(len(cells), np.int64), np.zeros(len(cells), np.int64)
    room, work = tuning.ROOM[k - 1] * len(which), new_clipping()
    made: list[tuple[IntArray, FloatArray, IntArray, FloatArray]] = []
    first = 0
    while first < len(which):
        # Pages of zeros that are not touched cost nothing.
        stamps, slot = np.zeros(len(tree.cells), np.int32), np.zeros(len(tree.points), np.int32)
        found, measures = np.empty(room, np.int32), np.empty(room)
        nodes = np.empty(room if products else 0, np.int32)
        values = np.empty((len(nodes), k))
        front = Front(neighbours, stamps, np.empty(room, np.int32))
        reached, used, n_used = fill_overlaps(
            tree, front, new, which[first:], work,
            (counts, found, measures), (n_nodes, nodes, slot, values), tuple(range(k - 1)),
        )  # fmt: skip
        if reached == 0:  # a single cell has more overlaps
            room *= 2
            continue
        made.append((
            found[:used].copy(), measures[:used].copy(),
            nodes[:n_used].copy(), values[:n_used].copy(),
        ))  # fmt: skip
        first += reached
    of_cells, common, nodes, values = (np.concatenate(arrays) for arrays in zip(*made, strict=True))
    return _Overlaps(counts[which], of_cells, common, n_nodes[which], nodes, values)
