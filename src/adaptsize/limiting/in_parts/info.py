"""Diagnostics of a limited size field on a mesh in parts, and the sources of its sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from adaptsize._kernels.exact_plane import CORNER
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.limiting.exact.candidates import Component
from adaptsize.limiting.exact.field import Entries
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.in_parts.domain import Piece
from adaptsize.limiting.info import QUANTILES, LimitingInfo, slopes_on_mesh
from adaptsize.limiting.sources import SizeSources
from adaptsize.ranks import Communicator, Ids, split_rows
from adaptsize.typing import FloatArray, IntArray


@dataclass(frozen=True)
class PartsLimitingInfo:
    """Diagnostics of a limited size field on a distributed mesh.

    They are the same on all ranks, except ``sources``.

    The attributes are those of `LimitingInfo` for the whole mesh, and equal
    those of one process, except ``iterations`` and, with fast marching, rounding.
    """

    method: str
    """The scheme that was used."""
    iterations: int
    """Number of accepted nodes (marching) or sources (exact method), summed over the ranks.

    Ranks repeat work of others, so that it depends on the partition."""
    converged: bool
    """Whether the scheme converged."""
    n_points: int
    """Number of nodes of the whole mesh."""
    n_changed: int
    """Number of nodes whose size is now below ``h0``."""
    n_free: int
    """Number of nodes whose size is inf because there is no bound in their component."""
    residual: float
    """Residual of the discrete equations, relative to the largest size; 0 for the exact method."""
    largest_edge_slope: float
    """Largest ``(h_i - h_j) / (g |x_i - x_j|)`` over all edges."""
    cell_gradient_quantiles: dict[float, float]
    """Quantiles (0.5, 0.9, 0.99, 1) of ``|grad h| / g`` over all cells with a measure."""
    n_proved: int | None
    """Number of nodes whose size is proved exact; None for other methods than ``"exact"``."""
    largest_gap: float | None
    """Largest difference between a size that is not proved exact and its lower bound.

    0 if all sizes are proved exact; None for other methods than ``"exact"``."""
    sources: PartsSources | None = field(default=None, compare=False, repr=False)
    """Source of each size at the nodes of this rank; None for other methods than ``"exact"``."""

    def __str__(self) -> str:
        """Say which method was used and how many sizes are below their bounds."""
        return f"{self.method}: {self.n_changed} of {self.n_points} sizes are below h0"


class Solved(NamedTuple):
    """What a method has found on one rank."""

    h: FloatArray
    iterations: int
    finished: bool = True
    n_hidden: int | None = None
    """Number of nodes of this rank, without those of other owners, that are not proved exact; None
    for other methods than the exact one."""
    largest_gap: float = 0.0
    excess: float = 0.0
    """Largest excess of a size over its update."""
    traced: Traced | None = None
    """The sources of the sizes, if they were requested of the exact method."""


def info_of(
    part: PartitionedMesh, method: str, h0: FloatArray, solved: Solved, slope: Slope
) -> PartsLimitingInfo:
    """Return the diagnostics; collective."""
    comm, own = part.ranks, part.is_owned
    h, n_hidden = solved.h, solved.n_hidden
    steepest, ratio = 0.0, np.empty(0)
    if part.mesh is not None:
        steepest, ratio = slopes_on_mesh(part.mesh, h, slope)
    counts = [
        np.count_nonzero(own & (h < h0)),
        np.count_nonzero(own & np.isinf(h)),
        solved.iterations,
        n_hidden or 0,
        len(ratio),
    ]
    n_changed, n_free, iterations, hidden, n_cells = comm.allreduce(
        np.array(counts, np.int64), "sum"
    ).tolist()
    largest = h[np.isfinite(h)].max(initial=0.0)
    figures = np.array([solved.excess, largest, steepest, solved.largest_gap, not solved.finished])
    excess, largest, steepest, gap, unfinished = comm.allreduce(figures, "max").tolist()
    levels = [0.0] * len(QUANTILES)
    if n_cells:
        levels = _order_statistics(comm, ratio, [math.ceil((n_cells - 1) * q) for q in QUANTILES])
    return PartsLimitingInfo(
        method,
        iterations,
        not unfinished,
        part.n_global_points,
        n_changed,
        n_free,
        excess / largest if excess > 0.0 else 0.0,
        steepest,
        dict(zip(QUANTILES, levels, strict=True)),
        None if n_hidden is None else part.n_global_points - hidden,
        None if n_hidden is None else gap,
        None if solved.traced is None else sources_of(part, h, solved.traced),
    )


def info_from(info: LimitingInfo, n_points: int) -> PartsLimitingInfo:
    """Return the diagnostics of one process."""
    names = {entry.name for entry in fields(PartsLimitingInfo)} - {"n_points", "sources"}
    figures: dict[str, Any] = {name: getattr(info, name) for name in names}
    return PartsLimitingInfo(n_points=n_points, **figures)


def _order_statistics(comm: Communicator, values: FloatArray, places: list[int]) -> list[float]:
    """Return the values at places of the sorted values of all ranks; eight reductions.

    Numbers >= 0 are ordered like their bits, of which each reduction finds eight.
    """
    bits = np.sort(values).view(np.int64)
    found = np.zeros(len(places), np.int64)
    place = np.array(places)[:, None]
    for shift in range(56, -8, -8):
        digits = np.arange(1, 256 if shift < 56 else 128, dtype=np.int64) << shift
        below = comm.allreduce(np.searchsorted(bits, found[:, None] + digits), "sum")
        found += np.count_nonzero(below <= place, axis=1).astype(np.int64) << shift
    levels: list[float] = found.view(np.float64).tolist()
    return levels


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

    They are ``info.sources`` of ``limit_gradient.with_info`` on a mesh in parts, and equal
    those of one process, `SizeSources`.  If several sources allow exactly the
    same size, it depends on the partition which of them is named, and ranks that share a node may
    name different ones.

    Examples
    --------
    >>> import numpy as np
    >>> from adaptsize import SimplexMesh
    >>> from adaptsize import limit_gradient
    >>> from adaptsize.distributed import PartitionedMesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> h0 = np.where(part.global_ids == 1, 0.1, np.inf)
    >>> _, info = limit_gradient.with_info(part, h0, 0.3)
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
    found, first = ids.copy(), comm.rank * share
    found[asking] = comm.ask(ids[asking], ids[asking] // share, lambda some, _: held[some - first])
    return found


class Numbers(NamedTuple):
    """Global numbers of the nodes of entries."""

    of_nodes: Ids
    """int64: those of nodes, then those of sources between the nodes, then -1."""
    of_corners: Ids
    """int64: those of the nodes of the boundary, which corners refer to; empty if there are
    none."""

    def of(self, entries: Entries) -> Ids:
        """Return those of the entries, padded with -1."""
        if len(self.of_corners) == 0:
            return self.of_nodes[entries.nodes]
        is_corner = entries.table[:, CORNER] > 0.0
        named: Ids = self.of_nodes[np.where(is_corner[:, None], np.int32(-1), entries.nodes)]
        named[is_corner, 0] = self.of_corners[entries.nodes[is_corner, 0]]
        return named


def numbers_of(piece: Piece, component: Component, n_global: int) -> Ids:
    """Return the global numbers of nodes, then those of sources between the nodes, then -1."""
    n, extra = component.mesh.n_points, component.extra
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
