"""Pieces of a mesh, read from files, as a partitioned mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.distributed.mesh import PartitionedMesh
from adaptsize.distributed.numbering import keys_of_points, number_nodes
from adaptsize.ranks import Communicator

Ids = npt.NDArray[np.int64]

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
    mesh, keys = comm.agree(lambda: _joined(own))
    mesh = _with_common_tags(comm, mesh)
    ids, owner = number_nodes(comm, keys)
    return PartitionedMesh(mesh, ids, owner, comm)


def _joined(pieces: Sequence[Piece]) -> tuple[SimplexMesh | None, Ids]:
    """Return the pieces of this rank as one mesh, and the keys of its nodes."""
    if not pieces:
        return None, np.empty(0, np.int64)
    meshes = [piece.mesh for piece in pieces]
    every = np.concatenate([piece.keys for piece in pieces if piece.keys is not None])
    keys, first, number = np.unique(every, return_index=True, return_inverse=True)
    ends = np.cumsum([mesh.n_points for mesh in meshes])
    numbers = np.split(number.astype(np.int32), ends[:-1])
    cells = [new[mesh.cells] for new, mesh in zip(numbers, meshes, strict=True)]
    common = {"point": set(meshes[0].point_data), "cell": set(meshes[0].cell_data)}
    for mesh in meshes:
        common["point"] &= set(mesh.point_data)
        common["cell"] &= set(mesh.cell_data)
    tagged: dict[str, Any] = {}
    if any(mesh.cell_tags is not None for mesh in meshes):
        tagged["cell_tags"] = np.concatenate([_cell_tags(mesh) for mesh in meshes])
    rows = [
        new[mesh.tagged_facets]
        for new, mesh in zip(numbers, meshes, strict=True)
        if mesh.tagged_facets is not None
    ]
    if rows:
        # A facet between two pieces may be in both.
        facets = np.concatenate(rows)
        once = np.sort(np.unique(np.sort(facets, axis=1), axis=0, return_index=True)[1])
        tags = [mesh.facet_tags for mesh in meshes if mesh.facet_tags is not None]
        tagged["tagged_facets"] = facets[once]
        tagged["facet_tags"] = np.concatenate(tags)[once]
    mesh = SimplexMesh(
        np.concatenate([mesh.points for mesh in meshes])[first],
        np.concatenate(cells),
        tag_names={key: name for mesh in meshes for key, name in mesh.tag_names.items()},
        point_data={
            name: np.concatenate([mesh.point_data[name] for mesh in meshes])[first]
            for name in meshes[0].point_data
            if name in common["point"] and name != NODE_NUMBERS
        },
        cell_data={
            name: np.concatenate([mesh.cell_data[name] for mesh in meshes])
            for name in meshes[0].cell_data
            if name in common["cell"]
        },
        **tagged,
    )
    return mesh, keys


def _cell_tags(mesh: SimplexMesh) -> npt.NDArray[np.int32]:
    return np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags


def _with_common_tags(comm: Communicator, mesh: SimplexMesh | None) -> SimplexMesh | None:
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
    added: dict[str, Any] = {}
    if given[1] and not has_cells:
        added["cell_tags"] = _cell_tags(mesh)
    if given[2] and not has_facets:
        added["tagged_facets"] = np.empty((0, mesh.cell_dim), np.int32)
        added["facet_tags"] = np.empty(0, np.int32)
    return replace(mesh, **added) if added else mesh
