r"""Sources of metrics, a tree over them, and the search for those above a present metric.

A source with sizes h along the columns of R allows at the distance d the grown metric

    M_s(d) = R diag((h + g d)^-2) R^T.

Each box of the tree has a metric that is nowhere below those of its sources.  Growth keeps this
order, so that the box, grown by its distance, is nowhere below its grown sources.

With L = R diag(h) R^T, and P^-1 the present metric of a node, a grown metric is nowhere above it if

    (L + g d)^2 - P = L^2 + 2 g d L + (g d)^2 I - P

is positive semidefinite.  This needs a dozen multiplications for given L and L^2.  Rounding errors
are relative to the largest sizes, so that the test is done with a margin.  What does not pass is
compared by its *excess* lambda_max(S^T M S), where P = S S^T (metrics.py).
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.metric_joint import MOST, Joint, new_joint
from adaptsize._kernels.metrics import (
    extremes,
    fill_relative,
    intersect_into,
    is_definite,
    is_definite_upper,
)
from adaptsize._kernels.sight import sees
from adaptsize._kernels.trees import (
    LEAF,
    Stack,
    descent_by_bound,
    gap2_to_box,
    items_of_leaf,
    new_stack,
)

#: Most sources that `find_above` lists.
MANY = 1024


# Rounding errors of L^2 and P, relative to their traces.
_MARGIN = 1e-14


class Sources(NamedTuple):
    """Sources along a Morton curve, and the tree over them (see trees.py).

    Parameters
    ----------
    x : float64[m, dim]
        Places.
    h : float64[m, dim]
        Sizes.
    r : float64[m, dim, dim]
        Directions.
    powers : float64[m, dim * (dim + 1)]
        Upper triangles of L and of L^2.
    number : int64[m]
        Nodes; for what comes around a corner, the corner.
    boxes : float64[2 * n_leaves, 2 * dim + 1]
        Boxes, with the least size in each.
    box_h : float64[2 * n_leaves, dim]
        Sizes of a metric nowhere below those in the box.
    box_r : float64[2 * n_leaves, dim, dim]
        Its directions.
    box_powers : float64[2 * n_leaves, dim * (dim + 1)]
        Its L and L^2.
    """

    x: np.ndarray
    h: np.ndarray
    r: np.ndarray
    powers: np.ndarray
    number: np.ndarray
    boxes: np.ndarray
    box_h: np.ndarray
    box_r: np.ndarray
    box_powers: np.ndarray


class Scratch(NamedTuple):
    """Scratch for one thread.

    Parameters
    ----------
    joint : Joint
    s : float64[dim, dim]
        S, with S S^T the inverse of the present metric.
    p : float64[7]
        The upper triangle of P, and at the end its trace.
    n : float64[dim, dim]
    row : float64[dim]
    h : float64[dim]
        Sizes of the metric for which sources were listed.
    r : float64[dim, dim]
        Its directions.
    stack : Stack
    above : int64[MANY]
        Listed sources.
    recent : int64[MOST]
        Active sources of the point before, which are tried first.
    """

    joint: Joint
    s: np.ndarray
    p: np.ndarray
    n: np.ndarray
    row: np.ndarray
    h: np.ndarray
    r: np.ndarray
    stack: Stack
    above: np.ndarray
    recent: np.ndarray


def new_scratch(dim: int) -> Scratch:
    """Return scratch for one thread."""
    return Scratch(
        joint=new_joint(dim),
        s=np.empty((dim, dim)),
        p=np.empty(7),
        n=np.empty((dim, dim)),
        row=np.empty(dim),
        h=np.empty(dim),
        r=np.empty((dim, dim)),
        stack=new_stack(),
        above=np.empty(MANY, np.int64),
        recent=np.empty(MOST, np.int64),
    )


@lean
def _fill_powers(axes, h, r, powers):
    """Fill the upper triangles of L and of L^2 (Out: powers)."""
    dim = len(axes)
    k = 0
    for i in range(dim):
        for j in range(i, dim):
            first, second = 0.0, 0.0
            for q in range(dim):
                # Sizes above this are no bounds, and count as this in L: the others are at most 1.
                size = min(h[q], 2.0)
                first += r[i, q] * size * r[j, q]
                second += r[i, q] * size * size * r[j, q]
            powers[k], powers[k + dim * (dim + 1) // 2] = first, second
            k += 1


@lean_kernel
def fill_tree(axes, sources, k, g):
    """Fill the metrics of the boxes, and all powers (In/Out: sources).

    All boxes must have been set to metrics without a bound.  k, g: float64[dim, dim], scratch.
    """
    n_leaves, m = sources.boxes.shape[0] // 2, sources.x.shape[0]
    for s in range(m):
        b = n_leaves + s // LEAF
        box = (sources.box_h[b], sources.box_r[b])
        intersect_into(axes, box, (sources.h[s], sources.r[s]), k, g)
        _fill_powers(axes, sources.h[s], sources.r[s], sources.powers[s])
    for b in range(2 * n_leaves - 1, 0, -1):
        up = b // 2
        if up > 0:
            box = (sources.box_h[up], sources.box_r[up])
            intersect_into(axes, box, (sources.box_h[b], sources.box_r[b]), k, g)
        _fill_powers(axes, sources.box_h[b], sources.box_r[b], sources.box_powers[b])


@lean
def distance_to_box(axes, boxes, b, x, v):
    """Return the distance of point v from a box; inf if the box is empty."""
    return math.sqrt(gap2_to_box(boxes, b, axes, (x[v], x[v])))


@lean
def distance(axes, x, v, y, w):
    """Return the distance of two points."""
    square = 0.0
    for d in range(len(axes)):
        square += (x[v, d] - y[w, d]) ** 2
    return math.sqrt(square)


@lean
def set_present(axes, h, r, scratch):
    """Set the present metric, to which others are compared (In/Out: s, p of scratch)."""
    dim, s, p = len(axes), scratch.s, scratch.p
    for i in range(dim):
        for j in range(dim):
            s[i, j] = r[i, j] * h[j]
    trace, k = 0.0, 0
    for i in range(dim):
        for j in range(i, dim):
            total = 0.0
            for q in range(dim):
                total += s[i, q] * s[j, q]
            p[k] = total
            k += 1
            if i == j:
                trace += total
    p[6] = trace


@lean
def is_below(axes, powers, i, more, p, share):
    """Return whether metric i, its sizes increased, is surely nowhere above (share P)^-1."""
    w, t, q = powers[i], 2.0 * more, more * more
    if len(axes) == 1:
        a = w[1] + t * w[0] + q
        return a - share * p[0] > _MARGIN * (a + share * p[6])
    if len(axes) == 2:
        a, b, d = w[3] + t * w[0] + q, w[4] + t * w[1], w[5] + t * w[2] + q
        margin = _MARGIN * (a + d + share * p[6])
        a, b, d = a - share * p[0] - margin, b - share * p[1], d - share * p[2] - margin
        return a > 0.0 and a * d > b * b
    a, b, c = w[6] + t * w[0] + q, w[7] + t * w[1], w[8] + t * w[2]
    d, e, f = w[9] + t * w[3] + q, w[10] + t * w[4], w[11] + t * w[5] + q
    margin = _MARGIN * (a + d + f + share * p[6])
    return is_definite_upper((
        a - share * p[0] - margin, b - share * p[1], c - share * p[2],
        d - share * p[3] - margin, e - share * p[4], f - share * p[5] - margin,
    ))  # fmt: skip


@lean
def _distance_unless_below(boxes, b, given):
    """Return the distance of a box; inf if its metric is surely nowhere above (share P)^-1."""
    axes, sources, x, v, g, p, share = given
    away = distance_to_box(axes, boxes, b, x, v)
    if away < math.inf and not is_below(axes, sources.box_powers, b, g * away, p, share):
        return away
    return math.inf


_leaf_above = descent_by_bound(_distance_unless_below)


@lean
def find_above(axes, x, v, sources, g, share, scratch, above, view):
    """List the sources whose grown metrics at point v are anywhere above (share P)^-1.

    Only those that point v sees, unless ``view`` is None.  Their number is returned, or one more
    than the length of the list if there are more (Out: above).
    """
    boxes, stack, p, most = sources.boxes, scratch.stack, scratch.p, above.shape[0]
    limit, count, given = 1.0 / share, 0, (axes, sources, x, v, g, p, share)
    stack.box[0], stack.bound[0], height = 1, 0.0, np.int64(1)
    while height > 0:
        leaf, height = _leaf_above(boxes, stack, height, math.inf, given)
        for k in range(*items_of_leaf(leaf, sources.x.shape[0])):
            more = g * distance(axes, x, v, sources.x, k)
            if is_below(axes, sources.powers, k, more, p, share):
                continue
            h, r = sources.h[k], sources.r[k]
            fill_relative(axes, h, r, more, scratch.s, scratch.n, scratch.row)
            if is_definite(axes, scratch.n, -1.0, limit):
                continue
            if view is not None and not sees(view, (sources.x, k, sources.number[k]), (x, v, v)):
                continue
            if count == most:
                return most + 1
            above[count] = k
            count += 1
    return count


@lean
def most_excessive(axes, x, v, sources, some, count, g, scratch):
    """Return the largest excess above 1 of some sources, and the source; 1 and -1 if none."""
    best, by = 1.0, np.int64(-1)
    for i in range(count):
        k = some[i]
        more = g * distance(axes, x, v, sources.x, k)
        if is_below(axes, sources.powers, k, more, scratch.p, 1.0 / best):
            continue
        value = extremes(axes, sources.h[k], sources.r[k], more, scratch.s, scratch.n)[1]
        if value > best:
            best, by = value, k
    return best, by


@lean_kernel
def list_entering(axes, x, v, sources, g, guesses, entering, scratch, view):
    """List the sources that node v sees and that none of its guesses dominates there.

    Parameters
    ----------
    axes, x, sources, g, scratch, view
        As in `metric_limit.limit_metrics`.
    v : int
    guesses : int64[k]
        Sources to try, of which the first one that is seen is used.
    entering : int64[m]
        Out: the sources.

    Returns
    -------
    int
        Their number; -1 if no guess is seen.
    """
    joint = scratch.joint
    for k in guesses:
        if sees(view, (sources.x, k, sources.number[k]), (x, v, v)):
            more = g * distance(axes, x, v, sources.x, k)
            for d in range(len(axes)):
                joint.h_all[d] = sources.h[k, d] + more
            set_present(axes, joint.h_all, sources.r[k], scratch)
            entering[0] = k
            return 1 + find_above(axes, x, v, sources, g, 1.0, scratch, entering[1:], view)
    return -1
