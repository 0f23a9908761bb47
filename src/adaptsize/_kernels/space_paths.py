"""Data of paths over reflex edges, and scratch for the search among them (see exact_space.py)."""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.exact import BLOCK
from adaptsize._kernels.space_bends import LONGEST, Edges
from adaptsize._kernels.space_sight import CACHED
from adaptsize._kernels.trees import DEPTH


class Bases(NamedTuple):
    """Sources and nodes of reflex edges, from which paths start."""

    table: np.ndarray
    """float64[b, 12]: vertices of each and sizes there (see exact.py)."""
    counts: np.ndarray
    """int8[b]: 1, 2 or 3 vertices."""
    nodes: np.ndarray
    """int32[b, 3]: their numbers, padded with -1."""


class Ways(NamedTuple):
    """Paths without their last piece.  Path b < len(bases.counts) is straight from base b."""

    bases: Bases
    edges: Edges
    base: np.ndarray
    """int32[w]"""
    parent: np.ndarray
    """int32[w]: the path that is extended over one more edge, -1 for straight ones."""
    edge: np.ndarray
    """int32[w]: that edge, -1 for straight ones."""
    image: np.ndarray
    """float64[w, 2]: place along the edge, and distance from it, of the base as turned."""
    offset: np.ndarray
    """float64[w]: size at the image of the base, or a lower bound if the base is not a node."""
    shade: np.ndarray
    """float64[w, 9]: three vectors.  The path acts on points x for which the product of the first
    and (x - start of the edge) is not positive, and that of one of the others is not negative."""
    skew: np.ndarray
    """bool[w]: whether two successive edges are not in one plane."""


class Choice(NamedTuple):
    """Paths to be tested, along a Morton curve."""

    ways: np.ndarray
    """int32[c]"""
    boxes: np.ndarray
    n_leaves: int


class Field(NamedTuple):
    """Sizes and the paths that determine them."""

    sizes: np.ndarray
    """float64[n]"""
    way: np.ndarray
    """int32[n]: -1 for none."""
    last: np.ndarray
    """float64[n, 3]: the previous point of the path."""


class Block(NamedTuple):
    """Points of a block, and paths to them."""

    box: np.ndarray
    """float64[6]: around the points."""
    nodes: np.ndarray
    """int64[3, BLOCK]: row 0 nodes of the mesh, -1 for other points; else -1."""
    sizes: np.ndarray
    """float64[BLOCK]"""
    way: np.ndarray
    """int64[BLOCK]: the path that lowered each point, -1 if none."""
    last: np.ndarray
    """float64[3, BLOCK]: the previous point of each path."""
    feet: np.ndarray
    """float64[LONGEST + 2, 3, BLOCK]: the points, the bends of one path to them, and its base."""
    support: np.ndarray
    """int64[3, BLOCK]: nodes around the point in the base, padded with -1."""
    values: np.ndarray
    """float64[BLOCK]: sizes that the path allows."""
    active: np.ndarray
    """int64[BLOCK]: active points."""
    starts: np.ndarray
    """float64[BLOCK]: sizes at the bases."""
    chain: np.ndarray
    """int64[LONGEST + 2]: edges of a path, from its end."""
    work: np.ndarray
    """float64[4, LONGEST + 2]"""
    shaft: np.ndarray
    """float64[12]"""
    stack: np.ndarray
    """int64[2, DEPTH]: boxes of paths, and of triangles."""
    queue: np.ndarray
    """int64[2 * BLOCK]: paths to be tested."""
    cached: np.ndarray
    """int64[CACHED]: recently blocking triangles, padded with -1."""
    recent: np.ndarray
    """int64[BLOCK]: paths that lowered the points of the last block, -1 for none."""


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
