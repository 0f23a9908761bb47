"""Edges, facets and rings of simplices, from the cell array alone."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.topology import fill_rings, group_rows, join_cells
from adaptsize.background._mesh_arrays import read_only
from adaptsize.typing import BoolArray, IndexArray, IntArray, LongArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


class CellTopology:
    """Edges, facets and rings of cells, found on first use.  Meshes with the same cells share it.

    Parameters
    ----------
    cells : int32[n_cells, k]
    n_points : int
    """

    def __init__(self, cells: IntArray, n_points: int) -> None:
        self._cells, self._n_points = cells, n_points

    @cached_property
    def edges(self) -> IntArray:
        """See `SimplexMesh.edges`."""
        if self._cells.shape[1] == 3:  # the facets of triangles
            return self.facets[0]
        return read_only(edges_of(self._cells, self._n_points))

    @cached_property
    def facets(self) -> tuple[IntArray, IntArray]:
        """See `SimplexMesh.facets` and `SimplexMesh.cell_facets`."""
        facets, cell_facets = facets_of(self._cells, self._n_points)
        return read_only(facets), read_only(cell_facets)

    @cached_property
    def facet_cell_counts(self) -> IntArray:
        """See `SimplexMesh.facet_cell_counts`."""
        facets, cell_facets = self.facets
        counts = np.bincount(cell_facets.ravel(), minlength=len(facets))
        return read_only(counts.astype(np.int32))

    @cached_property
    def rings(self) -> tuple[IntArray, IntArray]:
        """See `SimplexMesh.rings`."""
        ring_ptr, ring = rings(self._cells, self._n_points)
        return read_only(ring_ptr), read_only(ring)


def rings(cells: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Return the cells around each point as compressed rows ``(ring_ptr, ring)``.

    Parameters
    ----------
    cells : int32[n_cells, k]
    n_points : int

    Returns
    -------
    ring_ptr : int32[n_points + 1]
    ring : int32[n_cells * k]
        ``ring[ring_ptr[i]:ring_ptr[i + 1]]`` are the cells that contain point i, ascending.
    """
    ring_ptr = np.empty(n_points + 1, np.int32)
    ring = np.empty(cells.size, np.int32)
    fill_rings(read_only(cells), n_points, ring_ptr, ring)
    return ring_ptr, ring


def unique_rows(rows: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Return the unique sorted rows in lexicographic order, and the number of each row.

    Parameters
    ----------
    rows : int32[m, k]
        Point indices in any order within a row.
    n_points : int

    Returns
    -------
    unique : int32[u, k]
    number : int32[m]
        ``unique[number]`` are the rows, each sorted.

    Raises
    ------
    IndexError
        If an index is out of range: the kernel would write beyond its arrays.
    """
    rows = ascending(rows)
    width = rows.shape[1]
    if len(rows) and (rows[:, 0].min() < 0 or rows[:, -1].max() >= n_points):
        raise IndexError(
            f"rows must hold indices from 0 to {n_points - 1}, got {rows[:, 0].min()} to "
            f"{rows[:, -1].max()}"
        )
    # Fewer rows are sorted by numpy: the kernel takes longer to compile.
    if len(rows) < 10_000 and n_points**width < 2**63:
        key = rows.astype(np.int64) @ (n_points ** np.arange(width)[::-1])
        at, group = np.unique(key, return_index=True, return_inverse=True)[1:]
        return rows[at], group.ravel().astype(np.int32)
    first = np.empty(len(rows), np.int32)
    number = np.empty(len(rows), np.int32)
    start, free = np.zeros((2, n_points + 1), np.int64)
    order = np.empty(len(rows), np.int32)
    count = group_rows(rows, (start, free, order), first, number)
    return rows[first[:count]], number


def ascending(rows: IntArray) -> IntArray:
    """Return rows of indices, each sorted, int32[m, k].

    Pairs and triples are compared column by column, in a tenth and a third of the time of
    ``numpy.sort``.
    """
    if rows.shape[1] not in (2, 3):
        return np.ascontiguousarray(np.sort(rows, axis=1), dtype=np.int32)
    ordered = np.empty(rows.shape, np.int32)
    a, b, c = rows[:, 0], rows[:, 1], rows[:, -1]
    low, high = np.minimum(a, b), np.maximum(a, b)
    if rows.shape[1] == 2:
        ordered[:, 0], ordered[:, 1] = low, high
        return ordered
    middle = np.minimum(high, c)
    np.minimum(low, c, out=ordered[:, 0], casting="same_kind")
    np.maximum(low, middle, out=ordered[:, 1], casting="same_kind")
    np.maximum(high, c, out=ordered[:, 2], casting="same_kind")
    return ordered


def compacted(cells: npt.NDArray[Any]) -> tuple[IntArray, IntArray]:
    """Return the nodes of cells, ascending, and the cells with their places among these."""
    nodes, places = np.unique(cells, return_inverse=True)
    return nodes.astype(np.int32), places.reshape(cells.shape).astype(np.int32)


def have_different_nodes(cells: npt.NDArray[np.integer]) -> BoolArray:
    """Return which cells have no node twice."""
    ordered = np.sort(cells, axis=1)
    return np.asarray((ordered[:, 1:] != ordered[:, :-1]).all(axis=1))


def marked(index: npt.NDArray[np.integer], n: int) -> BoolArray:
    """Return bool[n], true at the given indices."""
    found = np.zeros(n, np.bool_)
    found[index] = True
    return found


def any_of(flags: BoolArray, rows: npt.NDArray[np.integer]) -> BoolArray:
    """Return for which rows of indices any flag is true, bool[m].

    Column by column, in a third of the time of ``flags[rows].any(axis=1)``.
    """
    found = flags[rows[:, 0]]
    for column in rows.T[1:]:
        found |= flags[column]
    return np.asarray(found)


def places_among(nodes: npt.NDArray[Any], n_points: int) -> IntArray:
    """Return the place of each point among some nodes, -1 if it is none of them."""
    places = np.full(n_points, -1, np.int32)
    places[nodes] = np.arange(len(nodes))
    return places


def edges_of(cells: IntArray, n_points: int) -> IntArray:
    """Return the unique edges of simplices, int32[n_edges, 2], ``i < j``, lexicographic."""
    pairs = [cells[:, pair] for pair in combinations(range(cells.shape[1]), 2)]
    return unique_rows(np.concatenate(pairs), n_points)[0]


def facets_of(cells: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Return the unique facets of simplices and the facets of each cell.

    Returns
    -------
    facets : int32[n_facets, k - 1]
        Sorted indices, lexicographic.
    cell_facets : int32[n_cells, k]
        ``cell_facets[c, v]`` is the facet of cell c opposite to its vertex v.
    """
    n_cells, k = cells.shape
    opposite = [np.delete(cells, v, axis=1) for v in range(k)]
    facets, number = unique_rows(np.concatenate(opposite), n_points)
    return facets, np.ascontiguousarray(number.reshape(k, n_cells).T)


def oriented_facets(
    cells: IntArray, opposite: npt.NDArray[Any], inverted: BoolArray | None
) -> IntArray:
    """Return the facets opposite to the given vertices, normals out of their cells.

    Parameters
    ----------
    cells : int32[n, k + 1]
    opposite : int[n]
        A vertex of each cell, 0 to k.
    inverted : bool[n] or None
        Cells of negative measure; None for cells that are not of full dimension.
    """
    k = cells.shape[1] - 1
    around = np.array([[v for v in range(k + 1) if v != out] for out in range(k + 1)])
    facets = np.take_along_axis(cells, around[opposite], axis=1)
    flip = opposite % 2 == 1
    if inverted is not None:
        flip = flip ^ inverted
    facets[flip, :2] = facets[flip, 1::-1]
    return facets


def tags_of_facets(facets: IntArray, tagged: IntArray, tags: IntArray, n_points: int) -> IntArray:
    """Return one tag per facet, 0 where none was given.

    Parameters
    ----------
    facets : int32[n_facets, k]
    tagged : int32[n_tagged, k]
        Facets that carry a tag.
    tags : int32[n_tagged]
    n_points : int
    """
    number = unique_rows(np.concatenate([facets, tagged]), n_points)[1]
    tag_of_row = np.zeros(int(number.max()) + 1, np.int32)
    tag_of_row[number[len(facets) :]] = tags
    return tag_of_row[number[: len(facets)]]


def regions_beside(
    cell_facets: IntArray, regions: IntArray, n_facets: int
) -> tuple[LongArray, LongArray]:
    """Return the lowest and the highest region of the cells at each facet, int64[n_facets]."""
    if len(regions) and regions.min() == regions.max():  # each facet is that of a cell
        same = np.full(n_facets, regions[0], np.int64)
        return same, same.copy()
    order = np.argsort(regions, kind="stable")
    highest, lowest = (np.empty(n_facets, np.int64) for _ in range(2))
    # The last value that is assigned stays.
    for extreme, rows in ((highest, order), (lowest, order[::-1])):
        extreme[cell_facets[rows]] = regions[rows, None]
    return lowest, highest


def components_of(links: npt.NDArray[Any], n: int) -> IndexArray:
    """Return the connected component of each of n objects, numbered in the order of the first ones.

    Parameters
    ----------
    links : int[m, 2]
        Pairs of objects that are connected.
    n : int
    """
    root = roots_of(links, n)
    is_first = root == np.arange(n)
    return np.asarray((np.cumsum(is_first) - 1)[root], np.intp)


def roots_of(links: npt.NDArray[Any], n: int) -> IntArray:
    """Return the first object of the connected component of each of n objects, int32[n].

    Parameters
    ----------
    links : int[m, k]
        Rows of objects that are connected, such as cells.
    n : int
    """
    root = np.arange(n, dtype=np.int32)
    # The kernel is compiled for read-only arrays, as cells are.
    join_cells(read_only(np.ascontiguousarray(links, np.int32)), root)
    return root


def pairs_of_cells(mesh: SimplexMesh, facets: BoolArray) -> IndexArray:
    """Return the corners opposite to chosen facets, each between two cells, intp[n, 2].

    Corners are positions in ``mesh.cells.ravel()``.
    """
    order = np.argsort(mesh.cell_facets, axis=None, kind="stable")
    start = np.cumsum(mesh.facet_cell_counts) - mesh.facet_cell_counts
    chosen = start[facets]
    return np.column_stack([order[chosen], order[chosen + 1]])


def rows_among(edges: IntArray, others: IntArray) -> IndexArray:
    """Return for each edge its row in ``others``, int32[m, 2], -1 if it is none of them."""
    width = 1 + int(max(edges.max(initial=0), others.max(initial=0)))
    keys, known = (np.int64(width) * rows[:, 0] + rows[:, 1] for rows in (edges, others))
    if len(known) == 0:
        return np.full(len(keys), -1)
    if (known[1:] >= known[:-1]).all():  # as the edges of meshes
        row = np.searchsorted(known, keys).clip(max=len(known) - 1)
    else:
        order = np.argsort(known)  # np.isin hashes, which takes several times as long
        row = order[np.searchsorted(known[order], keys).clip(max=len(known) - 1)]
    return np.where(known[row] == keys, row, -1)


def are_among(edges: IntArray, others: IntArray) -> BoolArray:
    """Return which edges are also rows of ``others``, bool[n]."""
    return np.asarray(rows_among(edges, others) >= 0)


def is_tagged(mesh: SimplexMesh) -> BoolArray:
    """Return which facets carry a tag other than 0, bool[n_facets]."""
    if mesh.tagged_facets is None or mesh.facet_tags is None:
        return np.zeros(len(mesh.facets), np.bool_)
    tags = tags_of_facets(mesh.facets, mesh.tagged_facets, mesh.facet_tags, mesh.n_points)
    return np.asarray(tags != 0)


def renumbered_edges(edges: IntArray, new_node: IntArray) -> IntArray:
    """Return the edges with other numbers of nodes, without those that have vanished."""
    ends = np.sort(new_node[edges], axis=1)
    return np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).astype(np.int32)
