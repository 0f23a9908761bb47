"""Paths over reflex edges in space: data, scratch for the search (see exact_space.py), and lengths.

The shortest path over a chain of straight edges is found by Newton's method.
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


class Ways(NamedTuple):
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
    shade : float64[w, 9]
        Three vectors.  The path acts on points x for which the product of the first and (x
        - start of the edge) is not positive, and that of one of the others is not negative.
    skew : bool[w]
        Whether two successive edges are not in one plane.
    """

    bases: Bases
    edges: Edges
    base: np.ndarray
    parent: np.ndarray
    edge: np.ndarray
    image: np.ndarray
    offset: np.ndarray
    shade: np.ndarray
    skew: np.ndarray


class Choice(NamedTuple):
    """Paths to be tested, along a Morton curve.

    Parameters
    ----------
    ways : int32[c]
    boxes : np.ndarray
    n_leaves : int
    """

    ways: np.ndarray
    boxes: np.ndarray
    n_leaves: int


class Field(NamedTuple):
    """Sizes and the paths that determine them.

    Parameters
    ----------
    sizes : float64[n]
    way : int32[n]
        -1 for none.
    last : float64[n, 3]
        The previous point of the path.
    """

    sizes: np.ndarray
    way: np.ndarray
    last: np.ndarray


class Block(NamedTuple):
    """Points of a block, and paths to them.

    Parameters
    ----------
    box : float64[6]
        Around the points.
    nodes : int64[3, BLOCK]
        Row 0 nodes of the mesh, -1 for other points; else -1.
    sizes : float64[BLOCK]
    way : int64[BLOCK]
        The path that lowered each point, -1 if none.
    last : float64[3, BLOCK]
        The previous point of each path.
    feet : float64[LONGEST + 2, 3, BLOCK]
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
    shaft : float64[12]
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
    way: np.ndarray
    last: np.ndarray
    feet: np.ndarray
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
        np.empty(12),
        np.empty((2, DEPTH), np.int64),
        np.empty(2 * BLOCK, np.int64),
        np.full(CACHED, -1, np.int64),
        np.full(BLOCK, -1, np.int64),
    )


@lean
def _put_on_edge(edges, e, t, feet, level, i):
    for d in range(3):
        feet[level, d, i] = edges.start[e, d] + t * edges.along[e, d]


@lean
def length_between(feet, level, i):
    """Return the distance from feet[level] to feet[level + 1] of the path to point i."""
    square = 0.0
    for d in range(3):
        square += (feet[level, d, i] - feet[level + 1, d, i]) ** 2
    return math.sqrt(square)


@lean
def length_from(feet, last, i):
    """Return the length of the path from feet[last] to feet[0]."""
    total = 0.0
    for level in range(last):
        total += length_between(feet, level, i)
    return total


@lean
def _newton_step(edges, chain, feet, work, n, i, longest):
    """Put a step of Newton's method for the n bends of the path to point i into work[0].

    The Hessian of the length is tridiagonal.  work[1] and work[2] are its diagonal and
    off-diagonal; work[3] are the coordinates of the bends along their edges.

    Returns the length; inf if there is no step, or if the path, whose length is convex, remains
    longer than ``longest`` wherever it bends.
    """
    for level in range(1, n + 1):
        e = chain[level]
        work[0, level] = work[1, level] = work[3, level] = 0.0
        for d in range(3):
            work[3, level] += (feet[level, d, i] - edges.start[e, d]) * edges.along[e, d]
    total = 0.0
    for level in range(n + 1):  # the pieces from feet[level] to feet[level + 1]
        length = length_between(feet, level, i)
        if length == 0.0:
            return math.inf
        total += length
        near = far = cross = 0.0
        for d in range(3):
            unit = (feet[level + 1, d, i] - feet[level, d, i]) / length
            if level > 0:
                near += unit * edges.along[chain[level], d]
            if level < n:
                far += unit * edges.along[chain[level + 1], d]
            if 0 < level < n:
                cross += edges.along[chain[level], d] * edges.along[chain[level + 1], d]
        if level > 0:
            work[0, level] += near
            work[1, level] += (1.0 - near * near) / length
        if level < n:
            work[0, level + 1] -= far
            work[1, level + 1] += (1.0 - far * far) / length
            work[2, level + 1] = (near * far - cross) / length if level > 0 else 0.0
    least = total
    for level in range(1, n + 1):
        fall, t = work[0, level], work[3, level]
        least -= max(fall * (edges.length[chain[level]] - t), -fall * t)
    # Lengths above the longest useful one by this factor are so despite rounding.
    if least > longest * (1.0 + 1e-12):
        return math.inf
    for level in range(1, n + 1):
        if level > 1:
            share = work[2, level] / work[1, level - 1]
            work[1, level] -= share * work[2, level]
            work[0, level] -= share * work[0, level - 1]
        if not work[1, level] > 0.0:
            return math.inf
    for level in range(n, 0, -1):
        if level < n:
            work[0, level] -= work[2, level + 1] * work[0, level + 1]
        work[0, level] /= work[1, level]
    return total


@lean
def straighten(edges, chain, feet, work, n, i, longest):
    """Move the n bends of the path to point i to where it is shortest.

    Stops early if the path cannot become shorter than ``longest``.
    """
    # Largest number of steps of Newton's method.
    for _ in range(8):
        length = _newton_step(edges, chain, feet, work, n, i, longest)
        if length == math.inf:
            return
        share, new = 1.0, math.inf
        for _ in range(4):
            for level in range(1, n + 1):
                e = chain[level]
                t = min(max(work[3, level] + share * work[0, level], 0.0), edges.length[e])
                _put_on_edge(edges, e, t, feet, level, i)
            new = length_from(feet, n + 1, i)
            if new <= length:
                break
            share *= 0.25
        if new > length:
            for level in range(1, n + 1):
                _put_on_edge(edges, chain[level], work[3, level], feet, level, i)
        if new >= length * (1.0 - 1e-15):
            return
