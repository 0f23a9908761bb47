r"""Gradient limiting of metrics in physical space: active sources found by a tree.

The limited metric at a node is the intersection of the grown metrics of all sources
(metric_joint.py, metric_sources.py).  At each node:

1. The active sources of the node before are grown and added to the node's own bound where they
   exceed it.  With this present metric P^-1, the sources that exceed (share P)^-1 anywhere are
   listed, with a share slightly above 1.
2. The source of largest excess in the list is added to the intersection until no excess is above 1.
3. The result is exact if it is nowhere below (share P)^-1: then no source outside of the list
   exceeds it, and an intersection of some sources that no other one exceeds is that of all.
   Otherwise sources are listed for the result, and so on.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.metric_joint import MOST, NO, YES, intersect_several, two_by_two
from adaptsize._kernels.metric_sources import (
    MANY,
    distance,
    distance_to_box,
    find_above,
    most_excessive,
    set_present,
)
from adaptsize._kernels.metrics import copy_metric, extremes, fill_relative, is_definite
from adaptsize._kernels.sight import sees
from adaptsize._kernels.trees import descent_by_bound, items_of_leaf

# Excesses up to this are removed by scaling.
_MET = 1.0 + 1e-10


# Sources that are added at one node at most.
_ROUNDS = 100


@lean
def _distance_if_above(boxes, b, given):
    """Return the distance of a box; inf if its metric is not above that of a source."""
    axes, v, sources, g, scratch = given
    away = distance_to_box(axes, boxes, b, sources.x, v)
    if away < math.inf:
        h, r = sources.box_h[b], sources.box_r[b]
        fill_relative(axes, h, r, g * away, scratch.s, scratch.n, scratch.row)
        if is_definite(axes, scratch.n, 1.0, -1.0):
            return away
    return math.inf


_leaf_above = descent_by_bound(_distance_if_above)


@lean
def _dominating(axes, v, sources, g, scratch, view):
    """Return a source whose grown metric is above that of source v, -1 if there is none."""
    stack, x, s, n, dim = scratch.stack, sources.x, scratch.s, scratch.n, len(axes)
    given = (axes, v, sources, g, scratch)
    for i in range(dim):
        for j in range(dim):
            s[i, j] = sources.r[v, i, j] * sources.h[v, j]
    stack.box[0], stack.bound[0], height = 1, 0.0, np.int64(1)
    while height > 0:
        leaf, height = _leaf_above(sources.boxes, stack, height, math.inf, given)
        for k in range(*items_of_leaf(leaf, x.shape[0])):
            more = g * distance(axes, x, v, x, k)
            # The least eigenvalue from which on a metric counts as above another one.
            if extremes(axes, sources.h[k], sources.r[k], more, s, n)[0] > (1.0 + 1e-12) and (
                view is None or sees(view, (x, k, sources.number[k]), (x, v, sources.number[v]))
            ):
                return k
    return np.int64(-1)


@lean_kernel
def find_dominating(axes, first, last, sources, g, by, scratch, view):
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
    view : View or None
        A plane domain in which paths are in the domain; straight lines without.
    """
    for v in range(first, last):
        by[v] = _dominating(axes, v, sources, g, scratch, view)


@lean
def _add(axes, joint, count, h, r, more, number):
    """Add a grown metric to those to intersect (In/Out: joint)."""
    joint.number[count] = number
    copy_metric(axes, (h, r), more, (joint.h[count], joint.r[count]))


@lean
def _is_among(joint, count, number):
    found = False
    for i in range(count):
        found |= joint.number[i] == number
    return found


@lean
def _intersect(axes, x, v, sources, some, n, g, count, exact, scratch):
    """Add sources of a list that exceed the present metric (In/Out: joint of scratch).

    The result is intersected two by two, or exactly.  Returns the number of metrics that determine
    it, and the largest excess of the list that remains, at least 1.
    """
    joint = scratch.joint
    rough, best = True, 1.0
    for _ in range(_ROUNDS):
        set_present(axes, joint.h_all, joint.r_all, scratch)
        best, by = most_excessive(axes, x, v, sources, some, n, g, scratch)
        if best > _MET and not _is_among(joint, count, by):
            more = g * distance(axes, x, v, sources.x, by)
            _add(axes, joint, count, sources.h[by], sources.r[by], more, by)
            count += 1
            if rough and count < MOST:
                two_by_two(axes, count, joint)
                continue
        elif not exact or not rough or count <= 2:
            break
        rough = False
        count = min(intersect_several(axes, count, joint), MOST - 1)
    return count, best


@lean
def _limit(axes, x, v, sources, g, count, scratch, view):
    """Limit the present metric by all sources (In/Out: joint of scratch).

    Returns the number of metrics that determine it, and the largest excess that remains.
    """
    joint = scratch.joint
    # The share by which sources are listed.
    share, best = 1.03, 1.0
    for _ in range(_ROUNDS):
        set_present(axes, joint.h_all, joint.r_all, scratch)
        copy_metric(axes, (joint.h_all, joint.r_all), 0.0, (scratch.h, scratch.r))
        n = find_above(axes, x, v, sources, g, share, scratch, scratch.above, view)
        listed = min(n, MANY)
        count, best = _intersect(axes, x, v, sources, scratch.above, listed, g, count, YES, scratch)
        if n > MANY:
            share = 1.0
        elif extremes(axes, scratch.h, scratch.r, 0.0, scratch.s, scratch.n)[1] <= share * _MET:
            break
    return count, best


@lean
def _without_hidden(x, v, sources, some, count, view):
    """Remove sources that point v does not see (In/Out: some); return the number of the others."""
    left = 0
    for i in range(count):
        k = some[i]
        if sees(view, (sources.x, k, sources.number[k]), (x, v, v)):
            some[left] = k
            left += 1
    return left


@lean_kernel
def limit_metrics(axes, x, order, first, last, sources, g, h, r, active, scratch, view):
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
    view : View or None
        As in `find_dominating`.
    """
    dim, joint, recent = len(axes), scratch.joint, scratch.recent
    n_recent = np.int64(0)
    for position in range(first, last):
        v = np.int64(order[position])
        _add(axes, joint, np.int64(0), h[v], r[v], 0.0, np.int64(-1))
        count = np.int64(1)
        two_by_two(axes, count, joint)
        # Sizes above this count as no bound.
        if h[v, 0] > 1e20:  # nothing to intersect
            count = np.int64(0)
        if view is not None:
            n_recent = _without_hidden(x, v, sources, recent, n_recent, view)
        count, best = _intersect(axes, x, v, sources, recent, n_recent, g, count, NO, scratch)
        count, best = _limit(axes, x, v, sources, g, count, scratch, view)
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
