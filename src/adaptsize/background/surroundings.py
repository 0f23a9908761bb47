"""The cells of other ranks around the nodes of a rank, and nodal values there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.simplex import SimplexMesh
from adaptsize.ranks import Ids
from adaptsize.typing import FloatArray, IndexArray, IntArray


class Surroundings(NamedTuple):
    """The cells at the nodes of a rank, and all cells at the nodes of these."""

    mesh: SimplexMesh | None
    """Nodes and cells in the order of the whole mesh; None on a rank without cells."""
    own: IntArray
    """int32[n_local]: the local nodes."""
    sent: list[list[IntArray]]
    """For each of two exchanges and each rank, the nodes whose values it gets from this one."""
    received: list[list[IntArray]]
    """The nodes whose values this rank gets."""

    def values(self, part: PartitionedMesh, own: FloatArray) -> FloatArray:
        """Return nodal values on ``mesh``, given those at the local nodes; two exchanges."""
        n = 0 if self.mesh is None else self.mesh.n_points
        every = np.zeros((n, *own.shape[1:]))
        every[self.own] = own
        for sent, received in zip(self.sent, self.received, strict=True):
            found = part.ranks.alltoallv([every[nodes] for nodes in sent])
            for nodes, values in zip(received, found, strict=True):
                every[nodes] = values
        return every


class _Cells(NamedTuple):
    """Cells with their numbers and nodes in the whole mesh."""

    numbers: Ids
    nodes: Ids
    """int64[m, k + 1]"""
    places: FloatArray
    """float64[m, k + 1, dim]"""

    def with_any(self, nodes: Ids) -> _Cells:
        """Return the cells that have one of some nodes."""
        found = np.flatnonzero(np.isin(self.nodes, nodes).any(axis=1))
        return _Cells(self.numbers[found], self.nodes[found], self.places[found])


def surroundings_of(part: PartitionedMesh) -> Surroundings:
    """Return the cells around the nodes of this rank; collective.

    Two exchanges.  In the first one, ranks send the cells at shared nodes.  Each rank then knows
    all cells at its own nodes, and sends those at the nodes of the cells that it sent before.
    """
    comm, ids = part.ranks, part.global_ids
    known = _Cells(part.cell_ids, ids[part.cells], part.points[part.cells])
    wanted = [ids[nodes] for nodes in part.shared.nodes]
    named: list[list[Ids]] = []
    got: list[list[Ids]] = []
    for _ in range(2):
        sent = [known.with_any(nodes) for nodes in wanted]
        received: list[_Cells] = comm.alltoall(sent)
        named.append([np.unique(cells.nodes) for cells in sent])
        got.append([np.unique(cells.nodes) for cells in received])
        wanted = named[-1]
        known = _merged([known, *received])
    if part.mesh is None:
        none = [[np.empty(0, np.int32)] * comm.size] * 2
        return Surroundings(None, np.empty(0, np.int32), none, none)
    every, at = np.unique(np.append(known.nodes.ravel(), ids), return_index=True)
    points = np.concatenate([known.places.reshape(-1, part.dim), part.points])[at]
    mesh = SimplexMesh(points, np.searchsorted(every, known.nodes))

    def local(lists: list[list[Ids]]) -> list[list[IntArray]]:
        return [[np.searchsorted(every, own).astype(np.int32) for own in row] for row in lists]

    own = np.searchsorted(every, ids).astype(np.int32)
    return Surroundings(mesh, own, local(named), local(got))


def _merged(parts: list[_Cells]) -> _Cells:
    """Return all cells once, in the order of the whole mesh."""
    numbers, nodes, places = (np.concatenate(column) for column in zip(*parts, strict=True))
    unique: tuple[Ids, IndexArray] = np.unique(numbers, return_index=True)
    return _Cells(unique[0], nodes[unique[1]], places[unique[1]])
