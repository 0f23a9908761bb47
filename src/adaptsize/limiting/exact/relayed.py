"""Paths in a solid with many reflex edges, propagated from node to node."""

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.heap import new_heap, push_all
from adaptsize._kernels.space_paths import Bases, Field, Paths, new_block
from adaptsize._kernels.space_relay import Relay, propagate
from adaptsize.background.topology import places_among
from adaptsize.limiting.exact.network import Network
from adaptsize.limiting.exact.solid import WholeSolid
from adaptsize.typing import BoolArray


def propagate_paths(known: WholeSolid, network: Network, field: Field, proved: BoolArray) -> None:
    """Lower nodes (In/Out: field) from which their smallest source is not visible, approximately.

    Each node is reached by a path of one of its neighbours, or by one that bends there: see
    `adaptsize._kernels.space_relay`.  This takes a few microseconds a node.
    """
    mesh, reflex, paths, m = known.mesh, network.reflex_edges, network.paths, network.n_sources
    n, k = mesh.n_points, len(reflex.nodes)
    # Nodes that keep their bounds are straight paths, too.
    at = paths.bases.nodes[:m, 0]
    single = np.flatnonzero((paths.bases.counts[:m] == 1) & (at >= 0))
    given = field.path.copy()
    own = np.full(n, -1, np.int32)
    own[at[single]] = single
    kept = proved & (field.path < 0)
    field.path[kept] = own[kept]
    field.last[kept] = network.sight.stars.points[kept]
    beside = np.zeros(n, np.bool_)
    beside[mesh.cells[~proved[mesh.cells].all(axis=1)]] = True
    seeds = np.flatnonzero((beside | ~proved) & (field.path >= 0) & np.isfinite(field.sizes))
    n_edges = max(1, len(reflex.edges.length))
    pairs = reflex.pieces.nodes.ravel().astype(np.int64) * n_edges
    at_node, edges = np.divmod(np.unique(pairs + np.repeat(reflex.pieces.edge, 2)), n_edges)
    first = np.concatenate([[0], np.cumsum(np.bincount(at_node, minlength=k))])
    room = 4 * len(edges) + 16
    more = Bases(*(_with_room(array, room) for array in paths.bases))
    longer = Paths(more, paths.edges, *(_with_room(array, room) for array in paths[2:]))
    relay = Relay(
        mesh.cells,
        *mesh.rings,
        ~proved,
        places_among(reflex.nodes, n),
        first.astype(np.int32),
        edges.astype(np.int32),
        m,
        np.array([len(paths.base), len(paths.bases.counts)]),
        _with_room(network.origin, room),
        new_heap(n),
        np.full(n, -1, np.int32),
        np.full((n, 2), -1, np.int32),
        np.empty(3 * int(np.diff(mesh.rings[0]).max()), np.int64),
    )
    push_all(relay.heap, seeds, field.sizes)
    propagate(relay, longer, field, network.sight, network.g, network.faces, new_block())
    network.paths, network.origin = longer, relay.origin
    field.path[kept] = given[kept]


def _with_room(array: npt.NDArray[Any], room: int) -> npt.NDArray[Any]:
    """Return a longer copy of an array; the new rows are not written."""
    longer = np.empty((len(array) + room, *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer
