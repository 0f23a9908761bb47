"""New cells in a patch of a plane mesh, around those that miss their sizes; the others stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from adaptsize._pickling import once
from adaptsize.adaptation import tuning
from adaptsize.adaptation.need import Requested, pieces_of
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import merge_equal_points
from adaptsize.background.migration import Piece, joined_pieces
from adaptsize.background.partitioning import cut_part
from adaptsize.background.topology import any_of, marked, rows_among
from adaptsize.metrics import Metric
from adaptsize.quality.elements import minimum_angles
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

#: Remeshes cells, between which and others the given facets stay.
Remesh = Callable[[SimplexMesh, IntArray], SimplexMesh]


def remade_alone(mesh: SimplexMesh, requested: Requested) -> BoolArray | None:
    """Return the cells of `cells_to_remake`; None if there are none, or too many."""
    gone = cells_to_remake(mesh, requested)
    return gone if 0 < np.count_nonzero(gone) <= tuning.MOST_REMADE * mesh.n_cells else None


def cells_to_remake(mesh: SimplexMesh, requested: Requested) -> BoolArray:
    """Return the triangles of a plane mesh that miss their sizes, and those around, bool[n_cells].

    Generators leave single edges that are too long or too short, so those around a node count.  One
    that has to keep edges next to cells that miss their sizes makes poor cells there.
    """
    pieces = pieces_of(mesh.points, mesh.facets, requested)
    low, high = tuning.KEPT_EDGES
    found = any_of((pieces < low) | (pieces > high), mesh.cell_facets)
    low, high = np.log(tuning.KEPT_ON_AVERAGE)
    mean = _smoothed(mesh, np.log(np.maximum(pieces, 1e-300)))
    found |= any_of((mean < low) | (mean > high), mesh.cells)
    if not isinstance(requested, Metric):
        # The cells to be kept are determined for the number of elements, and for the mesh.
        found |= once(mesh, "_minimum_angles", lambda: minimum_angles(mesh)) < tuning.KEPT_ANGLE
    for _ in range(tuning.RINGS_AROUND):
        found = any_of(marked(mesh.cells[found].ravel(), mesh.n_points), mesh.cells)
    return np.asarray(found)


def _smoothed(mesh: SimplexMesh, at_edges: FloatArray) -> FloatArray:
    """Return means at nodes over edges, twice, float64[n_points]."""
    (i, j), n = mesh.facets.T, mesh.n_points

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(i, values, n) + np.bincount(j, values, n))

    count = np.maximum(np.bincount(i, minlength=n) + np.bincount(j, minlength=n), 1)
    at_nodes = summed(at_edges) / count
    return np.asarray(summed(0.5 * (at_nodes[i] + at_nodes[j])) / count)


def patched(mesh: SimplexMesh, is_gone: BoolArray, remesh: Remesh) -> SimplexMesh | None:
    """Return a mesh with new cells in place of some; None if these do not fit the others.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane, without data.
    is_gone : bool[n_cells]
        The cells to be replaced, neither none nor all.
    remesh : callable
        Gets these cells as a mesh, and its facets to be kept: those between them and the others.
    """
    rest, before = (
        cut_part(mesh, is_gone.astype(np.int32), np.full(mesh.n_points, -1, np.int32), k)
        for k in (0, 1)
    )
    assert rest.mesh is not None
    assert before.mesh is not None
    n_gone = np.bincount(mesh.cell_facets[is_gone].ravel(), minlength=len(mesh.facets))
    cut = mesh.facets[(n_gone > 0) & (n_gone < mesh.facet_cell_counts)]
    # Where two parts of the domain touch at a node only, it would be lost which nodes are one.
    if not np.array_equal(np.unique(cut), np.intersect1d(rest.global_ids, before.global_ids)):
        return None
    after = remesh(before.mesh, np.searchsorted(before.global_ids, cut).astype(np.int32))
    nodes = _old_nodes(after, mesh, cut)
    if nodes is None:
        return None
    is_new = nodes < 0
    nodes[is_new] = mesh.n_points + np.arange(is_new.sum())
    pieces = [Piece(_turned(rest.mesh), rest.global_ids), Piece(after, nodes)]
    return joined_pieces(pieces)[0]


def _turned(mesh: SimplexMesh) -> SimplexMesh:
    """Return the mesh with triangles of positive orientation."""
    cells = mesh.cells.copy()
    inverted = mesh.signed_measures < 0.0
    cells[inverted] = cells[inverted][:, [0, 2, 1]]
    return replace(mesh, cells=cells) if inverted.any() else mesh


def _old_nodes(new: SimplexMesh, old: SimplexMesh, cut: IntArray) -> LongArray | None:
    """Return the node of a cut in an old mesh that each node of a new one is, -1 for others.

    None if the new mesh has not all edges of the cut on its boundary.  Edges are compared rather
    than nodes, since nodes on both sides of a slit are in one place.
    """
    found = np.full(new.n_points, -1)
    border = new.facets[new.facet_cell_counts == 1]
    place = merge_equal_points(np.concatenate([old.points[cut.ravel()], new.points]))[1]
    places = place[: cut.size].reshape(cut.shape), place[cut.size :][border]
    orders = [np.argsort(at, axis=1) for at in places]
    sides = [np.take_along_axis(at, order, 1) for at, order in zip(places, orders, strict=True)]
    row = rows_among(sides[0], sides[1])
    if (row < 0).any():
        return None
    nodes = np.take_along_axis(border, orders[1], 1)[row]
    of_cut = np.take_along_axis(cut, orders[0], 1)
    found[nodes] = of_cut
    return found if np.array_equal(found[nodes], of_cut) else None
