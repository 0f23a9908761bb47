"""Edge flips of a triangle mesh towards a constrained Delaunay triangulation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import are_among, pairs_of_cells
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Most flips happen in the first rounds; the remaining ones matter little.
_MAX_ROUNDS = 12
#: The opposite angles must exceed 180 degrees by more than rounding (sine of the excess).
_EXCESS = 1e-9


class _Quads(NamedTuple):
    """Pairs of triangles (c, p, q) and (d, q, p), one row each."""

    corners: npt.NDArray[np.intp]
    """c, p, d, q: intp[n, 4]."""
    cells: npt.NDArray[np.intp]
    """intp[n, 2]."""
    excess: FloatArray
    """Sine of the excess of the sum of the angles at c and d over 180 degrees."""


def flip_edges(mesh: SimplexMesh, kept: IntArray) -> SimplexMesh:
    """Return triangles on the same nodes with better angles: Delaunay, except for kept edges.

    An edge pq between the triangles cpq and dqp is replaced by cd if the sum of the angles at
    c and d exceeds 180 degrees.  This removes long slivers in flat facets.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles.  Data are dropped; tags of cells and edges are kept, and so are tagged edges.
    kept : int32[n, 2], rows sorted
        Edges that must not be flipped, such as those along which a surface bends.  Edges
        of one cell, of three or more cells, or between cells of different tags or
        orientations are not flipped either.

    Returns
    -------
    SimplexMesh
        In the plane the smallest angle does not decrease.  Edges are flipped in at most 12
        rounds of independent pairs of triangles.

    Examples
    --------
    >>> kite = SimplexMesh([[0, 0], [4, 0], [2, 1], [2, -1]], [[0, 1, 2], [1, 0, 3]])
    >>> flip_edges(kite, np.empty((0, 2), np.int32)).cells.tolist()
    [[2, 0, 3], [2, 3, 1]]
    """
    if mesh.tagged_facets is not None:
        kept = np.concatenate([kept, np.sort(mesh.tagged_facets, axis=1)])
    for _ in range(_MAX_ROUNDS):
        free = (mesh.facet_cell_counts == 2) & ~are_among(mesh.edges, kept)
        quads = _independent(_flippable(mesh, free), mesh)
        if len(quads.cells) == 0:
            break
        c, p, d, q = quads.corners.T
        cells = np.array(mesh.cells)
        cells[quads.cells[:, 0]] = np.column_stack([c, p, d])
        cells[quads.cells[:, 1]] = np.column_stack([c, d, q])
        mesh = SimplexMesh(
            mesh.points,
            cells,
            cell_tags=mesh.cell_tags,
            tagged_facets=mesh.tagged_facets,
            facet_tags=mesh.facet_tags,
            tag_names=mesh.tag_names,
        )
    return mesh


def _keys(edges: IntArray, n_points: int) -> npt.NDArray[np.int64]:
    return np.asarray(edges.astype(np.int64) @ np.array([n_points, 1]))


def _flippable(mesh: SimplexMesh, free: BoolArray) -> _Quads:
    """Return the pairs of triangles across free edges that should be flipped."""
    places = pairs_of_cells(mesh, free)
    cells, turn = np.divmod(places, 3)
    around = (turn[:, :, None] + np.arange(3)) % 3
    (c, p, q), (d, r, s) = (mesh.cells[cells[:, i, None], around[:, i]].T for i in (0, 1))
    x = mesh.points
    cosine_c, sine_c = _angle(x[p] - x[c], x[q] - x[c])
    cosine_d, sine_d = _angle(x[p] - x[d], x[q] - x[d])
    excess = -(cosine_c * sine_d + sine_c * cosine_d)
    good = (r == q) & (s == p) & (c != d) & (excess > _EXCESS)
    if mesh.cell_tags is not None:
        good &= mesh.cell_tags[cells[:, 0]] == mesh.cell_tags[cells[:, 1]]
    corners = np.column_stack([c, p, d, q]).astype(np.intp)[good]
    return _Quads(corners, cells[good], excess[good])


def _angle(u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine, 0 to 180 degrees, of the angles between two rows of vectors."""
    cosine = np.einsum("ij,ij->i", u, v)
    squares = np.einsum("ij,ij->i", u, u) * np.einsum("ij,ij->i", v, v)
    scale = np.sqrt(np.maximum(squares, np.finfo(float).tiny))
    sine = np.sqrt(np.maximum(squares - cosine**2, 0.0))
    return cosine / scale, sine / scale


def _independent(quads: _Quads, mesh: SimplexMesh) -> _Quads:
    """Return pairs, the worst first, of which no two share a triangle or create the same edge."""
    rank = np.empty(len(quads.excess), np.int64)
    rank[np.argsort(-quads.excess, kind="stable")] = np.arange(len(rank))
    best = np.full(mesh.n_cells, len(rank), np.int64)
    for side in (0, 1):
        np.minimum.at(best, quads.cells[:, side], rank)
    chosen = np.flatnonzero((best[quads.cells] == rank[:, None]).all(axis=1))
    new = np.sort(quads.corners[chosen][:, [0, 2]], axis=1).astype(np.int32)
    first = np.unique(_keys(new, mesh.n_points), return_index=True)[1]
    chosen = chosen[first[~are_among(new[first], mesh.edges)]]
    return _Quads(quads.corners[chosen], quads.cells[chosen], quads.excess[chosen])
