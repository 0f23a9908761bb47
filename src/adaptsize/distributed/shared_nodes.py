"""Nodes that several ranks hold."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.distributed.communicator import Communicator, split_rows
from adaptsize.typing import IntArray


class SharedNodes(NamedTuple):
    """For each rank, the local nodes that it holds too."""

    nodes: list[IntArray]
    """Local nodes, ascending in their global numbers, on both ranks; empty for the own rank."""
    every: IntArray
    """All local nodes that another rank holds."""

    def merge(
        self, comm: Communicator, values: npt.NDArray[Any], merge: np.ufunc
    ) -> npt.NDArray[Any]:
        """Return nodal values, those of shared nodes merged in order of rank; one exchange."""
        received = comm.alltoallv([values[nodes] for nodes in self.nodes])
        merged = values.copy()
        if merge.identity is not None:
            merged[self.every] = merge.identity
        for rank in range(comm.size):
            nodes, found = self.nodes[rank], received[rank]
            if rank == comm.rank:
                nodes, found = self.every, values[self.every]
            merged[nodes] = merge(merged[nodes], found)
        return merged


def find_shared_nodes(
    comm: Communicator, global_ids: npt.NDArray[np.int64], owner: IntArray
) -> SharedNodes:
    """Return the shared nodes; two exchanges.

    Raises
    ------
    ValueError
        On all ranks, if the owner of a node does not hold it.
    """
    order = np.argsort(global_ids, kind="stable")
    ids = global_ids[order]
    away = np.flatnonzero(owner != comm.rank)
    asked = comm.alltoallv(split_rows(global_ids[away], owner[away], comm.size))
    wanted = np.concatenate(asked)
    by = np.repeat(np.arange(comm.size), [len(part) for part in asked])

    def check() -> None:
        known = np.isin(wanted, global_ids[owner == comm.rank])
        if not known.all():
            first = int(np.argmin(known))
            raise ValueError(
                f"owner must be a rank that holds and owns the node, "
                f"but rank {by[first]} names this rank for global node {wanted[first]}"
            )

    comm.agree(check)
    # Pairs of a node and a rank that holds it, including the owner.
    held = np.unique(wanted)
    node = np.concatenate([wanted, held])
    rank = np.concatenate([by, np.full(len(held), comm.rank)])
    sort = np.lexsort((rank, node))
    node, rank = node[sort], rank[sort]
    counts = np.bincount(np.searchsorted(held, node), minlength=len(held))
    # Each holder of a node gets all holders of it.
    start = np.repeat(np.cumsum(counts) - counts, counts**2)
    within = np.arange(len(start)) - np.repeat(np.cumsum(counts**2) - counts**2, counts**2)
    width = np.repeat(counts, counts**2)
    receiver, holder = start + within // width, start + within % width
    pairs = np.column_stack([node[receiver], rank[holder]])
    pairs = pairs[receiver != holder]
    receiver = receiver[receiver != holder]
    received = np.concatenate(comm.alltoallv(split_rows(pairs, rank[receiver], comm.size)))
    local = order[np.searchsorted(ids, received[:, 0])].astype(np.int32)
    sort = np.lexsort((received[:, 0], received[:, 1]))
    nodes = split_rows(local[sort], received[sort, 1], comm.size)
    return SharedNodes(nodes, np.unique(local))
