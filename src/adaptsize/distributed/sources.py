"""`PartsSources`: the controlling sources of limited sizes on a distributed mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.exact_plane import CORNER
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.pieces import Piece
from adaptsize.limiting.exact.problem import Problem
from adaptsize.limiting.exact.waves import Wave
from adaptsize.limiting.sources import SizeSources
from adaptsize.ranks import Communicator, Ids, split_rows
from adaptsize.typing import FloatArray, IntArray


class Traced(NamedTuple):
    """Sources of sizes, as global numbers."""

    nodes: Ids
    """int64[n, dim]: as in `PartsSources`."""
    first: Ids
    """int64[n]: the node of each source whose bound is the smallest."""
    bends: FloatArray
    """float64[n, dim], or no rows: as in `PartsSources`."""


@dataclass(frozen=True, eq=False, repr=False)
class PartsSources:
    """The controlling source of each size at the nodes of a rank.

    They are ``info.sources`` of `distributed.limit_gradient` with ``full_output=True``, and equal
    those of one process, `adaptsize.limiting.SizeSources`.  If several sources allow exactly the
    same size, it depends on the partition which of them is named, and ranks that share a node may
    name different ones.

    Examples
    --------
    >>> import numpy as np
    >>> from adaptsize import SimplexMesh
    >>> from adaptsize.distributed import PartitionedMesh, limit_gradient
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> h0 = np.where(part.global_ids == 1, 0.1, np.inf)
    >>> _, info = limit_gradient(part, h0, 0.3, full_output=True)
    >>> info.sources.roots()  # all sizes are those that node 1 allows
    array([1, 1, 1, 1])
    """

    part: PartitionedMesh
    nodes: Ids
    """int64[n_local, dim]: global numbers of the nodes of each source, padded with -1.  A node that
    keeps its bound is its own source.  A node that no bound reaches has no source.  If the path
    bends at a node of the plane, that node is the source.  ``n_global_points + k`` is the k-th of
    the point sources."""
    bends: FloatArray
    """float64[n_local, dim]: the last point where the path from the source bends, nan if the path
    is straight.  There may be no rows if all paths are."""
    first: Ids
    """int64[n_local]: of each source, the node whose bound is the smallest."""

    def __repr__(self) -> str:
        """Return the numbers of sources and of nodal sizes of this rank."""
        n_sources = len(np.unique(self.nodes[self.nodes[:, 0] >= 0], axis=0))
        return f"PartsSources({n_sources} sources of {len(self.nodes)} nodal sizes)"

    def roots(self) -> Ids:
        """Return for each node the node whose bound its size goes back to; collective.

        Where a path bends, it is followed further back to its source.  If a source has several
        nodes, the one with the smallest bound is returned.

        Returns
        -------
        ndarray of int64, shape (n_local,)
            Global numbers; -1 where no bound reaches, ``n_global_points + k`` for the k-th of the
            point sources.
        """
        part, comm = self.part, self.part.ranks
        share = part.n_global_points // comm.size + 1  # of the nodes, for each rank
        own = part.is_owned
        ids = part.global_ids[own]
        sent = split_rows(np.column_stack([ids, self.first[own]]), ids // share, comm.size)
        pairs = np.concatenate(comm.alltoallv(sent))
        root = np.empty(len(pairs), np.int64)
        root[pairs[:, 0] - comm.rank * share] = pairs[:, 1]
        while True:  # each pass doubles the number of steps that are followed
            further = _look_up(comm, root, share, root, part.n_global_points)
            if not comm.allreduce(int((further != root).any()), "max"):
                return _look_up(comm, root, share, self.first, part.n_global_points)
            root = further


def _look_up(comm: Communicator, held: Ids, share: int, ids: Ids, n: int) -> Ids:
    """Return the values of nodes, of which each rank holds a share; other numbers as they are.

    Two exchanges.
    """
    asking = np.flatnonzero((ids >= 0) & (ids < n))
    at = ids[asking] // share
    asked = comm.alltoallv(split_rows(ids[asking], at, comm.size))
    answers = comm.alltoallv([held[some - comm.rank * share] for some in asked])
    found = ids.copy()
    found[asking[np.argsort(at, kind="stable")]] = np.concatenate(answers)
    return found


class Numbers(NamedTuple):
    """Global numbers of the nodes of entries."""

    of_nodes: Ids
    """int64: those of nodes, then those of sources between the nodes, then -1."""
    of_corners: Ids
    """int64: those of the nodes of the boundary, which corners refer to; empty if there are
    none."""

    def of(self, wave: Wave) -> Ids:
        """Return those of the entries, padded with -1."""
        if len(self.of_corners) == 0:
            return self.of_nodes[wave.nodes]
        is_corner = wave.table[:, CORNER] > 0.0
        named: Ids = self.of_nodes[np.where(is_corner[:, None], np.int32(-1), wave.nodes)]
        named[is_corner, 0] = self.of_corners[wave.nodes[is_corner, 0]]
        return named


def numbers_of(piece: Piece, problem: Problem, n_global: int) -> Ids:
    """Return the global numbers of nodes, then those of sources between the nodes, then -1."""
    n, extra = problem.mesh.n_points, problem.extra
    last = n if extra is None else int(extra.numbers.max(initial=n - 1)) + 1
    ids = np.arange(last + 1) - n + n_global
    ids[:n], ids[-1] = -1, -1
    ids[: len(piece.ids)] = piece.ids
    return ids


def trace(own: Ids, source: IntArray, named: Ids, sizes: FloatArray, bends: FloatArray) -> Traced:
    """Return the sources of the sizes at nodes.

    Parameters
    ----------
    own : int64[n]
        Global numbers of the nodes.
    source : int32[n]
        Number of the entry, -1 if a node keeps its bound.
    named, sizes : int64[m, dim], float64[m, dim]
        Global numbers of the nodes of entries, padded with -1, and bounds there.
    bends : float64[n, dim]
        Or no rows.
    """
    nodes = np.full((len(own), named.shape[1]), -1, np.int64)
    nodes[:, 0], first = own, own.copy()
    has = source >= 0
    used = source[has]
    nodes[has] = named[used]
    first[has] = named[used, np.argmin(sizes[used], axis=1)]
    return Traced(nodes, first, bends)


def untraced(part: PartitionedMesh) -> Traced:
    """Return each node as its own source."""
    none = np.full(part.n_points, -1, np.int32)
    nowhere = np.empty((0, part.dim))
    return trace(part.global_ids, none, np.empty((0, part.dim), np.int64), nowhere, nowhere)


def with_piece(whole: Traced, piece: Piece, found: Traced) -> Traced:
    """Return the sources of a part with those in one component (In/Out: ``whole``)."""
    whole.nodes[piece.nodes], whole.first[piece.nodes] = found.nodes, found.first
    if len(found.bends) == 0:
        return whole
    bends = whole.bends if len(whole.bends) else np.full(whole.nodes.shape, np.nan)
    bends[piece.nodes] = found.bends
    return whole._replace(bends=bends)


def sources_of(part: PartitionedMesh, h: FloatArray, traced: Traced) -> PartsSources:
    """Return the sources of sizes on this rank (In/Out: traced)."""
    free = np.isinf(h)
    traced.nodes[free], traced.first[free] = -1, -1
    return PartsSources(part, traced.nodes, traced.bends, traced.first)


def traced_from(sources: SizeSources) -> Traced:
    """Return the sources of one process."""
    nodes, n = sources.nodes.astype(np.int64), len(sources.bound)
    bounds = np.append(sources.bound, np.inf)[np.where(nodes < n, nodes, -1)]
    first = np.take_along_axis(nodes, np.argmin(bounds, axis=1)[:, None], axis=1)[:, 0]
    return Traced(nodes, first, sources.bends)


def scattered(part: PartitionedMesh, whole: Traced | None) -> PartsSources:
    """Return the sources of this rank, given those of all sizes on rank 0; collective."""
    columns = None
    if whole is not None:
        bends = whole.bends if len(whole.bends) else np.full(whole.nodes.shape, np.nan)
        columns = np.column_stack([whole.nodes, whole.first, bends])
    own, dim = part.scatter_nodal(columns), part.dim
    numbers = own[:, : dim + 1].astype(np.int64)
    return PartsSources(part, numbers[:, :dim], own[:, dim + 1 :], numbers[:, dim])
