"""Connected components of a mesh in parts, and the boundary of the whole domain on every rank."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.topology import join_cells
from adaptsize.background import SimplexMesh, topology
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.geometry.boundary import FlatBoundary, flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.ranks import Communicator, Ids, rows_among
from adaptsize.typing import BoolArray, FloatArray, IntArray


class Piece(NamedTuple):
    """The part of one component on this rank, nodes in the order of the whole mesh.

    Methods then see nodes, edges and facets in the same order as in the whole mesh, and round
    alike.
    """

    ranks: Communicator
    mesh: SimplexMesh
    """On a rank without cells of the component, some simplex."""
    ids: Ids
    """int64[n]: global numbers, ascending; empty on a rank without cells of the component."""
    nodes: IntArray
    """int32[n]: the nodes in the part of the rank."""
    shared: list[IntArray]
    """For each rank, the nodes that it holds too, ascending."""

    @property
    def is_empty(self) -> bool:
        """Whether this rank has no cells of the component."""
        return len(self.ids) == 0


class Components(NamedTuple):
    """The components of the whole mesh."""

    number: IntArray
    """int32[n_local]: component of each local node, -1 for nodes in no cell."""
    total: int
    """Number of components."""

    def bounded(self, comm: Communicator, h0: FloatArray) -> list[int]:
        """Return the components in which a node has a bound; collective."""
        found = np.zeros(self.total + 1, np.int8)
        found[self.number[np.isfinite(h0)]] = 1
        found[-1] = 0
        everywhere = comm.allreduce(found, "max")
        return [int(k) for k in np.flatnonzero(everywhere)]


def components_of(part: PartitionedMesh) -> Components:
    """Return the components; collective on first use."""
    return part.once("_components", lambda: _find_components(part))


def _find_components(part: PartitionedMesh) -> Components:
    root = np.arange(part.n_points, dtype=np.int32)
    join_cells(part.cells, root)
    label = part.global_ids[root]
    used = np.zeros(part.n_points, np.bool_)
    used[part.cells] = True
    label[~used] = -1
    received = part.ranks.alltoallv([label[nodes] for nodes in part.shared.nodes])
    links = [np.column_stack([np.unique(label[used])] * 2)]
    for nodes, theirs in zip(part.shared.nodes, received, strict=True):
        both = np.column_stack([label[nodes], theirs])
        links.append(np.unique(both[(both >= 0).all(axis=1)], axis=0))
    every = np.concatenate(part.ranks.allgather(np.concatenate(links)))
    labels, ends = np.unique(every, return_inverse=True)
    ends = ends.reshape(-1, 2)
    of_label = topology.components_of(ends, len(labels))
    number = np.full(part.n_points, -1, np.int32)
    number[used] = of_label[np.searchsorted(labels, label[used])]
    # A node without a cell here may have one on another rank.
    return Components(part.shared.merge(number, np.maximum), int(of_label.max(initial=-1)) + 1)


def piece_of(part: PartitionedMesh, component: int) -> Piece:
    """Return the part of a component on this rank."""
    return part.once(f"_piece_{component}", lambda: _find_piece(part, component))


def _find_piece(part: PartitionedMesh, component: int) -> Piece:
    number = components_of(part).number
    own = np.flatnonzero(number[part.cells[:, 0]] == component)
    if part.mesh is None or len(own) == 0:
        corners = np.vstack([np.zeros(part.dim), np.eye(part.dim)])
        simplex = SimplexMesh(corners, np.arange(part.dim + 1)[None])
        none = np.empty(0, np.int32)
        return Piece(part.ranks, simplex, part.global_ids[:0], none, [none] * part.ranks.size)
    nodes = np.flatnonzero(number == component)
    nodes = nodes[np.argsort(part.global_ids[nodes])]
    mesh, ids = part.mesh, part.global_ids[nodes]
    local = topology.places_among(nodes, part.n_points)
    if not np.array_equal(nodes, np.arange(part.n_points)):
        mesh = SimplexMesh(mesh.points[nodes], local[mesh.cells[own]])
    shared = [local[held][local[held] >= 0] for held in part.shared.nodes]
    return Piece(part.ranks, mesh, ids, nodes.astype(np.int32), shared)


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

    def with_cells(self, piece: Piece, marked: IntArray) -> tuple[Skeleton, SimplexMesh]:
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


def find_skeleton(piece: Piece, threads: int) -> Skeleton | None:
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


def _statuses(piece: Piece, facets: Ids) -> npt.NDArray[np.int8]:
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
