"""The cells of other ranks around the nodes of a rank, and nodal values there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.simplex import SimplexMesh
from adaptsize.ranks import Ids
from adaptsize.typing import FloatArray, IntArray


class Surroundings(NamedTuple):
    """The cells at the nodes of a rank, and all cells at the nodes of these."""

    mesh: SimplexMesh | None
    """Nodes and cells in the order of the whole mesh, with regions; None without local cells."""
    own: IntArray
    """int32[n_local]: the local nodes."""
    ids: Ids
    """Number of each node in the whole mesh."""
    owner: IntArray
    """The rank that owns each node."""

    def values(self, part: PartitionedMesh, own: FloatArray) -> FloatArray:
        """Return nodal values on ``mesh``, given those at the local nodes; two exchanges."""
        order = np.argsort(part.global_ids)
        every = np.zeros((len(self.ids), *own.shape[1:]))
        every[self.own] = own
        far = np.ones(len(self.ids), np.bool_)
        far[self.own] = False

        def answer(ids: Ids, _: Ids) -> FloatArray:
            return own[order[np.searchsorted(part.global_ids[order], ids)]]

        every[far] = part.ranks.ask(self.ids[far], self.owner[far], answer)
        return every


class _Cells(NamedTuple):
    """Cells with their numbers and nodes in the whole mesh."""

    numbers: Ids
    nodes: Ids
    """int64[m, k + 1]"""
    places: FloatArray
    """float64[m, k + 1, dim]"""
    owners: IntArray
    """int32[m, k + 1]: the ranks that own the nodes."""
    tags: IntArray
    """int32[m]: the regions; 0 where a rank knows of none."""

    def with_any(self, nodes: Ids) -> _Cells:
        """Return the cells that have one of some nodes."""
        found = np.flatnonzero(np.isin(self.nodes, nodes).any(axis=1))
        return _Cells._make(column[found] for column in self)


def surroundings_of(part: PartitionedMesh) -> Surroundings:
    """Return the cells around the nodes of this rank; collective.

    Two exchanges.  In the first one, ranks send the cells at shared nodes.  Each rank then knows
    all cells at its own nodes, and sends those at the nodes of the cells that it sent before.
    """
    ids, cells = part.global_ids, part.cells
    known = _Cells(part.cell_ids, ids[cells], part.points[cells], part.owner[cells], _tags(part))
    wanted = [ids[nodes] for nodes in part.shared.nodes]
    for _ in range(2):
        sent = [known.with_any(nodes) for nodes in wanted]
        wanted = [np.unique(cells.nodes) for cells in sent]
        parts = zip(known, *part.ranks.alltoall(sent), strict=True)
        every = _Cells._make(np.concatenate(column) for column in parts)
        once = np.unique(every.numbers, return_index=True)[1]  # in the order of the whole mesh
        known = _Cells._make(column[once] for column in every)
    numbers, at = np.unique(np.append(known.nodes.ravel(), ids), return_index=True)
    own = np.searchsorted(numbers, ids).astype(np.int32)
    owner = np.append(known.owners.ravel(), part.owner)[at]
    if part.mesh is None:
        return Surroundings(None, own, numbers, owner)
    points = np.concatenate([known.places.reshape(-1, part.dim), part.points])[at]
    mesh = SimplexMesh(points, np.searchsorted(numbers, known.nodes), cell_tags=known.tags)
    return Surroundings(mesh, own, numbers, owner)


def _tags(part: PartitionedMesh) -> IntArray:
    """Return the region of each cell of a rank, 0 if there are none."""
    if part.mesh is None or part.mesh.cell_tags is None:
        return np.zeros(part.n_cells, np.int32)
    return part.mesh.cell_tags
