"""Sizes in a solid with many reflex edges: paths are propagated from node to node.

Nodes are processed in order of size, as in Dijkstra's algorithm.  Each one offers its path to its
neighbours: the same path, ended there instead, if its pieces are visible.  Nodes of reflex edges
also offer paths that bend there, and paths over their edges: from the point where the
path to the node starts, or, if that bends, from its last bend.  Such a bend stays where it is
best for this node.  Every size is that of a path that exists, so none is too small.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.exact_space import try_path
from adaptsize._kernels.heap import Heap, pop, push_or_decrease


class Relay(NamedTuple):
    """What is propagated, and to which nodes.

    Parameters
    ----------
    cells : int32[m, 4]
    ring_ptr, ring : int32[n + 1], int32[4 * m]
        Cells around each node.
    waits : bool[n]
        Nodes that take paths.
    row : int32[n]
        Number of each node of a reflex edge, -1 for others.
    first, edges : int32[k + 1], int32[p]
        The reflex edges at node number r are ``edges[first[r]:first[r + 1]]``.
    n_sources : int
        Base and straight path ``n_sources + r`` are those of node number r.
    used : int64[2]
        In/Out: number of paths and of bases in use; there is room for more.
    origin : int32[bases]
        In/Out: the source or node at the origin of each base.
    heap : Heap
        In/Out: nodes whose path is to be propagated.
    stamp : int32[n]
        Scratch, all -1.
    hidden : int32[n, 2]
        Scratch, all -1: the paths that have been found hidden from each node last.
    near : int64[k]
        Scratch for the nodes beside one.
    """

    cells: np.ndarray
    ring_ptr: np.ndarray
    ring: np.ndarray
    waits: np.ndarray
    row: np.ndarray
    first: np.ndarray
    edges: np.ndarray
    n_sources: int
    used: np.ndarray
    origin: np.ndarray
    heap: Heap
    stamp: np.ndarray
    hidden: np.ndarray
    near: np.ndarray


@lean
def _add_base(relay, paths, points, field, x, g):
    """Add the last bend of the path to node x as a base; return its number."""
    bases, new = paths.bases, relay.used[1]
    relay.used[1] += 1
    square = 0.0
    for d in range(3):
        bases.table[new, d] = bases.table[new, 3 + d] = bases.table[new, 6 + d] = field.last[x, d]
        square += (field.last[x, d] - points[x, d]) ** 2
    bases.table[new, 9] = field.sizes[x] - g * math.sqrt(square)
    bases.table[new, 10] = bases.table[new, 11] = math.inf
    bases.counts[new] = 1
    for v in range(3):
        bases.nodes[new, v] = -1
    relay.origin[new] = relay.origin[paths.base[field.path[x]]]
    return new


@lean
def _add_path(relay, paths, field, x, base, e, slack):
    """Add a path from a base over edge e at node x; return its number, -1 if there is none."""
    edges, table, w = paths.edges, paths.bases.table, relay.used[0]
    if w == paths.base.shape[0]:
        return np.int64(-1)
    several = paths.bases.counts[base] > 1
    place = square = 0.0
    for d in range(3):  # an edge or face: from where node x is reached
        start = field.last[x, d] if several else table[base, d]
        place += (start - edges.start[e, d]) * edges.along[e, d]
    for d in range(3):
        start = field.last[x, d] if several else table[base, d]
        square += (start - edges.start[e, d] - place * edges.along[e, d]) ** 2
    if square <= 100.0 * slack * slack:
        return np.int64(-1)
    relay.used[0] += 1
    paths.base[w], paths.parent[w], paths.edge[w] = base, 0, e
    paths.image[w, 0], paths.image[w, 1] = place, math.sqrt(square)
    # What an edge or face allows over the reflex edge is not bounded from below.
    paths.offset[w] = -math.inf if several else table[base, 9]
    paths.sector[w] = 0.0
    paths.skew[w] = several
    paths.part[w, 0], paths.part[w, 1] = 0.0, edges.length[e]
    return w


@lean
def _offers_of(relay, paths, points, field, x, g, slack, offers):
    """List the paths that node x offers; return their number."""
    w, r, n = np.int64(field.path[x]), relay.row[x], 1
    offers[0] = w
    if r < 0:
        return n
    straight = relay.n_sources + r
    paths.bases.table[straight, 9] = paths.offset[straight] = field.sizes[x]
    offers[n], n = straight, n + 1
    base = np.int64(paths.base[w])
    for k in range(relay.first[r], relay.first[r + 1]):
        e = relay.edges[k]
        if e == paths.edge[w] or n == offers.shape[0]:
            continue
        if paths.edge[w] >= 0 and base == paths.base[w]:
            if relay.used[1] == relay.origin.shape[0]:
                break
            base = np.int64(_add_base(relay, paths, points, field, x, g))
        new = _add_path(relay, paths, field, x, base, e, slack)
        if new >= 0:
            offers[n], n = new, n + 1
    return n


@lean
def _waiting_around(relay, points, field, x, g, count):
    """List the nodes beside x that wait for paths which it may lower; return their number."""
    n, size = 0, field.sizes[x]
    for r in range(relay.ring_ptr[x], relay.ring_ptr[x + 1]):
        for v in range(4):
            y = np.int64(relay.cells[relay.ring[r], v])
            if not relay.waits[y] or relay.stamp[y] == count or y == x:
                continue
            relay.stamp[y] = count
            square = 0.0
            for d in range(3):
                square += (points[y, d] - points[x, d]) ** 2
            # By the triangle inequality no path over x allows y less than this.
            if size - g * math.sqrt(square) < field.sizes[y]:
                relay.near[n] = y
                n += 1
    return n


@lean
def _put_near(relay, points, field, w, start, count, block):
    """Put nodes beside one into a block; those from which path w is known to be hidden get -inf."""
    for i in range(count):
        y = relay.near[start + i]
        for d in range(3):
            block.bends[0, d, i] = points[y, d]
        block.path[i], block.nodes[0, i] = -1, y
        is_hidden = relay.hidden[y, 0] == w or relay.hidden[y, 1] == w
        block.sizes[i] = -math.inf if is_hidden else field.sizes[y]


@lean
def _remember_hidden(relay, field, w, start, count, block):
    """Remember where path w, just tried, would be shorter but is hidden; restore the sizes."""
    for i in range(count):
        y = relay.near[start + i]
        if block.path[i] == w:
            continue
        if block.sizes[i] > block.values[i]:
            relay.hidden[y, 1] = relay.hidden[y, 0]
            relay.hidden[y, 0] = w
        block.sizes[i] = field.sizes[y]


@lean
def _along_edges(relay, points, field, x, path, g, start, count, block):
    """Lower nodes beside x by paths along edges of the mesh, which nothing hides."""
    for i in range(count):
        y, square = relay.near[start + i], 0.0
        for d in range(3):
            square += (points[y, d] - points[x, d]) ** 2
        value = field.sizes[x] + g * math.sqrt(square)
        if value < block.sizes[i]:
            block.sizes[i], block.path[i] = value, path
            for d in range(3):
                block.last[d, i] = points[x, d]


@lean_kernel
def propagate(relay, paths, field, sight, g, faces, block):
    """Hand paths on until no size is lowered any more (In/Out: relay, paths, field).

    ``faces``: None if all bases are nodes, as in `lower_by_paths`.
    """
    points, offers = sight.stars.points, block.queue
    count = 0
    while relay.heap.size[0] > 0:
        x = pop(relay.heap)
        count += 1
        beside = _waiting_around(relay, points, field, x, g, count)
        if beside == 0:
            continue
        n = _offers_of(relay, paths, points, field, x, g, sight.walls.slack, offers)
        for start in range(0, beside, BLOCK):
            here = min(BLOCK, beside - start)
            _put_near(relay, points, field, offers[0], start, here, block)
            for k in range(n):
                if k == 1:  # from x itself
                    _along_edges(relay, points, field, x, offers[1], g, start, here, block)
                    continue
                try_path(paths, offers[k], here, sight, g, faces, block)
                if k == 0:  # all nodes around offer the same one
                    _remember_hidden(relay, field, offers[0], start, here, block)
            for i in range(here):
                y = relay.near[start + i]
                if block.sizes[i] < field.sizes[y]:
                    field.sizes[y], field.path[y] = block.sizes[i], block.path[i]
                    for d in range(3):
                        field.last[y, d] = block.last[d, i]
                    push_or_decrease(relay.heap, y, field.sizes[y])
