"""Assembly of parts, cells that move from rank to rank, and facets between parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import refuse_where
from adaptsize.background.merging import hashes_of
from adaptsize.background.partitioned import AnyMesh, PartitionedMesh
from adaptsize.background.partitioning import cut_part, joined
from adaptsize.background.simplex import SimplexMesh, facets_with_normals
from adaptsize.ranks import Communicator, Ids
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Bits per axis of keys along a Morton curve.
_BITS = 20


def migrate(part: PartitionedMesh, rank_of_cells: IntArray) -> PartitionedMesh:
    """Return the same mesh with each cell on another rank; collective.

    Tags and fields move with the cells.  Nodes in no cell are left out, and nodes get new numbers.
    """
    which = np.arange(part.n_cells)
    pieces = send_cells(part.ranks, part.mesh, part.global_ids, which, rank_of_cells)
    return from_pieces(part.ranks, pieces)


def send_cells(
    comm: Communicator,
    mesh: SimplexMesh | None,
    global_ids: Ids,
    which: npt.NDArray[np.integer],
    ranks: npt.NDArray[np.integer],
) -> list[Piece]:
    """Send cells with their tags and fields to ranks, any number of times; return those received.

    The keys of their nodes are the global numbers.  One exchange.
    """
    pieces: list[Piece | None] = [None] * comm.size
    if mesh is not None:
        nobody = np.full(mesh.n_points, -1, np.int32)
        for rank in np.unique(ranks).tolist():
            chosen = np.zeros(mesh.n_cells, np.int32)
            chosen[which[ranks == rank]] = 1
            cut = cut_part(mesh, chosen, nobody, 1)
            if cut.mesh is not None:
                pieces[rank] = Piece(cut.mesh, global_ids[cut.global_ids])
    return [piece for piece in comm.alltoall(pieces) if piece is not None]


def interface_facets(part: PartitionedMesh) -> IntArray:
    """Return the facets that this rank shares with others, as local nodes; collective."""
    facets, _, is_between = _free_facets(part)
    return np.asarray(facets[is_between])


def boundary_facets(mesh: AnyMesh) -> IntArray:
    """Return the facets on the boundary of the whole mesh, as local nodes; collective."""
    if isinstance(mesh, SimplexMesh):
        return np.asarray(mesh.facets[mesh.facet_cell_counts == 1])
    facets, is_outer, _ = _free_facets(mesh)
    return np.asarray(facets[is_outer])


def is_counted_here(mesh: AnyMesh, edges: IntArray) -> BoolArray:
    """Return whether this rank is the lowest one that passes each of its edges; collective.

    One exchange.  Sums over the edges of all ranks then count each edge once.
    """
    if isinstance(mesh, SimplexMesh):
        return np.ones(len(edges), np.bool_)
    low, high = np.sort(mesh.global_ids[edges], axis=1).T
    keys = low * mesh.n_global_points + high
    sent = []
    for rank, nodes in enumerate(mesh.shared.nodes):
        held = np.zeros(mesh.n_points, np.bool_)
        held[nodes] = rank > mesh.ranks.rank
        sent.append(keys[held[edges].all(axis=1)])
    return np.isin(keys, np.concatenate(mesh.ranks.alltoallv(sent)), invert=True)


def _free_facets(part: PartitionedMesh) -> tuple[IntArray, BoolArray, BoolArray]:
    """Return the facets on this rank, and which are on the boundary, and which between ranks.

    Two exchanges: each candidate goes to a rank that follows from its lowest node, which counts
    the ranks that have it.
    """
    comm, facets = part.ranks, np.empty((0, part.cell_dim), np.int32)
    counts = np.empty(0, np.int32)
    is_shared = np.zeros(part.n_points, np.bool_)
    is_shared[part.shared.every] = True
    if part.mesh is not None:
        facets, counts = part.mesh.facets, part.mesh.facet_cell_counts
    candidates = np.flatnonzero((counts == 1) & is_shared[facets].all(axis=1))
    keys = np.sort(part.global_ids[facets[candidates]], axis=1)

    def count(rows: Ids, _: Ids) -> Ids:
        _, group, times = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
        return np.asarray(times[group.ravel()])

    is_between = np.zeros(len(facets), np.bool_)
    is_between[candidates] = comm.ask(keys, keys[:, 0] % comm.size, count) > 1
    return facets, (counts == 1) & ~is_between, is_between


class WholeBoundary(NamedTuple):
    """The boundary of the whole domain, the same on all ranks."""

    mesh: SimplexMesh
    """Equal to that of `SimplexMesh.boundary` of the whole mesh."""
    ids: Ids
    """Global numbers of its nodes, ascending."""


def whole_boundary(part: PartitionedMesh) -> WholeBoundary:
    """Return the boundary of the whole mesh; collective on first use."""
    return part.once("_whole_boundary", lambda: _find_boundary(part))


def _find_boundary(part: PartitionedMesh) -> WholeBoundary:
    _, is_outer, _ = _free_facets(part)
    none = np.empty(0, np.int32)
    cell, opposite = part.cell_ids[:0], none
    facets, tags = np.empty((0, part.dim), np.int32), none
    if part.mesh is not None:
        own, corner, facets, given = facets_with_normals(part.mesh, is_outer)
        cell, opposite = part.cell_ids[own], corner.astype(np.int32)
        tags = np.full(len(own), -1, np.int32) if given is None else given
    nodes = np.unique(facets)
    ids = part.global_ids
    sent: tuple[npt.NDArray[Any], ...] = (
        cell, opposite, ids[facets], tags, ids[nodes], part.points[nodes]
    )  # fmt: skip
    names = None if part.mesh is None else dict(part.mesh.tag_names)
    every = part.ranks.allgather((sent, names))
    columns: list[npt.NDArray[Any]] = [
        np.concatenate([found[0][column] for found in every]) for column in range(6)
    ]
    _, _, facets, tags, ids, points = columns
    if len(facets) == 0:
        raise ValueError("the mesh is closed: it has no boundary")
    order = np.lexsort([columns[1], columns[0]])  # as in the whole mesh
    ids, at = np.unique(ids, return_index=True)
    names = next((found[1] for found in every if found[1] is not None), None)
    mesh = SimplexMesh(
        points[at],
        np.searchsorted(ids, facets[order]),
        cell_tags=tags[order] if (tags >= 0).any() else None,
        tag_names=names,
    )
    return WholeBoundary(mesh, ids)


def displaced(part: PartitionedMesh, layers: int) -> IntArray:
    """Return a rank for each cell such that present interfaces lie inside parts; collective.

    Parts with fewer cells grow by some layers of cells into those with more; of equal ones, that of
    the lower rank.  One exchange for each layer.
    """
    comm = part.ranks
    counts = np.array(comm.allgather(part.n_cells))
    by_priority = np.lexsort((-np.arange(comm.size), -counts))  # the last one grows most
    priority = np.empty(comm.size)
    priority[by_priority] = np.arange(comm.size)
    of_cells = np.full(part.n_cells, priority[comm.rank])
    for _ in range(layers):
        of_nodes = np.full(part.n_points, -1.0)
        if part.n_cells:
            np.maximum.at(of_nodes, part.cells, of_cells[:, None])
        of_nodes = part.maximum(of_nodes)
        if part.n_cells:
            of_cells = of_nodes[part.cells].max(axis=1)
    return by_priority[of_cells.astype(np.int64)].astype(np.int32)


def balanced(part: PartitionedMesh) -> IntArray:
    """Return a rank for each cell such that all have about the same number; collective.

    Cells along a Morton curve are divided into pieces of equal length, to about 1 % of a share.
    """
    comm = part.ranks
    centroids = part.points[part.cells].mean(axis=1)
    low, high = centroids.min(axis=0, initial=np.inf), -centroids.max(axis=0, initial=-np.inf)
    ends = comm.allreduce(np.concatenate([low, high]), "min")
    width = float((-ends[part.dim :] - ends[: part.dim]).max())
    scale = (2**_BITS - 1) / width if width > 0.0 else 0.0
    steps = ((centroids - ends[: part.dim]) * scale).astype(np.int64)
    keys = np.zeros(len(steps), np.int64)
    for bit in range(_BITS):
        for axis in range(part.dim):
            keys |= ((steps[:, axis] >> bit) & 1) << (bit * part.dim + axis)
    count = min(1000, len(keys))  # keys that each rank contributes
    at = (np.arange(count) + 0.5) * len(keys) / max(count, 1)
    own = np.sort(keys)[at.astype(np.int64)]
    every = comm.allgather((own, np.full(count, len(keys) / max(count, 1))))
    samples = np.concatenate([keys for keys, _ in every])
    weights = np.concatenate([weights for _, weights in every])
    order = np.argsort(samples, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    cuts = np.searchsorted(share, np.arange(1, comm.size) / comm.size)
    ranks: IntArray = np.searchsorted(samples[order[cuts]], keys, side="left").astype(np.int32)
    return ranks


#: Name of the nodal field with the numbers of the nodes in the whole mesh.
NODE_NUMBERS = "GlobalPointIds"


class Piece(NamedTuple):
    """Some cells of a mesh."""

    mesh: SimplexMesh
    keys: Ids | None
    """Numbers >= 0 that identify the nodes in the whole mesh; None if only their coordinates do."""


def from_pieces(comm: Communicator, pieces: Sequence[Piece]) -> PartitionedMesh:
    """Return the mesh composed of pieces, of which each rank has any number; collective.

    Nodes of different pieces are the same if their keys are equal, or if some piece has no keys,
    if their coordinates are.
    """

    def check() -> list[Piece]:
        if by_points:
            return [Piece(piece.mesh, keys_of_points(piece.mesh.points)) for piece in pieces]
        return list(pieces)

    by_points = bool(comm.allreduce(int(any(p.keys is None for p in pieces)), "max"))
    own = comm.agree(check)
    nothing = None, np.empty(0, np.int64)
    held, keys = comm.agree(lambda: joined_pieces(own) if own else nothing)
    mesh = with_common_tags(comm, held)
    ids, owner = number_nodes(comm, keys)
    return PartitionedMesh(mesh, ids, owner, comm)


def joined_pieces(pieces: Sequence[Piece]) -> tuple[SimplexMesh, Ids]:
    """Return one or more pieces of this rank as one mesh, and the keys of its nodes."""
    meshes = [piece.mesh for piece in pieces]
    every = np.concatenate([piece.keys for piece in pieces if piece.keys is not None])
    keys, number = np.unique(every, return_inverse=True)
    numbers = np.split(number, np.cumsum([mesh.n_points for mesh in meshes])[:-1])
    rows = np.split(
        np.arange(sum(mesh.n_cells for mesh in meshes)),
        np.cumsum([mesh.n_cells for mesh in meshes])[:-1],
    )
    in_cells = any(mesh.cell_tags is not None for mesh in meshes)
    on_facets = any(mesh.tagged_facets is not None for mesh in meshes)
    at_nodes = set.intersection(*(set(mesh.point_data) for mesh in meshes)) - {NODE_NUMBERS}
    of_cells = set.intersection(*(set(mesh.cell_data) for mesh in meshes))
    alike = [
        replace(
            _tagged(mesh, in_cells, on_facets),
            point_data={k: v for k, v in mesh.point_data.items() if k in at_nodes},
            cell_data={k: v for k, v in mesh.cell_data.items() if k in of_cells},
        )
        for mesh in meshes
    ]
    return joined(list(zip(alike, numbers, rows, strict=True))), keys


def _tagged(mesh: SimplexMesh, in_cells: bool, on_facets: bool) -> SimplexMesh:
    """Return the mesh with the tags 0 in its cells, and no facets that are tagged, if missing."""
    added: dict[str, Any] = {}
    if in_cells and mesh.cell_tags is None:
        added["cell_tags"] = np.zeros(mesh.n_cells, np.int32)
    if on_facets and mesh.tagged_facets is None:
        added["tagged_facets"] = np.empty((0, mesh.cell_dim), np.int32)
        added["facet_tags"] = np.empty(0, np.int32)
    return replace(mesh, **added) if added else mesh


def with_common_tags(comm: Communicator, mesh: SimplexMesh | None) -> SimplexMesh | None:
    """Return the mesh in the dimension of all pieces, with tags if any piece has some.

    Files of meshes in the plane have z = 0.  A piece of a surface may lie in that plane by chance.
    """
    has_height = mesh is not None and mesh.dim == 3 and bool((mesh.points[:, 2] != 0.0).any())
    has_height |= mesh is not None and mesh.cell_dim == 3
    has_cells = mesh is not None and mesh.cell_tags is not None
    has_facets = mesh is not None and mesh.tagged_facets is not None
    given = comm.allreduce(np.array([has_height, has_cells, has_facets], np.int64), "max")
    if mesh is None:
        return None
    if mesh.dim == 3 and not given[0]:
        mesh = replace(mesh, points=mesh.points[:, :2])
    return _tagged(mesh, bool(given[1]), bool(given[2]))


def number_nodes(comm: Communicator, keys: Ids) -> tuple[Ids, IntArray]:
    """Return a global number, and the owner, of each node of this rank; collective.

    Numbers are consecutive from 0 in the order of the keys, so that keys without gaps are
    returned as they are.  The owner is the lowest rank that holds the node.  Two exchanges: the
    range of the keys is divided among the ranks, and each numbers the keys of its share.

    Parameters
    ----------
    comm : Communicator
    keys : int64[n]
        The same number >= 0 for the same node on all ranks; different numbers for different nodes.
    """
    largest = comm.allreduce(int(keys.max(initial=-1)), "max")
    share = largest // comm.size + 1

    def number(every: Ids, by: Ids) -> Ids:
        known, group = np.unique(every, return_inverse=True)
        owner = np.full(len(known), comm.size, np.int64)
        np.minimum.at(owner, group, by)
        counts = comm.allgather(len(known))
        return np.column_stack([group + sum(counts[: comm.rank]), owner[group]])

    found = comm.ask(keys, keys // share, number)
    return found[:, 0].copy(), found[:, 1].astype(np.int32)


def keys_of_points(points: FloatArray) -> Ids:
    """Return a number for each point that depends on its coordinates only.

    Raises
    ------
    ValueError
        If two points coincide.
    """
    keys = (hashes_of(points) >> np.uint64(1)).astype(np.int64)
    first, count = np.unique(keys, return_index=True, return_counts=True)[1:]
    twice = np.zeros(len(keys), bool)
    twice[first[count > 1]] = True
    refuse_where(
        "points",
        np.broadcast_to(twice[:, None], points.shape),
        points,
        "must differ from each other if nodes have no global numbers",
    )
    return keys
