"""Cells side by side that are not connected: nodes at one place, hanging nodes, cells twice.

Programs for discontinuous fields, local refinement and runs in parts write such meshes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import place_text
from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import place_numbers
from adaptsize.background.simplex import Boundary
from adaptsize.background.topology import (
    components_of,
    have_different_nodes,
    pairs_of_cells,
    unique_rows,
)
from adaptsize.typing import BoolArray, FloatArray, IndexArray

#: Distance of a hanging node from the middle of an edge, over the length of the edge.
_NEAR = 1e-6
#: Distance of nodes at one place, over the diagonal: coordinates that differ by rounding.
_ROUNDING = 1e-13

_TEXTS = {
    "slits": "{n} facet(s) on another, the first at {place}: slits",
    "parts": "{n} facet(s) on one of another part, the first at {place}: the cells there are not "
    "connected, because nodes at one place are not joined",
    "hanging": "{n} node(s) in the middle of an edge of another cell, the first at {place}: the "
    "cells there are not connected",
}


class Unconnected(NamedTuple):
    """Places where cells lie side by side without a common facet."""

    kind: Literal["slits", "parts", "hanging"]
    """Of slits, both sides are connected around the end.  They are often intended."""
    number: int
    place: FloatArray
    """float64[dim], of the first."""

    def __str__(self) -> str:
        """Return the message."""
        return _TEXTS[self.kind].format(n=self.number, place=place_text(self.place))


def unconnected(mesh: SimplexMesh) -> list[Unconnected]:
    """Return where cells of a plane or solid mesh lie side by side without a common facet.

    Surfaces and lines in space have none: bodies may touch.  The result is kept with the mesh.

    Examples
    --------
    Two triangles with nodes of their own:

    >>> points = [[0, 0], [1, 0], [0, 1], [1, 0], [1, 1], [0, 1]]
    >>> for found in unconnected(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]])):
    ...     found.kind, found.number, found.place.tolist()
    ('parts', 1, [0.5, 0.5])
    """
    return list(once(mesh, "_unconnected", lambda: tuple(_unconnected(mesh))))


def _unconnected(mesh: SimplexMesh) -> list[Unconnected]:
    if mesh.cell_dim < mesh.dim or mesh.dim == 1 or not (mesh.facet_cell_counts == 1).any():
        return []
    boundary = mesh.boundary()
    points = boundary.mesh.points
    number = place_numbers(points, _ROUNDING * mesh.diagonal)
    rows = np.sort(number[boundary.mesh.cells], axis=1)
    _, same, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    same = same.reshape(-1)
    double = (count[same] > 1) & have_different_nodes(rows)
    found = []
    if double.any():
        apart = double & _are_apart(mesh, boundary, number, same)
        middles = points[boundary.mesh.cells].mean(axis=1)
        for kind, chosen in (("parts", apart), ("slits", double & ~apart)):
            if chosen.any():
                n, place = len(np.unique(same[chosen])), middles[np.argmax(chosen)]
                found.append(Unconnected(kind, n, place))  # type: ignore[arg-type]
    hanging = _hanging(boundary.mesh)
    if len(hanging):
        found.append(Unconnected("hanging", len(hanging), points[hanging[0]]))
    return found


def are_doubtful(found: list[Unconnected]) -> Iterator[Unconnected]:
    """Yield those that are hardly intended: all but slits."""
    return (one for one in found if one.kind != "slits")


def _are_apart(
    mesh: SimplexMesh, boundary: Boundary, number: IndexArray, same: IndexArray
) -> BoolArray:
    """Return for each double facet whether it is no slit.

    The cells on its sides are in different parts, or each cell at one of its nodes has a node of
    its own there.  Facets with a tag on one side are intended.
    """
    inner = np.asarray(mesh.facet_cell_counts == 2)
    pairs = pairs_of_cells(mesh, inner) // mesh.cells.shape[1]
    part = components_of(pairs, mesh.n_cells)[boundary.cells]
    low, high = (np.full(int(same.max()) + 1, start) for start in (mesh.n_cells, -1))
    np.minimum.at(low, same, part)
    np.maximum.at(high, same, part)
    place = np.full(mesh.n_points, -1)
    place[boundary.nodes] = number
    at_corners = place[mesh.cells].ravel()
    n_cells = np.bincount(at_corners[at_corners >= 0], minlength=int(number.max()) + 1)
    n_nodes = np.bincount(number)
    is_split = (n_nodes > 2) & (n_nodes == n_cells)
    apart = (low != high)[same] | is_split[number[boundary.mesh.cells]].any(axis=1)
    if boundary.mesh.cell_tags is not None:
        apart &= np.bincount(same, boundary.mesh.cell_tags != 0)[same] == 0
    return np.asarray(apart)


def _hanging(boundary: SimplexMesh) -> npt.NDArray[np.intp]:
    """Return the nodes in the middle of an edge whose ends they are connected with."""
    from scipy.spatial import cKDTree

    edges = boundary.cells if boundary.cell_dim == 1 else boundary.edges
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    ends = boundary.points[edges]
    middles, length = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    distance, nearest = cKDTree(boundary.points).query(middles)
    close = np.flatnonzero(distance <= _NEAR * length)
    node, ends_of = nearest[close], edges[close]
    known = {tuple(edge) for edge in edges[np.isin(edges, node).any(axis=1)].tolist()}
    joined = [
        all((min(k, end), max(k, end)) in known for end in pair)
        for k, pair in zip(node.tolist(), ends_of.tolist(), strict=True)
    ]
    return np.unique(node[np.array(joined, bool)])


def repeated_cells(mesh: SimplexMesh) -> npt.NDArray[Any]:
    """Return the cells that have the same nodes as another, and that one, intp[n, 2].

    The result is kept with the mesh.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2], [2, 0, 1]])
    >>> repeated_cells(mesh).tolist()
    [[1, 0]]
    """
    return once(mesh, "_repeated_cells", lambda: _repeated_cells(mesh))


def _repeated_cells(mesh: SimplexMesh) -> npt.NDArray[Any]:
    if _have_other_neighbours(mesh):
        return np.empty((0, 2), np.intp)
    rows = np.sort(mesh.cells, axis=1)
    number = unique_rows(rows, mesh.n_points)[1]
    first = np.unique(number, return_index=True)[1][number]
    again = np.flatnonzero(first != np.arange(mesh.n_cells))
    return np.column_stack([again, first[again]])


def _have_other_neighbours(mesh: SimplexMesh) -> bool:
    """Return whether each cell has two neighbours or a facet on the boundary, of a manifold.

    Two cells with the same nodes are each other's only neighbours.
    """
    counts, facets = mesh.facet_cell_counts, mesh.cell_facets
    if facets.shape[1] < 3 or counts.max() > 2:
        return False
    # Without the own number, the sum of the cells at a facet is the neighbour.
    sums = np.bincount(facets.ravel(), np.repeat(np.arange(mesh.n_cells), facets.shape[1]))
    first, second = sums[facets[:, 0]], sums[facets[:, 1]]
    alone = (counts[facets] == 2).all(axis=1) & (first == second)
    return not alone.any()


def refuse_repeated_cells(mesh: SimplexMesh) -> None:
    """Raise a ValueError if cells have the same nodes as another."""
    found = repeated_cells(mesh)
    if len(found):
        cell, other = found[0]
        place = place_text(mesh.points[mesh.cells[cell]].mean(axis=0))
        raise ValueError(
            f"mesh must have each cell once, got {len(found)} with the nodes of another: "
            f"cells[{cell}] is cells[{other}] again, at {place}"
        )
