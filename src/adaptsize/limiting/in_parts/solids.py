"""The exact method in distributed solids that are not convex.

All ranks have the boundary, the cells at it, and the reflex edges, and compute the sizes at the
nodes of these edges alike.  For its other nodes each rank does what a single process does.  See
docs/decisions/0030-one-exchange-between-ranks.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.candidates import Component
from adaptsize.limiting.exact.field import Entries, node_entries, sorted_entries
from adaptsize.limiting.exact.solve import ComponentSolution, WholeSolid, solve_in_solid
from adaptsize.limiting.exact.space import Solid, solid_of
from adaptsize.limiting.in_parts.domain import Piece, Skeleton
from adaptsize.limiting.in_parts.entries import exchange_rows, of_this_rank, reach_of
from adaptsize.ranks import Ids, rows_among
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Columns of a table of entries; those with the global numbers of their nodes follow.
_COLUMNS = 12

# Share by which sizes may exceed those along edges before they are discarded, or more.
_ABOVE = 1.0 + 1e-9


class Body(NamedTuple):
    """A solid on one rank: its own nodes, and those of the cells at the boundary of the whole."""

    ids: Ids
    """int64[n]: global numbers, ascending."""
    own: IntArray
    """int32[m]: the nodes of the piece of this rank; empty on a rank without cells."""
    boundary: FlatBoundary
    solid: Solid

    def rows(self, ids: Ids) -> IntArray:
        """Return the numbers of the nodes of entries, padded with -1.

        At a node of the boundary all cells are known.  So either all nodes of an entry are known,
        or none is on the boundary; then they do not matter, and -1 is returned for all.
        """
        at = rows_among(ids, self.ids)
        at[((at < 0) & (ids >= 0)).any(axis=1)] = -1
        return at


def find_body(piece: Piece, skeleton: Skeleton) -> Body:
    """Return the boundary with the cells at it, and the reflex edges; collective."""
    everywhere = np.arange(len(skeleton.ids), dtype=np.int32)
    wider, near = skeleton.with_cells(piece, everywhere)
    ids = np.union1d(wider.ids, piece.ids)
    at, own = (np.searchsorted(ids, some).astype(np.int32) for some in (wider.ids, piece.ids))
    points = np.empty((len(ids), 3))
    points[at] = near.points
    points[own] = piece.mesh.points[: len(own)]
    boundary = wider.boundary._replace(facets=at[wider.boundary.facets])
    mesh = SimplexMesh(points, at[near.cells])
    return Body(ids, own, boundary, solid_of(mesh, boundary, own))


def solve_body(
    part: PartitionedMesh, piece: Piece, body: Body, component: Component
) -> ComponentSolution:
    """Return the limited sizes at the nodes of a piece, without sources; collective.

    Nodes that other ranks own count as proved, so that each node counts once.
    """
    found, field, _ = solve_in_solid(PartOfSolid(part, piece, body, component))
    return ComponentSolution(
        found.h[body.own],
        np.empty(0, np.int32),
        field,
        proved=found.proved[body.own] | ~part.is_owned[piece.nodes],
        lower=found.lower[body.own],
        finished=found.finished,
    )


class PartOfSolid(WholeSolid):
    """What one rank knows of a solid; all methods but `known` and `own` are collective."""

    def __init__(
        self, part: PartitionedMesh, piece: Piece, body: Body, component: Component
    ) -> None:
        super().__init__(component, body.solid)
        self.part, self.piece, self.body = part, piece, body
        self.h0, self.reach = _bounds(piece, body, component)
        # Global numbers of nodes, then those of sources between the nodes, then -1.
        n, extra = component.mesh.n_points, component.extra
        last = n if extra is None else int(extra.numbers.max(initial=n - 1)) + 1
        self.ids = np.arange(last + 1) - n + part.n_global_points
        self.ids[:n], self.ids[-1] = -1, -1
        self.ids[: len(piece.ids)] = piece.ids

    def candidates(self) -> tuple[IntArray, BoolArray | None]:
        """Return the nodes that may be sources, as on the whole mesh; one exchange."""
        component, nodes_in_part, part = self.component, self.piece.nodes, self.part
        nodes, steep = super().candidates()
        if steep is None:
            return nodes, None
        # A node counts if it does in the cells of some rank, and is not dominated in those of any.
        state = np.zeros(component.mesh.n_points, np.int8)
        state[component.mesh.cells[steep]] = 2
        state[~np.isfinite(component.h0)] = 0
        state[nodes] = 1
        in_part = np.zeros(part.n_points, np.int8)
        in_part[nodes_in_part] = state[: len(nodes_in_part)]
        merged = part.shared.merge(in_part, np.maximum)[nodes_in_part]
        return np.flatnonzero(merged == 1).astype(np.int32), steep

    def with_others(self, entries: Entries | None) -> tuple[Entries, Ids]:
        """Return own sources, and those of other ranks that may act here; one exchange."""
        if entries is None:
            entries = node_entries(np.empty((0, 3)), np.empty(0), np.empty(0, np.int32))
        own = np.column_stack([entries.table, self.ids[entries.nodes].astype(np.float64)])
        ranks, n = self.piece.ranks, self.component.mesh.n_points
        sent = own[entries.nodes[:, 0] < n]
        others = exchange_rows(
            ranks, [of_this_rank(entries, n)], [sent], self.reach, self.component.g
        )
        rows = np.concatenate([own, others])
        numbers = rows[:, _COLUMNS:].astype(np.int64)
        _, first = np.unique(numbers, axis=0, return_index=True)
        places = np.full((len(first), 3), -1, np.int32)
        places[:, 0] = np.arange(len(first))
        added = sorted_entries(rows[first, :_COLUMNS], places)
        return added, numbers[first][added.nodes[:, 0]]

    def known(self, numbers: Ids) -> IntArray:
        """Return the numbers of the nodes of sources in the body."""
        return self.body.rows(numbers)

    def own(self, sizes: FloatArray) -> FloatArray:
        """Return the sizes at the nodes of the piece."""
        return sizes[self.body.own] if len(self.body.own) else self.component.h0

    def spread(self, h: FloatArray) -> FloatArray:
        """Return sizes, lowered along the edges of the whole mesh."""
        own, nodes = self.body.own, self.piece.nodes
        reflex_nodes = self.solid.reflex_edges.nodes
        in_part = np.full(self.part.n_points, np.inf)
        in_part[nodes] = h[own]
        lowered = h.copy()
        report = self.component.workers.report
        lowered[own] = limit_along_edges(self.part, in_part, self.component.g, report)[nodes]
        lowered[reflex_nodes] = self.piece.ranks.allreduce(lowered[reflex_nodes], "min")
        return lowered


def _bounds(piece: Piece, body: Body, component: Component) -> tuple[FloatArray, FloatArray]:
    """Return the bounds at the nodes of the body, and what sources must undercut to matter.

    The latter are sizes that grow along the edges of the own cells, at the own nodes and at the
    nodes of reflex edges.
    """
    mesh, reflex_nodes = piece.mesh, body.solid.reflex_edges.nodes
    both = np.full((2, len(body.ids)), np.inf)
    order = np.empty(0, np.int32)
    if not piece.is_empty:
        alone = limit_along_edges(mesh, component.h0, component.g, component.workers.report)
        both[0, body.own], both[1, body.own] = component.h0, alone
        assert component.order is not None
        order = component.order
    both[:, reflex_nodes] = piece.ranks.allreduce(both[:, reflex_nodes], "min")
    largest = _ABOVE * both[1]
    along = np.arange(len(reflex_nodes), dtype=np.int32)
    own = reach_of(mesh.points, order, largest[body.own])
    return both[0], np.concatenate(
        [own, reach_of(body.solid.points[reflex_nodes], along, largest[reflex_nodes])]
    )
