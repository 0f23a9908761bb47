"""Edges of a plane boundary between corners, found on a Cartesian grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import CartesianGrid
from adaptsize.background.merging import place_numbers
from adaptsize.typing import FloatArray

# Corner positions from different crossings are merged up to this distance, in spacings.
_SAME_CORNER = 1.5
# Smallest number of crossings that indicate a corner.
_LEAST_WITNESSES = 2
# Nodes up to this distance from the boundary, in spacings, are on it.
_ON_BOUNDARY = 1.0
# A path along nodes is longer than a straight edge by up to 8 per cent, plus its ends.
_STRAIGHT = 1.15


def corner_points(grid: CartesianGrid, witnesses: FloatArray) -> FloatArray:
    """Return corners, float64[m, dim], from the positions that crossings give, float64[n, dim]."""
    if len(witnesses) == 0:
        return witnesses
    group = place_numbers(witnesses, _SAME_CORNER * float(grid.spacing.max()))
    order = np.argsort(group, kind="stable")
    count = np.bincount(group)
    parts = np.split(witnesses[order], np.cumsum(count)[:-1])
    found = [np.median(part, axis=0) for part in parts if len(part) >= _LEAST_WITNESSES]
    return np.array(found).reshape(-1, grid.dim)


def edge_lengths(grid: CartesianGrid, phi: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the lengths of boundary edges between corners, at nodes along them.

    Parameters
    ----------
    grid : CartesianGrid
        In the plane.
    phi : float64[shape]
    corners : float64[n, 2]

    Returns
    -------
    float64[shape]
        Length of the shortest edge at a node, inf away from edges.  Of several edges between two
        corners, only the shortest is found.

    Notes
    -----
    Shortest paths along nodes close to the boundary start from all corners at once (Dijkstra).  An
    edge lies where two of them meet.
    """
    from scipy.sparse.csgraph import dijkstra

    lengths = np.full(grid.shape, np.inf)
    if len(corners) < 2:
        return lengths
    nodes, links = _boundary_graph(grid, phi)
    start = _nearest(grid, nodes, corners)
    way, before, owner = dijkstra(
        links, directed=False, indices=np.unique(start), return_predecessors=True, min_only=True
    )
    corner_of = {int(node): number for number, node in enumerate(start)}
    flat = lengths.reshape(-1)
    for a, b, along in _meetings(links, way, owner):
        first, last = corner_of[int(owner[a])], corner_of[int(owner[b])]
        straight = float(np.linalg.norm(corners[first] - corners[last]))
        is_straight = along <= _STRAIGHT * straight + 2.0 * float(grid.spacing.max())
        length = straight if is_straight else along
        for end in (a, b):
            node = end
            while node >= 0:
                flat[nodes[node]] = min(flat[nodes[node]], length)
                node = int(before[node])
    return lengths


def _boundary_graph(grid: CartesianGrid, phi: FloatArray) -> tuple[npt.NDArray[np.int64], Any]:
    """Return the nodes next to the boundary and the lengths between neighbours, diagonals too."""
    from scipy.sparse import coo_matrix

    near = np.abs(phi) <= _ON_BOUNDARY * float(grid.spacing.max())
    nodes = np.flatnonzero(near)
    number = np.full(grid.n_points, -1, np.int64)
    number[nodes] = np.arange(len(nodes))
    i, j = np.unravel_index(nodes, grid.shape)
    rows, columns, values = [], [], []
    for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        k, m = i + step[0], j + step[1]
        inside = (k < grid.shape[0]) & (m >= 0) & (m < grid.shape[1])
        other = np.full(len(nodes), -1, np.int64)
        other[inside] = number[k[inside] * grid.shape[1] + m[inside]]
        linked = np.flatnonzero(other >= 0)
        rows.append(linked)
        columns.append(other[linked])
        values.append(np.full(len(linked), float(np.hypot(*(grid.spacing * step)))))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return nodes, coo_matrix(entries, shape=(len(nodes),) * 2).tocsr()


def _nearest(
    grid: CartesianGrid, nodes: npt.NDArray[np.int64], points: FloatArray
) -> npt.NDArray[np.int64]:
    """Return which of some nodes is next to each point."""
    from scipy.spatial import cKDTree

    places = grid.origin + grid.spacing * np.stack(np.unravel_index(nodes, grid.shape), axis=-1)
    return np.asarray(cKDTree(places).query(points)[1], dtype=np.int64)


def _meetings(
    links: Any, way: FloatArray, owner: npt.NDArray[np.int32]
) -> list[tuple[int, int, float]]:
    """Return the links where paths from two corners meet, the shortest per pair, and lengths."""
    table = links.tocoo()
    a, b = table.row, table.col
    differ = (owner[a] != owner[b]) & np.isfinite(way[a]) & np.isfinite(way[b])
    a, b, gap = a[differ], b[differ], table.data[differ]
    length = way[a] + gap + way[b]
    low, high = np.minimum(owner[a], owner[b]), np.maximum(owner[a], owner[b])
    order = np.lexsort((length, high, low))
    a, b, length, low, high = (array[order] for array in (a, b, length, low, high))
    first = np.ones(len(a), np.bool_)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    return list(zip(a[first].tolist(), b[first].tolist(), length[first].tolist(), strict=True))
