"""Paths over reflex edges in space: data, scratch for the search (see exact_space.py), and lengths.

The shortest path over a chain of straight edges is found by moving one bend after the other.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.space_sight import CACHED
from adaptsize._kernels.trees import DEPTH

#: Largest number of edges of a path.
LONGEST = 12

#: Lower bounds are lowered by this share, so that rounding discards no path.  The allowed size is
#: then the minimum over the same paths, whatever the order in which they are tested.
PATH_SLACK = 1.0 - 1e-12

# Times that the bends of a path are moved, at most.
_SWEEPS = 200


class Edges(NamedTuple):
    """Straight reflex edges.

    Parameters
    ----------
    start : float64[e, 3]
    along : float64[e, 3]
        Unit vectors.
    length : float64[e]
    normals : float64[e, 2, 3]
        Outward normals of the two faces.
    """

    start: np.ndarray
    along: np.ndarray
    length: np.ndarray
    normals: np.ndarray


class Bases(NamedTuple):
    """Sources and nodes of reflex edges, from which paths start.

    Parameters
    ----------
    table : float64[b, 12]
        Vertices of each and sizes there (see exact.py).
    counts : int8[b]
        1, 2 or 3 vertices.
    nodes : int32[b, 3]
        Their numbers, padded with -1.
    """

    table: np.ndarray
    counts: np.ndarray
    nodes: np.ndarray


class Paths(NamedTuple):
    """Paths without their last piece.  Path b < len(bases.counts) is straight from base b.

    Parameters
    ----------
    bases : Bases
    edges : Edges
    base : int32[w]
    parent : int32[w]
        The path that is extended over one more edge, -1 for straight ones.
    edge : int32[w]
        That edge, -1 for straight ones.
    image : float64[w, 2]
        Place along the edge, and distance from it, of the base as turned.
    offset : float64[w]
        Size at the image of the base, or a lower bound if the base is not a node.
    sector : float64[w, 9]
        Three vectors.  The path acts on points x for which the product of the first and (x
        - start of the edge) is not positive, and that of one of the others is not negative, to
        the tolerance of `beside_edge`.
    skew : bool[w]
        Whether two successive edges are not in one plane, or the base is not a node.
    part : float64[w, 2]
        Part of the last edge outside of which the path does not bend: others are shorter there.
    """

    bases: Bases
    edges: Edges
    base: np.ndarray
    parent: np.ndarray
    edge: np.ndarray
    image: np.ndarray
    offset: np.ndarray
    sector: np.ndarray
    skew: np.ndarray
    part: np.ndarray


class Choice(NamedTuple):
    """Paths to be tested, along a Morton curve.

    Parameters
    ----------
    paths : int32[c]
    boxes : float64[2 * n_leaves, 7]
        The tree over them (see trees.py).
    """

    paths: np.ndarray
    boxes: np.ndarray


class Field(NamedTuple):
    """Sizes and the paths that determine them.

    Parameters
    ----------
    sizes : float64[n]
    path : int32[n]
        -1 for none.
    last : float64[n, 3]
        The previous point of the path.
    """

    sizes: np.ndarray
    path: np.ndarray
    last: np.ndarray


class Block(NamedTuple):
    """Nodes of a block, and paths to them.

    Parameters
    ----------
    box : float64[6]
        Around the points.
    nodes : int64[3, BLOCK]
        Row 0 the points as nodes of the mesh, the others -1.
    sizes : float64[BLOCK]
    path : int64[BLOCK]
        The path that lowered each point, -1 if none.
    last : float64[3, BLOCK]
        The previous point of each path.
    bends : float64[LONGEST + 2, 3, BLOCK]
        The points, the bends of one path to them, and its base.
    support : int64[3, BLOCK]
        Nodes around the point in the base, padded with -1.
    values : float64[BLOCK]
        Sizes that the path allows.
    active : int64[BLOCK]
        Active points.
    starts : float64[BLOCK]
        Sizes at the bases.
    chain : int64[LONGEST + 2]
        Edges of a path, from its end.
    work : float64[4, LONGEST + 2]
    shaft : float64[18]
    stack : int64[2, DEPTH]
        Boxes of paths, and of triangles.
    queue : int64[2 * BLOCK]
        Paths to be tested.
    cached : int64[CACHED]
        Recently blocking triangles, padded with -1.
    recent : int64[BLOCK]
        Paths that lowered the points of the last block, -1 for none.
    """

    box: np.ndarray
    nodes: np.ndarray
    sizes: np.ndarray
    path: np.ndarray
    last: np.ndarray
    bends: np.ndarray
    support: np.ndarray
    values: np.ndarray
    active: np.ndarray
    starts: np.ndarray
    chain: np.ndarray
    work: np.ndarray
    shaft: np.ndarray
    stack: np.ndarray
    queue: np.ndarray
    cached: np.ndarray
    recent: np.ndarray


def new_block() -> Block:
    """Return scratch for one thread."""
    return Block(
        np.empty(6),
        np.full((3, BLOCK), -1, np.int64),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty((3, BLOCK)),
        np.empty((LONGEST + 2, 3, BLOCK)),
        np.empty((3, BLOCK), np.int64),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK),
        np.empty(LONGEST + 2, np.int64),
        np.empty((4, LONGEST + 2)),
        np.empty(18),
        np.empty((2, DEPTH), np.int64),
        np.empty(2 * BLOCK, np.int64),
        np.full(CACHED, -1, np.int64),
        np.full(BLOCK, -1, np.int64),
    )


@lean
def length_between(bends, level, i):
    """Return the distance from bends[level] to bends[level + 1] of the path to point i."""
    square = 0.0
    for d in range(3):
        square += (bends[level, d, i] - bends[level + 1, d, i]) ** 2
    return math.sqrt(square)


@lean
def length_from(bends, last, i):
    """Return the length of the path from bends[last] to bends[0]."""
    total = 0.0
    for level in range(last):
        total += length_between(bends, level, i)
    return total


@lean
def straighten(edges, chain, bends, n, i):
    """Move the n bends of the path to point i, each in turn, to where the path is shortest.

    The length is a convex function of the bends.  Between its neighbours, turned about the edge
    into one plane, a path over one edge is straight.  Returns whether the path became shorter.
    """
    first = length = length_from(bends, n + 1, i)
    for _ in range(_SWEEPS):
        for level in range(1, n + 1):
            e = chain[level]
            s = f = d2 = r2 = 0.0
            for k in range(3):
                x, y = bends[level - 1, k, i], bends[level + 1, k, i]
                s += (x - edges.start[e, k]) * edges.along[e, k]
                f += (y - edges.start[e, k]) * edges.along[e, k]
            for k in range(3):
                x, y = bends[level - 1, k, i], bends[level + 1, k, i]
                d2 += (x - edges.start[e, k] - s * edges.along[e, k]) ** 2
                r2 += (y - edges.start[e, k] - f * edges.along[e, k]) ** 2
            d, r = math.sqrt(d2), math.sqrt(r2)
            t = (f * d + s * r) / (d + r) if d + r > 0.0 else s
            t = min(max(t, 0.0), edges.length[e])
            for k in range(3):
                bends[level, k, i] = edges.start[e, k] + t * edges.along[e, k]
        before, length = length, length_from(bends, n + 1, i)
        if length >= before * (1.0 - 1e-14):
            break
    return length < first * (1.0 - 1e-14)


@lean
def beside_edge(d, r, slack):
    """Return how far a straight line from distance r before an edge to d behind it is beside it.

    Faces hide what is behind them also from a line that passes some ``slack`` beside their edge.
    The path that bends there has the same length but for rounding.
    """
    return 4.0 * slack * (1.0 + d / max(r, 1e-300))


@lean
def in_sector(paths, w, box, slack):
    """Return whether a path may act on a point of a box."""
    e = paths.edge[w]
    if e < 0:
        return True
    least = first = second = square = 0.0
    for d in range(3):
        low, high = box[d] - paths.edges.start[e, d], box[3 + d] - paths.edges.start[e, d]
        n, a, b = paths.sector[w, d], paths.sector[w, 3 + d], paths.sector[w, 6 + d]
        least += n * low if n > 0.0 else n * high
        first += a * high if a > 0.0 else a * low
        second += b * high if b > 0.0 else b * low
        square += max(-low, high) ** 2
    near = beside_edge(math.sqrt(square), paths.image[w, 1], slack)
    return least <= slack and max(first, second) >= -near


@lean
def promise_of(boxes, b, x, sizes, count, g):
    """Return the number of points of a block that the paths in box b may lower.

    The test uses the points of the block, since sizes within a block differ by more than the
    paths to one point do.
    """
    value = boxes[b, 6]
    lx, ly, lz = boxes[b, 0], boxes[b, 1], boxes[b, 2]
    hx, hy, hz = boxes[b, 3], boxes[b, 4], boxes[b, 5]
    found = 0
    if value == math.inf:
        return found
    for i in range(count):
        dx = max(lx - x[0, i], x[0, i] - hx, 0.0)
        dy = max(ly - x[1, i], x[1, i] - hy, 0.0)
        dz = max(lz - x[2, i], x[2, i] - hz, 0.0)
        bound = value + g * math.sqrt(dx * dx + dy * dy + dz * dz)
        found += 1 if PATH_SLACK * bound <= sizes[i] else 0
    return found
