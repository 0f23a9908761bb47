"""Simplices on which bounds at the nodes of a grid count as linear: no diagonal is preferred.

The boxes are split along all of their diagonals, and the lower size is used.  So nothing changes if
a grid is mirrored.
"""

from itertools import combinations, permutations

import numpy as np

from adaptsize.background import CartesianGrid
from adaptsize.background.grid import both_ways, whole_boxes
from adaptsize.typing import BoolArray, FloatArray, IntArray

# The corners of a box are numbered by 4 i + 2 j + k, so that opposite ones add up to 7.  Six
# tetrahedra surround each of the four diagonals through the inside.
_TETRAHEDRA = np.array(
    [
        [start, start ^ first, start ^ first ^ second, start ^ 7]
        for start in range(4)
        for first, second, _ in permutations((1, 2, 4))
    ]
)


# Boxes that are split at once, for less memory.
_AT_ONCE = 20_000


def linear_on_boxes(grid: CartesianGrid, h0: FloatArray, g: float) -> IntArray:
    """Return the simplices, int32[m, dim + 1]; in space without those that cannot matter."""
    finite = np.isfinite(h0)
    if grid.dim == 2:
        return both_ways(finite, grid.active)
    number = np.arange(grid.n_points, dtype=np.int32).reshape(grid.shape)
    corners = _at_corners(number, grid.active)
    edges, found = np.asarray(grid.spacing), [np.empty((0, 4), np.int32)]
    for first in range(0, len(corners), _AT_ONCE):
        some = corners[first : first + _AT_ONCE]
        has = finite.ravel()[some]
        keep = _may_matter(h0.ravel()[some], has, edges, g)
        boxes, which = np.nonzero(_KEPT[has[keep] @ (1 << np.arange(8))])
        found.append(some[keep][boxes[:, None], _TETRAHEDRA[which]])
    return np.concatenate(found)


def all_tetrahedra(grid: CartesianGrid) -> IntArray:
    """Return the tetrahedra around all diagonals of the whole boxes of a grid in space."""
    number = np.arange(grid.n_points, dtype=np.int32).reshape(grid.shape)
    return _at_corners(number, grid.active)[:, _TETRAHEDRA].reshape(-1, 4)


def _at_corners(values: IntArray, active: BoolArray | None) -> IntArray:
    """Return the values at the corners of all whole boxes, int32[m, 8]."""
    ends = slice(None, -1), slice(1, None)
    every = [values[a, b, c] for a in ends for b in ends for c in ends]
    whole = np.ones(every[0].shape, np.bool_) if active is None else whole_boxes(active)
    return np.stack([some[whole] for some in every], axis=1)


def _may_matter(bounds: FloatArray, has: BoolArray, edges: FloatArray, g: float) -> BoolArray:
    """Return the boxes with bounds at some corners, or at all with a slope that may exceed g.

    The gradient in a tetrahedron consists of differences along edges of the box.
    """
    squares = np.zeros(len(bounds))
    with np.errstate(invalid="ignore"):
        for axis, step in enumerate((4, 2, 1)):
            low = np.flatnonzero(np.arange(8) & step == 0)
            rise = np.abs(bounds[:, low + step] - bounds[:, low]).max(axis=1)
            squares += (rise / edges[axis]) ** 2
    matters: BoolArray = has.any(axis=1) & ~(has.all(axis=1) & (squares < g * g))
    return matters


def _kept() -> BoolArray:
    """Return which tetrahedra count, bool[256, 24], given the corners with bounds as a sum of bits.

    A diagonal of a side between two corners with bounds is a short cut if just one of the two other
    corners has a bound, too: data along a line turn that corner.  So is a diagonal through the
    inside if further corners have bounds, but not all.  In some patterns each tetrahedron at an
    edge has a short cut; there those on the sides are left in.
    """
    kept = np.zeros((256, len(_TETRAHEDRA)), np.bool_)
    for pattern in range(1, 256):
        has = [bool(pattern >> corner & 1) for corner in range(8)]
        cuts = np.array([_short_cuts(has, nodes) for nodes in _TETRAHEDRA.tolist()])
        useful = np.array([any(has[v] for v in nodes) for nodes in _TETRAHEDRA.tolist()])
        kept[pattern] = useful & (cuts == 0)
        if not _has_all_edges(has, _TETRAHEDRA[kept[pattern]]):
            kept[pattern] = useful & (cuts < _THROUGH)
    return kept


# Counts more than the short cuts on sides.
_THROUGH = 10


def _short_cuts(has: list[bool], nodes: list[int]) -> int:
    """Return how many lines between corners of a tetrahedron are short cuts."""
    count = 0
    for v, w in combinations(nodes, 2):
        steps = [step for step in (1, 2, 4) if (v ^ w) & step]
        if has[v] and has[w] and len(steps) == 2:
            count += has[v ^ steps[0]] != has[v ^ steps[1]]
        if has[v] and has[w] and len(steps) == 3:
            count += _THROUGH * (2 < sum(has) < 8)
    return count


def _has_all_edges(has: list[bool], tetrahedra: IntArray) -> bool:
    """Return whether all corners with bounds, and edges of the box between them, are covered."""
    pairs = {(v, w) for nodes in tetrahedra.tolist() for v in nodes for w in nodes}
    with_bounds = [v for v in range(8) if has[v]]
    return all((v, w) in pairs for v in with_bounds for w in with_bounds if v ^ w in (0, 1, 2, 4))


_KEPT = _kept()
