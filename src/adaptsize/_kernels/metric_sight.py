"""Lines of sight between the nodes of a plane domain that is not convex (see sight.py)."""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.sight import (
    CACHED,
    LEFT,
    RIGHT,
    Sight,
    common_sides,
    in_sectors,
    turned,
    without_hidden,
)
from adaptsize._kernels.trees import DEPTH


class View(NamedTuple):
    """A plane domain, and scratch for one thread."""

    sight: Sight
    rows: np.ndarray
    """int32[n]: rows of the nodes in the sectors, -1 inside."""
    a: np.ndarray
    """float64[2, 1]: where the line begins."""
    b: np.ndarray
    """float64[2, 1]: where it ends."""
    sides: np.ndarray
    """int64[1]: sides of the line on which the domain is."""
    which: np.ndarray
    """int64[1]"""
    stack: np.ndarray
    """int64[DEPTH]"""
    shaft: np.ndarray
    """float64[8]"""
    cached: np.ndarray
    """int64[CACHED]: walls that hid points recently."""


def new_view(sight: Sight, rows: np.ndarray) -> View:
    """Return a domain with scratch for one thread."""
    return View(
        sight=sight,
        rows=rows,
        a=np.empty((2, 1)),
        b=np.empty((2, 1)),
        sides=np.empty(1, np.int64),
        which=np.empty(1, np.int64),
        stack=np.empty(DEPTH, np.int64),
        shaft=np.empty(8),
        cached=np.full(CACHED, -1, np.int64),
    )


@lean
def sees(view, x, i, from_node, y, j, to_node):
    """Return whether the line from point i of x to point j of y is in the domain.

    The points are nodes of the mesh, whose numbers are given, too.
    """
    dx, dy = y[j, 0] - x[i, 0], y[j, 1] - x[i, 1]
    sight, row, end_row = view.sight, view.rows[from_node], view.rows[to_node]
    side = LEFT + RIGHT
    if end_row >= 0:
        side = common_sides(sight, row, side, end_row, dx, dy)
        if side == 0:
            return False
    elif row >= 0 and in_sectors(sight, row, dx, dy) == 0:
        return False
    for d in range(2):
        view.a[d, 0], view.b[d, 0] = x[i, d], y[j, d]
    # As without_hidden expects them: sides of the lines from points to feet.
    view.sides[0], view.which[0] = turned(side), 0
    left = without_hidden(
        sight, view.b, view.a, view.sides, view.which, 1, view.stack, view.shaft, view.cached
    )
    return left == 1


@lean_kernel
def fill_seen(x, nodes, view, seen):
    """Fill whether nodes see each other (Out: seen, bool[c, c]); x: float64[n, 2]."""
    for k in range(nodes.shape[0]):
        for m in range(k):
            is_seen = sees(view, x, nodes[k], nodes[k], x, nodes[m], nodes[m])
            seen[k, m], seen[m, k] = is_seen, is_seen
        seen[k, k] = True
