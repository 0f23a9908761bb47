"""The exact method on distributed meshes.

Each rank solves the problem of its own cells with the serial functions.  The sources that it
keeps are sent to the ranks on which they may matter, and lower the sizes there.  The result is the
minimum of the same numbers as on one process: see docs/distributed.md for the proof.

In solids that are not convex, all ranks have the boundary, the cells at it, and the reflex edges,
and compute the sizes at the nodes of these edges alike.  See
docs/decisions/0030-one-exchange-between-ranks.md.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.geometry.convexity import count_corners
from adaptsize.geometry.plane_boundary import plane_boundary
from adaptsize.limiting import tuning
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.boundary_of_parts import Skeleton, find_skeleton
from adaptsize.limiting.exact.candidates import Component, bounds_meet, margin_for
from adaptsize.limiting.exact.components import ComponentPiece, piece_of
from adaptsize.limiting.exact.exchange import exchange_rows, of_this_rank, reach_of
from adaptsize.limiting.exact.field import (
    ComponentSolution,
    Entries,
    ExactField,
    Points,
    node_entries,
    sorted_entries,
)
from adaptsize.limiting.exact.obstacles_in_plane import Plane, has_many_corners, plane_of
from adaptsize.limiting.exact.paths_in_space import solve_in_solid
from adaptsize.limiting.exact.solid import Solid, WholeSolid, solid_of
from adaptsize.limiting.exact.solve import hardly_rises, rises_too_fast, solve_by_sight
from adaptsize.limiting.problem import NeedsWholeMesh, TooManyCorners
from adaptsize.ranks import Communicator, Ids, rows_among
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Columns of a table of entries; those with the global numbers of their nodes follow.
_COLUMNS = 12

# Share by which sizes may exceed those along edges before they are discarded, or more.
_ABOVE = 1.0 + 1e-9


def solve_piece(part: PartitionedMesh, number: int, component: Component) -> ComponentSolution:
    """Return the solution in one component at the nodes of this rank, without sources; collective.

    Raises
    ------
    NeedsWholeMesh
        On all ranks, if the mesh has cells without measure or cells that overlap.
    """
    piece, threads = piece_of(part, number), component.workers.threads
    skeleton = part.once(f"_skeleton_{number}", lambda: find_skeleton(piece, threads))
    if skeleton is None:
        raise NeedsWholeMesh
    mesh, comm = piece.mesh, piece.ranks
    meets = bounds_meet(mesh.cells, component.h0, threads)
    own_bounds = int(np.count_nonzero(np.isfinite(component.h0)))
    facts = comm.allgather((component.least, meets, own_bounds, len(piece.ids)))
    diagonal = skeleton.diagonal
    least = min(one[0] for one in facts)
    if hardly_rises(least, component.g, diagonal):
        none = np.empty((0, mesh.dim))
        field = ExactField(
            component.g, None, False, [node_entries(none, none[:, 0], np.empty(0, np.int32))]
        )
        kept = np.full(len(piece.nodes), -1, np.int32)
        return ComponentSolution(np.full(len(piece.nodes), least), kept, field, none)
    component = component._replace(
        order=along_curve(mesh.points, threads),
        meet=any(one[1] for one in facts),
        margin=margin_for(least, component.g, diagonal),
        merge=partial(_merge_rows, piece),
    )
    if skeleton.convex:
        n_bounds = sum(one[2] for one in facts)
        if tuning.FEW_BOUNDS * comm.size * n_bounds <= sum(one[3] for one in facts):
            component = component._replace(complete=partial(_with_all_nodes, piece))
        return _with_others(piece, component, None, skeleton)
    if mesh.dim == 3:
        body = part.once(f"_body_{number}", lambda: find_body(piece, skeleton))
        return solve_body(part, piece, body, component)
    if not component.at_any_price:
        n_corners = count_corners(skeleton.points, skeleton.boundary)
        own = np.ones(len(piece.ids), np.bool_)  # the nodes that no rank before this one holds
        own[np.concatenate([piece.nodes[:0], *piece.shared[: comm.rank]])] = False
        if has_many_corners(n_corners, comm.allreduce(int(own.sum()), "sum")):
            raise TooManyCorners
    plane = part.once(f"_plane_{number}", lambda: _plane_on(piece, skeleton))
    plane = replace(plane, sizes=np.full_like(plane.sizes, np.inf))
    found = _with_others(piece, component, plane, skeleton)
    folded = not piece.is_empty and rises_too_fast(component, found.h)
    if comm.allreduce(int(folded), "max"):
        raise NeedsWholeMesh
    return found


def _with_others(
    piece: ComponentPiece, component: Component, plane: Plane | None, skeleton: Skeleton
) -> ComponentSolution:
    """Return the sizes in a convex domain (no ``plane``) or in the plane; at most one exchange."""
    mesh, boundary = component.mesh, skeleton.boundary
    if plane is not None:  # its facets are named by local nodes, others do not matter
        boundary = boundary._replace(facets=_local_facets(piece, skeleton))
    found = solve_by_sight(component, plane, boundary)
    own_nodes = slice(len(piece.nodes))
    if component.complete is not None and not (component.meet and component.face_sources):
        return replace(found, h=found.h[own_nodes])
    assert component.order is not None
    order = component.order[:0] if piece.is_empty else component.order
    points, field = Points(mesh.points, order), found.field
    if plane is not None:
        points = points._replace(on_wall=plane.boundary.rows)
    sent = [of_this_rank(entries, mesh.n_points) for entries in field.groups]
    if component.complete is not None:  # others have the nodes already
        sent[0] = sent[0].only(np.zeros(len(sent[0].nodes), np.bool_))
    reach = reach_of(points.places, points.order, found.h)
    table = exchange_rows(piece.ranks, sent, [own.table for own in sent], reach, component.g)
    named = np.full((len(table), mesh.dim), -1, np.int32)
    named[:, 0] = np.arange(len(table))
    field.groups.append(sorted_entries(table, named))
    field.lower_by_last(points, found.h, found.source, component.workers)
    return replace(found, h=found.h[own_nodes])


def _with_all_nodes(piece: ComponentPiece, entries: Entries) -> Entries:
    """Return nodes with those that other ranks keep; one gather."""
    comm, n = piece.ranks, piece.mesh.n_points
    every = comm.allgather(of_this_rank(entries, n).table)
    others = np.concatenate([*every[: comm.rank], *every[comm.rank + 1 :]])
    named = np.full((len(others), entries.nodes.shape[1]), -1, np.int32)
    named[:, 0] = n  # not of this rank
    table = np.concatenate([entries.table, others])
    return sorted_entries(table, np.concatenate([entries.nodes, named]))


def _plane_on(piece: ComponentPiece, skeleton: Skeleton) -> Plane:
    """Return walls and corners, the same on all ranks, with the rows of local nodes."""
    counts = [np.bincount(ends, minlength=len(skeleton.ids)) for ends in skeleton.boundary.facets.T]
    irregular = np.flatnonzero((counts[0] != 1) | (counts[1] != 1)).astype(np.int32)
    wider, mesh = skeleton.with_cells(piece, irregular)
    whole = plane_boundary(mesh, wider.boundary)
    plane = plane_of(mesh.points, whole)
    rows = np.append(whole.rows, np.int32(-1))[rows_among(piece.ids, wider.ids)]
    if piece.is_empty:
        rows = np.full(piece.mesh.n_points, -1, np.int32)
    merge = partial(_merge_corners, piece.ranks)
    return replace(plane, boundary=whole._replace(rows=rows), merge=merge)


def _merge_corners(
    comm: Communicator, sizes: FloatArray, arrivals: FloatArray, lowered: BoolArray
) -> None:
    """Take the smallest size that any rank has found at each corner (In/Out: all)."""
    every = comm.allgather((sizes, arrivals, lowered))
    all_sizes = np.array([own[0] for own in every])
    best = np.argmin(all_sizes, axis=0), np.arange(len(sizes))
    sizes[:] = all_sizes[best]
    arrivals[:] = np.array([own[1] for own in every])[best]
    lowered[:] = np.array([own[2] for own in every])[best]


def _local_facets(piece: ComponentPiece, skeleton: Skeleton) -> IntArray:
    """Return the facets of the boundary both of whose nodes are on this rank, as local nodes."""
    facets = rows_among(skeleton.ids, piece.ids)[skeleton.boundary.facets]
    return facets[(facets >= 0).all(axis=1)]


def _merge_rows(piece: ComponentPiece, rows: IntArray) -> IntArray:
    """Return edges and faces with those that other ranks list at shared nodes; one exchange."""
    padded = np.append(piece.ids, -1)
    sent = []
    for nodes in piece.shared:
        held = np.zeros(len(padded), np.bool_)
        held[nodes], held[-1] = True, True
        own = rows[held[rows[:, :-1]].all(axis=1)]
        sent.append(np.column_stack([padded[own[:, :-1]], own[:, -1]]))
    found = np.concatenate(piece.ranks.alltoallv(sent))
    nodes = rows_among(found[:, :-1], piece.ids)
    return np.concatenate([rows, np.column_stack([nodes, found[:, -1]]).astype(np.int32)])


class Body(NamedTuple):
    """A solid on one rank: its own nodes, and those of the cells at the boundary of the whole."""

    ids: Ids
    """int64[n]: global numbers, ascending."""
    own: IntArray
    """int32[m]: the nodes of the piece of this rank; empty on a rank without cells."""
    solid: Solid


def find_body(piece: ComponentPiece, skeleton: Skeleton) -> Body:
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
    return Body(ids, own, solid_of(mesh, boundary, own))


def solve_body(
    part: PartitionedMesh, piece: ComponentPiece, body: Body, component: Component
) -> ComponentSolution:
    """Return the limited sizes at the nodes of a piece, without sources; collective.

    Nodes that other ranks own count as proved, so that each node counts once.
    """
    found, _ = solve_in_solid(PartOfSolid(part, piece, body, component))
    own = body.own
    assert found.proved is not None
    assert found.lower is not None
    proved = found.proved[own] | ~part.is_owned[piece.nodes]
    return replace(found, h=found.h[own], proved=proved, lower=found.lower[own])


class PartOfSolid(WholeSolid):
    """What one rank knows of a solid; all methods but `known` and `own` are collective."""

    def __init__(
        self, part: PartitionedMesh, piece: ComponentPiece, body: Body, component: Component
    ) -> None:
        points = piece.mesh.points if piece.is_empty else body.solid.points[body.own]
        super().__init__(component, body.solid, points)
        self.part, self.piece, self.body = part, piece, body
        self.h0, self.reach = _bounds(piece, body, self.component)
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

    def with_others(self, entries: Entries) -> tuple[Entries, Ids]:
        """Return own sources, and those of other ranks that may act here; one exchange."""
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
        """Return the nodes of sources in the body, padded with -1.

        At a node of the boundary all cells are known.  So either all nodes of a source are known,
        or none is on the boundary; then they do not matter, and -1 is returned for all.
        """
        at = rows_among(numbers, self.body.ids)
        at[((at < 0) & (numbers >= 0)).any(axis=1)] = -1
        return at

    def total(self, nodes: IntArray) -> int:
        """Return the number of nodes on all ranks, each counted once."""
        owned = np.zeros(len(self.body.ids), np.bool_)
        owned[self.body.own] = self.part.is_owned[self.piece.nodes]
        return int(self.piece.ranks.allreduce(int(np.count_nonzero(owned[nodes])), "sum"))

    def any(self, flag: bool) -> bool:
        """Return whether a flag is set on any rank."""
        return bool(self.piece.ranks.allreduce(int(flag), "max"))

    def need_all_cells(self) -> None:
        """Raise `NeedsWholeMesh`, on all ranks."""
        raise NeedsWholeMesh

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


def _bounds(
    piece: ComponentPiece, body: Body, component: Component
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds at the nodes of the body, and what sources must undercut to matter.

    The latter are sizes that grow along the edges of the own cells, at the own nodes and at the
    nodes of reflex edges.
    """
    mesh, reflex_nodes = component.mesh, body.solid.reflex_edges.nodes
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
    # Between two nodes of an edge, a size is larger by up to g times half of their distance.
    apart = np.diff(body.solid.reflex_edges.pieces.ends, axis=1)
    largest[reflex_nodes] += 0.5 * component.g * apart.max(initial=0.0)
    own = reach_of(mesh.points, order, largest[body.own])
    return both[0], np.concatenate(
        [own, reach_of(body.solid.points[reflex_nodes], along, largest[reflex_nodes])]
    )
