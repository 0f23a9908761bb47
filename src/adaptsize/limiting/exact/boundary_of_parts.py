"""The boundary of a component of a mesh in parts, the same on every rank."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import compacted, marked, unique_rows
from adaptsize.geometry.boundary import FlatBoundary, OtherParts, flat_boundary
from adaptsize.geometry.convexity import (
    MOST_INWARD,
    angles_between,
    inward_turns,
    is_convex,
    paired,
    ridges_of,
    solid_angle,
    surrounds_once,
    turns_of,
    units_of,
)
from adaptsize.limiting.exact.components import ComponentPiece
from adaptsize.ranks import Ids, rows_among, split_rows
from adaptsize.typing import BoolArray, FloatArray, IntArray

# A facet between two parts, on the boundary, or neither: a fold, or cells that coincide.
_INNER, _WALL, _ODD = 0, 1, 2


class Skeleton(NamedTuple):
    """The boundary of the whole domain, the same on all ranks; empty if it is a convex solid."""

    ids: Ids
    """int64[b]: global numbers of the nodes, ascending."""
    points: FloatArray
    """float64[b, dim]"""
    boundary: FlatBoundary
    """Facets, in the order of the whole mesh."""
    convex: bool
    diagonal: float
    """Diagonal of the box around the boundary."""

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
        boundary = self.boundary._replace(facets=facets)
        return self._replace(ids=ids, points=points, boundary=boundary), SimplexMesh(points, cells)


class _Share(NamedTuple):
    """What one rank knows of the boundary."""

    odd: bool
    """Whether any cell has no measure, or cells overlap at a facet."""
    facets: IntArray
    """int32[f, dim]: local nodes."""
    nodes: IntArray
    """int32[b]: the nodes of the facets, ascending."""


def find_skeleton(piece: ComponentPiece, threads: int) -> Skeleton | None:
    """Return the boundary of a component; collective.

    Whether a solid is convex follows from angles that each rank finds at its own facets, and from
    those between facets of two ranks.  Only in other domains do all ranks get the boundary.

    Returns None if any cell has no measure, or if cells overlap at a facet.
    """
    comm, dim, points = piece.ranks, piece.mesh.dim, piece.mesh.points
    share = _find_share(piece, threads)
    own = points[share.nodes]
    box = np.concatenate([own.min(axis=0, initial=np.inf), -own.max(axis=0, initial=-np.inf)])
    sum_of_corners = points[share.facets].sum(axis=(0, 1))
    every = comm.allgather((share.odd, len(share.facets), box, sum_of_corners))
    n_facets = sum(one[1] for one in every)
    if any(one[0] for one in every) or n_facets == 0:
        return None
    ends = np.min([one[2] for one in every], axis=0)
    diagonal = float(np.linalg.norm(ends[dim:] + ends[:dim]))
    if dim == 3:
        middle = np.sum([one[3] for one in every], axis=0) / (3 * n_facets)
        if _is_convex_solid(piece, share.facets, middle):
            none = np.empty((0, 3), np.int32)
            boundary = FlatBoundary(none, none[:, 0], True)
            return Skeleton(piece.ids[:0], points[:0], boundary, True, diagonal)
    return _gathered(piece, share, diagonal)


def _find_share(piece: ComponentPiece, threads: int) -> _Share:
    """Return the facets of the boundary of the whole on this rank; three exchanges."""
    dim, n = piece.mesh.dim, piece.mesh.n_points
    walls, odd = np.empty((0, dim), np.int32), False
    if piece.is_empty:
        _total(piece, np.zeros(n, np.uint64))
    else:
        own = flat_boundary(piece.mesh, threads, OtherParts(piece.ids, partial(_total, piece)))
        walls = own.facets
        odd = own.has_flat or (len(walls) > 0 and not own.is_simple)
    between = piece.is_shared[walls].all(axis=1)
    status = np.full(len(walls), _WALL, np.int8)
    status[between] = _statuses(piece, piece.ids[walls[between]])
    facets = walls[status == _WALL]
    nodes = np.flatnonzero(marked(facets, n)).astype(np.int32)
    return _Share(odd or bool((status == _ODD).any()), facets, nodes)


def _total(piece: ComponentPiece, sums: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Add to nodal numbers those of other ranks (In/Out: sums); one exchange."""
    received = piece.ranks.alltoallv([sums[nodes] for nodes in piece.shared])
    for nodes, found in zip(piece.shared, received, strict=True):
        if len(found) == len(nodes):  # a rank without cells of the component sends none
            sums[nodes] += found
    return sums


def _gathered(piece: ComponentPiece, share: _Share, diagonal: float) -> Skeleton:
    """Return the boundary in one piece; one gather."""
    facets, nodes = piece.ids[share.facets], share.nodes
    every = piece.ranks.allgather((facets, piece.ids[nodes], piece.mesh.points[nodes]))
    ids, at = np.unique(np.concatenate([own[1] for own in every]), return_index=True)
    points = np.concatenate([own[2] for own in every])[at]
    facets = np.searchsorted(ids, np.concatenate([own[0] for own in every]))
    rows: IntArray = facets[np.lexsort(np.sort(facets, axis=1).T[::-1])].astype(np.int32)
    boundary = FlatBoundary(rows, np.zeros(len(rows), np.int32), True)
    convex = points.shape[1] == 2 and is_convex(points, boundary)
    return Skeleton(ids, points, boundary, convex, diagonal)


def _is_convex_solid(piece: ComponentPiece, facets: IntArray, middle: FloatArray) -> bool:
    """Return whether a solid is convex, like `is_convex`, given the own facets; one exchange."""
    comm, points = piece.ranks, piece.mesh.points
    ridges = ridges_of(facets, len(points))
    alone = np.asarray(~piece.is_shared[ridges.ends].all(axis=1))
    inward = inward_turns(turns_of(points, facets, ridges.only(alone)))
    inward += inward_turns(_turns_between_ranks(piece, facets))
    around = solid_angle(points[facets], middle)
    inward, around = comm.allreduce(np.array([float(inward), around]), "sum").tolist()
    return inward <= MOST_INWARD and surrounds_once(around)


def _turns_between_ranks(piece: ComponentPiece, facets: IntArray) -> FloatArray:
    """Return the angles at a share of the edges whose nodes are on several ranks; one exchange.

    The facets at such an edge may be on different ranks.  They are compared on one of these.
    """
    comm, points, ids = piece.ranks, piece.mesh.points, piece.ids
    units = units_of(points[facets])
    rows = []
    for v in range(3):
        ends, apex = facets[:, [v, (v + 1) % 3]], facets[:, (v + 2) % 3]
        at = np.flatnonzero(piece.is_shared[ends].all(axis=1))
        start = points[ends[at].min(axis=1)]
        rows.append(np.hstack([ids[ends[at]], units[at], points[apex[at]] - start]))
    sent = np.concatenate(rows)
    judge = sent[:, :2].min(axis=1).astype(np.int64) % comm.size
    found = np.concatenate(comm.alltoallv(split_rows(sent, judge, comm.size)))
    nodes, ends = compacted(found[:, :2].astype(np.int64))
    _, sides, regular = paired(ends, len(nodes))
    return angles_between(found[sides, 2:5], found[sides[:, 1], 5:], regular)


def _statuses(piece: ComponentPiece, facets: Ids) -> npt.NDArray[np.int8]:
    """Return whether facets all of whose nodes are shared are walls of the whole; two exchanges.

    Each facet is compared on one rank with the same facet of other ranks.
    """

    def judge(found: Ids, _: Ids) -> npt.NDArray[np.int8]:
        if len(found) == 0:
            return np.zeros(0, np.int8)
        nodes, rows = compacted(found)
        group = unique_rows(rows, len(nodes))[1]
        even = np.bincount(group, weights=_is_even(found))[group]
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
