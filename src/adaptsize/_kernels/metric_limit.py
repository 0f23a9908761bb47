r"""Gradient limiting of metrics in physical space: active sources found by a tree.

A source with sizes h along the columns of R allows at the distance d the grown metric

    M_s(d) = R diag((h + g d)^-2) R^T,

and the limited metric at a node is the intersection of those of all sources (metric_joint.py).

Each box of a tree over the sources has a metric that is nowhere below those of its sources.  Growth
keeps this order, so that the box, grown by its distance, is nowhere below its grown sources.
With the present metric P^-1 = (S S^T)^-1 of a node,

    lambda_max(S^T M S)

is the *excess* of M (metric_order.py): if it is at most 1 for a box, then no source in the box is
above the present metric.  The source of largest excess is added to the intersection until no
excess is above 1.  The result is then the intersection of all sources, since it solves the problem
of some of them and satisfies the constraints of the others.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.metric_joint import MOST, Joint, intersect_several, new_joint, two_by_two
from adaptsize._kernels.metric_order import excess, extremes, fill_relative, is_above
from adaptsize._kernels.metrics import intersect_into
from adaptsize._kernels.trees import DEPTH, LEAF

# Excesses up to this are removed by scaling.
_MET = 1.0 + 1e-10

# The least eigenvalue from which on a metric counts as above another one.
_ABOVE = 1.0 + 1e-12

# Sources that are added at one node at most.
_ROUNDS = 100

# Sizes above this count as no bound; the others are at most 1 (see physical.py).
_UNBOUNDED = 1e20


class Sources(NamedTuple):
    """Sources along a Morton curve, and the tree over them (see trees.py)."""

    x: np.ndarray
    """float64[m, dim]: places."""
    h: np.ndarray
    """float64[m, dim]: sizes."""
    r: np.ndarray
    """float64[m, dim, dim]: directions."""
    number: np.ndarray
    """int32[m]: nodes."""
    boxes: np.ndarray
    """float64[2 * n_leaves, 2 * dim + 1]: boxes, with the least size in each."""
    box_h: np.ndarray
    """float64[2 * n_leaves, dim]: sizes of a metric nowhere below those in the box."""
    box_r: np.ndarray
    """float64[2 * n_leaves, dim, dim]: its directions."""


class Scratch(NamedTuple):
    """Scratch for one thread."""

    joint: Joint
    s: np.ndarray
    """float64[dim, dim]: S, with S S^T the inverse of the present metric."""
    n: np.ndarray
    """float64[dim, dim]"""
    row: np.ndarray
    """float64[dim]"""
    stack: np.ndarray
    """int64[DEPTH]: boxes."""
    bound: np.ndarray
    """float64[DEPTH]: their excesses."""
    recent: np.ndarray
    """int64[MOST]: active sources of the point before, which are tried first."""


def new_scratch(dim: int) -> Scratch:
    """Return scratch for one thread."""
    return Scratch(
        new_joint(dim),
        np.empty((dim, dim)),
        np.empty((dim, dim)),
        np.empty(dim),
        np.empty(DEPTH, np.int64),
        np.empty(DEPTH),
        np.empty(MOST, np.int64),
    )


@lean_kernel
def fill_boxes(axes, sources, k, g):
    """Fill the metrics of the boxes (In/Out: sources); k, g: float64[dim, dim], scratch.

    All boxes must have been set to metrics without a bound.
    """
    n_leaves, m = sources.boxes.shape[0] // 2, sources.x.shape[0]
    for s in range(m):
        b = n_leaves + s // LEAF
        intersect_into(axes, sources.box_h[b], sources.box_r[b], sources.h[s], sources.r[s], k, g)
    for b in range(2 * n_leaves - 1, 1, -1):
        up = b // 2
        intersect_into(
            axes, sources.box_h[up], sources.box_r[up], sources.box_h[b], sources.box_r[b], k, g
        )


@lean
def _distance_to_box(axes, boxes, b, x, v):
    """Return the distance of point v from a box; inf if the box is empty."""
    dim = len(axes)
    square = 0.0
    for d in range(dim):
        gap = max(boxes[b, d] - x[v, d], x[v, d] - boxes[b, dim + d])
        if gap > 0.0:
            square += gap * gap
    return math.sqrt(square)


@lean
def _distance(axes, x, v, y, w):
    """Return the distance of two points."""
    square = 0.0
    for d in range(len(axes)):
        square += (x[v, d] - y[w, d]) ** 2
    return math.sqrt(square)


@lean
def _most_excessive(axes, x, v, sources, g, scratch):
    """Return the largest excess above 1 at point v, and its source; 1 and -1 if there is none."""
    boxes, stack, bound = sources.boxes, scratch.stack, scratch.bound
    s, n, row, dim = scratch.s, scratch.n, scratch.row, len(axes)
    m, n_leaves = sources.x.shape[0], boxes.shape[0] // 2
    best, by = 1.0, np.int64(-1)
    stack[0], bound[0], size = 1, math.inf, 1
    while size > 0:
        size -= 1
        b = stack[size]
        if bound[size] <= best:
            continue
        if b >= n_leaves:
            for k in range((b - n_leaves) * LEAF, min(m, (b - n_leaves + 1) * LEAF)):
                more = g * _distance(axes, x, v, sources.x, k)
                value = excess(axes, sources.h[k], sources.r[k], more, s, n, row, best)
                if value > best and dim == 3:
                    value = extremes(axes, sources.h[k], sources.r[k], more, s, n)[1]
                if value > best:
                    best, by = value, k
            continue
        near, far = 2 * b, 2 * b + 1
        at_near = excess(
            axes, sources.box_h[near], sources.box_r[near],
            g * _distance_to_box(axes, boxes, near, x, v), s, n, row, best,
        )  # fmt: skip
        at_far = 0.0
        if boxes[far, 0] < math.inf:
            at_far = excess(
                axes, sources.box_h[far], sources.box_r[far],
                g * _distance_to_box(axes, boxes, far, x, v), s, n, row, best,
            )  # fmt: skip
        if at_far > at_near:
            near, far, at_near, at_far = far, near, at_far, at_near
        if at_far > best:
            stack[size], bound[size] = far, at_far
            size += 1
        if at_near > best:
            stack[size], bound[size] = near, at_near
            size += 1
    return best, by


@lean
def _most_excessive_of(axes, x, v, sources, some, count, g, scratch):
    """Return the largest excess above `_MET` of some sources; 1 and -1 if there is none."""
    best, by = _MET, np.int64(-1)
    for i in range(count):
        k = some[i]
        more = g * _distance(axes, x, v, sources.x, k)
        value = extremes(axes, sources.h[k], sources.r[k], more, scratch.s, scratch.n)[1]
        if value > best:
            best, by = value, k
    return best, by


@lean
def _set_present(axes, joint, s):
    """Fill S of the present metric (Out: s)."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            s[i, j] = joint.r_all[i, j] * joint.h_all[j]


@lean
def _dominating(axes, v, sources, g, scratch):
    """Return a source whose grown metric is above that of source v, -1 if there is none."""
    boxes, stack, x = sources.boxes, scratch.stack, sources.x
    s, n, row, dim = scratch.s, scratch.n, scratch.row, len(axes)
    m, n_leaves = x.shape[0], boxes.shape[0] // 2
    for i in range(dim):
        for j in range(dim):
            s[i, j] = sources.r[v, i, j] * sources.h[v, j]
    stack[0], size = 1, 1
    while size > 0:
        size -= 1
        b = stack[size]
        if b >= n_leaves:
            for k in range((b - n_leaves) * LEAF, min(m, (b - n_leaves + 1) * LEAF)):
                more = g * _distance(axes, x, v, x, k)
                if extremes(axes, sources.h[k], sources.r[k], more, s, n)[0] > _ABOVE:
                    return k
            continue
        near, far = 2 * b, 2 * b + 1
        to_near = _distance_to_box(axes, boxes, near, x, v)
        to_far = _distance_to_box(axes, boxes, far, x, v)
        if to_far < to_near:
            near, far, to_near, to_far = far, near, to_far, to_near
        if to_far < math.inf:
            fill_relative(axes, sources.box_h[far], sources.box_r[far], g * to_far, s, n, row)
            if is_above(axes, n):
                stack[size] = far
                size += 1
        fill_relative(axes, sources.box_h[near], sources.box_r[near], g * to_near, s, n, row)
        if is_above(axes, n):
            stack[size] = near
            size += 1
    return np.int64(-1)


@lean_kernel
def find_dominating(axes, first, last, sources, g, by, scratch):
    """Find for each source another one whose grown metric is above its own.

    The growth of the one then stays above that of the other everywhere, so that only sources for
    which there is none can be active.

    Parameters
    ----------
    axes : tuple of length dim
    first, last : int
        The part of the sources to process.
    sources : Sources
    g : float64
    by : int32[m]
        Out: the other source, -1 if there is none.
    scratch : Scratch
    """
    for v in range(first, last):
        by[v] = _dominating(axes, v, sources, g, scratch)


@lean
def _add(axes, joint, count, h, r, more, number):
    """Add a grown metric to those to intersect (In/Out: joint)."""
    dim = len(axes)
    joint.number[count] = number
    for j in range(dim):
        joint.h[count, j] = h[j] + more
        for i in range(dim):
            joint.r[count, i, j] = r[i, j]


@lean
def _is_among(joint, count, number):
    found = False
    for i in range(count):
        found |= joint.number[i] == number
    return found


@lean_kernel
def limit_metrics(axes, x, order, first, last, sources, g, h, r, active, scratch):
    """Limit the metrics of points by those of sources.

    Parameters
    ----------
    axes : tuple of length dim
    x : float64[n, dim]
    order : int32[k]
        The points to process.
    first, last : int
        The part of ``order``.
    sources : Sources
    g : float64
    h, r : float64[n, dim], float64[n, dim, dim]
        In/Out: metrics; before, the bounds of the points.
    active : int32[n]
        Out: number of sources whose grown metrics determine the result.
    scratch : Scratch
    """
    dim, joint, recent = len(axes), scratch.joint, scratch.recent
    n_recent = np.int64(0)
    for position in range(first, last):
        v = order[position]
        _add(axes, joint, np.int64(0), h[v], r[v], 0.0, np.int64(-1))
        count = np.int64(1)
        two_by_two(axes, count, joint)
        if h[v, 0] > _UNBOUNDED:  # nothing to intersect
            count = np.int64(0)
        rough, best = True, 1.0
        for _ in range(_ROUNDS):
            _set_present(axes, joint, scratch.s)
            by = np.int64(-1)
            if rough and n_recent > 0:
                best, by = _most_excessive_of(axes, x, v, sources, recent, n_recent, g, scratch)
                n_recent = n_recent if by >= 0 else np.int64(0)
            if by < 0:
                best, by = _most_excessive(axes, x, v, sources, g, scratch)
            if best <= _MET or _is_among(joint, count, by):
                if not rough or count <= 2:
                    break
            else:
                more = g * _distance(axes, x, v, sources.x, by)
                _add(axes, joint, count, sources.h[by], sources.r[by], more, by)
                count += 1
                if rough and count < MOST:
                    two_by_two(axes, count, joint)
                    continue
            rough = False
            count = min(intersect_several(axes, count, joint), MOST - 1)
        active[v] = count
        scale = 1.0 / math.sqrt(best)
        for j in range(dim):
            h[v, j] = joint.h_all[j] * scale
            for i in range(dim):
                r[v, i, j] = joint.r_all[i, j]
        n_recent = np.int64(0)
        for i in range(count):
            if joint.number[i] >= 0:
                recent[n_recent] = joint.number[i]
                n_recent += 1
