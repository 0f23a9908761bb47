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
from adaptsize.limiting.exact.candidates import Component, candidates_of, sources_on_cells
from adaptsize.limiting.exact.field import Entries, ExactField, Points, node_entries, sorted_entries
from adaptsize.limiting.exact.solve import ComponentSolution, entries_of_nodes
from adaptsize.limiting.exact.space import (
    Bounds,
    Solid,
    SolidSources,
    Spread,
    solid_of,
    solve_in_space,
)
from adaptsize.limiting.in_parts.domain import Piece, Skeleton
from adaptsize.limiting.in_parts.entries import exchange_rows, of_this_rank, reach_of
from adaptsize.ranks import Ids
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
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        known = (self.ids[at] == ids) | (ids < 0)
        return np.where(known.all(axis=1)[:, None] & (ids >= 0), at, -1).astype(np.int32)


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
    g, solid = component.g, body.solid
    numbers = _numbers_of(piece, component, part.n_global_points)
    h0, reach = _bounds(piece, body, component)
    lower, source = h0.copy(), np.full(len(h0), -1, np.int32)
    points = Points(solid.points, solid.nodes, np.empty(0, np.int32))
    nodes, steep = _candidates(part, piece, component)
    linear = steep is not None and component.face_sources
    field = ExactField(g, None, linear)

    def lower_by(entries: Entries) -> FloatArray:
        """Lower sizes by the sources of all ranks, and return these."""
        rows = _with_others(piece, entries, numbers, reach, g)
        places = np.full((len(rows), 3), -1, np.int32)
        places[:, 0] = np.arange(len(rows))
        added = sorted_entries(rows[:, :_COLUMNS], places)
        found = np.full(len(source), -1, np.int32)
        by_last = ExactField(g, None, linear, [added])
        by_last.lower_by_last(points, lower, found, component.workers)
        lowered = found >= 0
        source[lowered] = added.nodes[found[lowered], 0] + field.n_entries
        field.add(added)
        return rows

    rows = lower_by(entries_of_nodes(component, nodes))
    if linear and steep is not None:
        h = lower[body.own] if len(body.own) else component.h0
        on_cells = sources_on_cells(component, steep, h)
        if on_cells is None:
            on_cells = node_entries(np.empty((0, 3)), np.empty(0), np.empty(0, np.int32))
        rows = np.concatenate([rows, lower_by(on_cells)])
    order, place = _in_order(rows[:, _COLUMNS:])
    rows = rows[order]
    named = rows[:, _COLUMNS:].astype(np.int64)
    sources = SolidSources(rows[:, :_COLUMNS].copy(), body.rows(named))
    nearest = np.append(place, np.int32(-1))[source]
    bounds = Bounds(h0, lower, nearest, _spread(part, piece, body, component))
    found = solve_in_space(solid, sources, bounds, g, component.workers)
    return ComponentSolution(
        found.h[body.own],
        np.empty(0, np.int32),
        field,
        proved=found.proved[body.own] | ~part.is_owned[piece.nodes],
        lower=found.lower[body.own],
        finished=found.finished,
    )


def _numbers_of(piece: Piece, component: Component, n_global: int) -> Ids:
    """Return the global numbers of nodes, then those of sources between the nodes, then -1."""
    n, extra = component.mesh.n_points, component.extra
    last = n if extra is None else int(extra.numbers.max(initial=n - 1)) + 1
    ids = np.arange(last + 1) - n + n_global
    ids[:n], ids[-1] = -1, -1
    ids[: len(piece.ids)] = piece.ids
    return ids


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


def _candidates(
    part: PartitionedMesh, piece: Piece, component: Component
) -> tuple[IntArray, BoolArray | None]:
    """Return the nodes that may be sources as `candidates_of` on the whole mesh; one exchange."""
    mesh = piece.mesh
    nodes, steep = candidates_of(component)
    if steep is None:
        return nodes, None
    # A node counts if it does in the cells of some rank, and is not dominated in those of any.
    state = np.zeros(mesh.n_points, np.int8)
    state[mesh.cells[steep]] = 2
    state[~np.isfinite(component.h0)] = 0
    state[nodes] = 1
    in_part = np.zeros(part.n_points, np.int8)
    in_part[piece.nodes] = state[: len(piece.nodes)]
    merged = part.shared.merge(in_part, np.maximum)[piece.nodes]
    return np.flatnonzero(merged == 1).astype(np.int32), steep


def _with_others(
    piece: Piece, entries: Entries, numbers: Ids, reach: FloatArray, g: float
) -> FloatArray:
    """Return own entries, and those of other ranks that may act here; one exchange.

    Each row holds the table of an entry and the global numbers of its nodes, and is unique.
    """
    own = np.column_stack([entries.table, numbers[entries.nodes].astype(np.float64)])
    n = piece.mesh.n_points
    sent = own[entries.nodes[:, 0] < n]
    others = exchange_rows(piece.ranks, [of_this_rank(entries, n)], [sent], reach, g)
    rows = np.concatenate([own, others])
    order, _ = _in_order(rows[:, _COLUMNS:])
    rows = rows[order]
    new = np.ones(len(rows), np.bool_)
    new[1:] = (rows[1:, _COLUMNS:] != rows[:-1, _COLUMNS:]).any(axis=1)
    unique: FloatArray = rows[new]
    return unique


def _in_order(ids: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the lexicographic order of rows, and the place of each row in it."""
    order = np.lexsort(ids.T[::-1]).astype(np.int32)
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    return order, place


def _spread(part: PartitionedMesh, piece: Piece, body: Body, component: Component) -> Spread:
    """Return the collective function that lowers sizes along the edges of the whole mesh."""
    reflex_nodes = body.solid.reflex_edges.nodes

    def spread(h: FloatArray) -> FloatArray:
        in_part = np.full(part.n_points, np.inf)
        in_part[piece.nodes] = h[body.own]
        lowered = h.copy()
        along = limit_along_edges(part, in_part, component.g, component.workers.report)
        lowered[body.own] = along[piece.nodes]
        lowered[reflex_nodes] = piece.ranks.allreduce(lowered[reflex_nodes], "min")
        return lowered

    return spread
