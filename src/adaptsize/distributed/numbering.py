"""Global numbers and owners of nodes, from any numbers that identify the nodes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import refuse_where
from adaptsize.ranks import Communicator, split_rows
from adaptsize.typing import FloatArray, IntArray

Ids = npt.NDArray[np.int64]


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
    at = keys // share
    order = np.argsort(at, kind="stable")
    asked = comm.alltoallv(split_rows(keys, at, comm.size))
    every = np.concatenate(asked)
    by = np.repeat(np.arange(comm.size, dtype=np.int64), [len(part) for part in asked])
    known, group = np.unique(every, return_inverse=True)
    owner = np.full(len(known), comm.size, np.int64)
    np.minimum.at(owner, group, by)
    counts = comm.allgather(len(known))
    numbers = group + sum(counts[: comm.rank])
    answers = comm.alltoallv(split_rows(np.column_stack([numbers, owner[group]]), by, comm.size))
    found = np.empty((len(keys), 2), np.int64)
    found[order] = np.concatenate(answers)
    return found[:, 0].copy(), found[:, 1].astype(np.int32)


def keys_of_points(points: FloatArray) -> Ids:
    """Return a number for each point that depends on its coordinates only.

    Raises
    ------
    ValueError
        If two points coincide.
    """
    bits = (np.ascontiguousarray(points) + 0.0).view(np.uint64)  # -0.0 becomes 0.0
    key = np.zeros(len(points), np.uint64)
    for column in bits.T:
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(32)
    keys = (key >> np.uint64(1)).astype(np.int64)
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
