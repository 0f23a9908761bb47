"""The boundary of a component of a mesh in parts, the same on every rank."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.geometry.boundary import FlatBoundary, flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.limiting.exact.components import ComponentPiece
from adaptsize.ranks import Ids, rows_among
from adaptsize.typing import BoolArray, FloatArray, IntArray

# A facet between two parts, on the boundary, or neither: a fold, or cells that coincide.
_INNER, _WALL, _ODD = 0, 1, 2


class Skeleton(NamedTuple):
    """The boundary of the whole domain, and the same nodes and facets on all ranks."""

    ids: Ids
    """int64[b]: global numbers of the nodes, ascending."""
    points: FloatArray
    """float64[b, dim]"""
    boundary: FlatBoundary
    """Facets, in the order of the whole mesh."""
    convex: bool

    def with_cells(self, piece: ComponentPiece, marked: IntArray) -> tuple[Skeleton, SimplexMesh]:
        """Return the skeleton with all cells at marked nodes, and these as a mesh; collective."""
        mesh = piece.mesh
        cells = np.empty((0, mesh.dim + 1), np.int64)
        if not piece.is_empty:
            is_marked = np.zeros(len(self.ids) + 1, np.bool_)
            is_marked[marked] = True
            around = is_marked[rows_among(piece.ids, self.ids)][mesh.cells].any(axis=1)
            cells = mesh.cells[around].astype(np.int64)
        nodes = np.unique(cells)
        every = piece.ranks.allgather((piece.ids[cells], piece.ids[nodes], mesh.points[nodes]))
        ids, at = np.unique(
            np.concatenate([self.ids, *[own[1] for own in every]]), return_index=True
        )
        points = np.concatenate([self.points, *[own[2] for own in every]])[at]
        facets = np.searchsorted(ids, self.ids)[self.boundary.facets].astype(np.int32)
        cells = np.searchsorted(ids, np.concatenate([own[0] for own in every]))
        if len(cells) == 0:  # a mesh needs one
            cells = np.arange(mesh.dim + 1)[None]
        wider = Skeleton(ids, points, self.boundary._replace(facets=facets), self.convex)
        return wider, SimplexMesh(points, cells)


def find_skeleton(piece: ComponentPiece, threads: int) -> Skeleton | None:
    """Return the boundary of a component; two exchanges.

    Returns None if any cell has no measure, or if cells overlap at a facet.
    """
    comm, dim = piece.ranks, piece.mesh.dim
    walls, odd = np.empty((0, dim), np.int32), False
    if not piece.is_empty:
        own = flat_boundary(piece.mesh, threads)
        walls, odd = own.facets, own.has_flat or not own.is_simple
    between = np.isin(walls, np.concatenate(piece.shared)).all(axis=1)
    ids = piece.ids[walls].reshape(-1, dim)
    status = np.full(len(walls), _WALL, np.int8)
    status[between] = _statuses(piece, ids[between])
    nodes = np.unique(walls[status == _WALL])
    odd = odd or bool((status == _ODD).any())
    every = comm.allgather((odd, ids[status == _WALL], piece.ids[nodes], piece.mesh.points[nodes]))
    if any(own[0] for own in every) or not any(len(own[1]) for own in every):
        return None
    numbers, at = np.unique(np.concatenate([own[2] for own in every]), return_index=True)
    points = np.concatenate([own[3] for own in every])[at]
    facets = np.searchsorted(numbers, np.concatenate([own[1] for own in every]))
    rows: IntArray = facets[np.lexsort(np.sort(facets, axis=1).T[::-1])].astype(np.int32)
    boundary = FlatBoundary(rows, np.zeros(len(rows), np.int32), True)
    return Skeleton(numbers, points, boundary, is_convex(points, boundary))


def _statuses(piece: ComponentPiece, facets: Ids) -> npt.NDArray[np.int8]:
    """Return whether facets all of whose nodes are shared are walls of the whole; two exchanges.

    Each facet is compared on one rank with the same facet of other ranks.
    """

    def judge(found: Ids, _: Ids) -> npt.NDArray[np.int8]:
        if len(found) == 0:
            return np.zeros(0, np.int8)
        number, group = np.unique(np.sort(found, axis=1), axis=0, return_inverse=True)
        group = group.ravel()
        even = np.bincount(group, weights=_is_even(found), minlength=len(number))[group]
        count = np.bincount(group)[group]
        answer = np.where(count == 1, _WALL, np.where((count == 2) & (even == 1), _INNER, _ODD))
        return answer.astype(np.int8)

    return piece.ranks.ask(facets, facets.min(axis=1) % piece.ranks.size, judge)


def _is_even(rows: Ids) -> BoolArray:
    """Return whether the order of the numbers in each row is an even permutation."""
    odd = np.zeros(len(rows), np.bool_)
    for a in range(rows.shape[1]):
        for b in range(a):
            odd ^= rows[:, b] > rows[:, a]
    return ~odd
