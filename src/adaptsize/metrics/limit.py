"""`limit_metric`: gradient limiting of metrics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np

from adaptsize._checks import (
    as_plain_array,
    as_slope,
    as_whole_number,
    check_type,
    describe,
)
from adaptsize._progress import reporting
from adaptsize._with_info import with_info
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting.exact.work import number_of_threads
from adaptsize.metrics.metric import Metric
from adaptsize.metrics.physical import limit_in_space
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Sizes up to this much larger than the bound count as equal to it.
_KEPT = 1e-9

_MOST_THREADS = 10_000


@dataclass(frozen=True, eq=False)
class MetricLimitingInfo:
    """What `limit_metric` found besides the metric."""

    n_active: IntArray
    """int32[n]: number of sources that determine the metric of each node; 0 without a bound."""
    kept: BoolArray
    """bool[n]: whether the metric of a node is its own bound."""
    n_sources: int
    """Number of nodes that no single other node dominates."""


@with_info
def limit_metric(
    background: SimplexMesh | CartesianGrid | Octree,
    metric: Metric,
    g: float,
    *,
    threads: int | None = None,
    progress: ProgressCallback | bool | None = None,
) -> tuple[Metric, MetricLimitingInfo]:
    r"""Return the largest metric that nowhere exceeds the metrics of all nodes grown by distance.

    With :math:`L = M^{-1/2}`, whose eigenvalues are the sizes, the metric of node y allows

    .. math:: M_y(x) = \bigl(L_y + g\, |x - y|\, I\bigr)^{-2}

    at x: all of its sizes grow with the slope g, and its directions stay [1]_.  The result at x
    is the intersection of these for all nodes y, that is the metric with the least density
    :math:`\sqrt{\det M}` of all that are nowhere below any of them.  For isotropic metrics it is
    the result of `limit_gradient` with bounds at the nodes, in the plane and in convex domains.

    Parameters
    ----------
    background : SimplexMesh, CartesianGrid or Octree
        Its nodes are those of the metric.
    metric : Metric
        Upper bound on the sizes; they may be inf, but not everywhere.
    g : float
        Gradient limit (length per length), finite and >= 0.  `adapt` and ``adaptsize remesh
        --metric`` use 1 by default.  0.25 or less, as is common for isotropic sizes, shortens
        elements along curved layers, because it limits all sizes by the smallest ones nearby.
    threads : int, optional
        Number of threads, by default that of numba (``numba.set_num_threads``).  The result does
        not depend on it, bit for bit.
    progress : callable or bool, optional
        As in `limit_gradient`.

    Returns
    -------
    limited : Metric
        In no direction is a size larger than in ``metric``, or than any grown metric of a node.
        Without a bound only at inactive nodes of a grid, and in the plane in components without
        any bound.
        ``limit_metric.with_info``, with the same arguments, returns the pair ``(limited, info)``
        with a `MetricLimitingInfo`.

    Raises
    ------
    ValueError
        If the metric has other nodes than the background or no bound at all, or g is negative,
        NaN or above 1e30.

    Notes
    -----
    *Distance.*  On triangles in the plane, :math:`|x - y|` is the length of the shortest path in
    the domain, around holes and slits.  The directions of a metric stay the same around a corner.
    On other backgrounds it is the distance along a straight line, also across slits of solids
    and grids and the space between two sheets of a surface, where it is shorter than a path in the
    domain.  There sizes may be smaller than necessary, but never too large.

    *Order.*  The intersection of three metrics or more is computed for all of them at once, so
    that the result does not depend on the numbering of the nodes.  The usual intersection of two
    metrics at a time does depend on the order, and its elements are more numerous.

    *Limits of the law.*  For every fixed direction u, the sizes :math:`u^T L_y(x)\,u` that one
    node allows have the slope g.  Where several nodes are active, the intersection may change
    faster, and limiting it again may lower it once more.  If all metrics have the same axes, this
    does not happen.

    *Cost.*  Most sources drop out because a single other one dominates them everywhere; a tree
    finds the active ones among the others.  It takes 25 microseconds per node in the plane and 80
    in space for a metric from second derivatives at all nodes.

    References
    ----------
    .. [1] F. Alauzet, "Size gradation control of anisotropic meshes", Finite Elements in Analysis
       and Design 46 (2010) 181-202, the growth in physical space.

    Examples
    --------
    A flat size at one corner of the unit square, which becomes rounder with the distance:

    >>> import numpy as np
    >>> from adaptsize.metrics import Metric
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> sizes = np.full((4, 2), np.inf)
    >>> sizes[0] = 0.01, 0.5
    >>> limited = limit_metric(mesh, Metric(sizes, np.broadcast_to(np.eye(2), (4, 2, 2))), 0.3)
    >>> limited.sizes.round(3)
    array([[0.01 , 0.5  ],
           [0.31 , 0.8  ],
           [0.434, 0.924],
           [0.31 , 0.8  ]])
    """
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    check_type("metric", metric, Metric)
    points = np.ascontiguousarray(background.points)
    if points.shape != metric.sizes.shape:
        raise ValueError(
            f"metric must have {len(points)} nodes in {background.dim}-D, as the background has, "
            f"got {metric!r}"
        )
    slope = as_gradient_limit(g)
    if threads is not None:
        threads = as_whole_number("threads", threads, lower=1, upper=_MOST_THREADS)
    sizes = _on_active(background, metric.sizes)
    if not np.isfinite(sizes).any():
        raise ValueError("metric must have a finite size at one node at least, got inf everywhere")
    with reporting(progress) as report:
        found = limit_in_space(
            points,
            sizes,
            metric.directions,
            slope,
            number_of_threads(threads),
            report,
            background if _is_plane(background) else None,
        )
    h = _on_active(background, found.h)
    limited = Metric.of(h, found.r)
    kept = (limited.density <= metric.density * (1.0 + _KEPT)) & np.isfinite(sizes).any(axis=1)
    return limited, MetricLimitingInfo(found.active, kept, found.n_sources)


def as_gradient_limit(g: Any) -> float:
    """Return a checked gradient limit of metrics: one number."""
    if callable(g) or as_plain_array("g", g).ndim > 0:
        raise ValueError(
            "g must be one number, as metrics grow along shortest paths by one gradient limit, "
            f"got {describe(g)}"
        )
    return as_slope("g", g)


def _is_plane(background: SimplexMesh | CartesianGrid | Octree) -> TypeGuard[SimplexMesh]:
    return isinstance(background, SimplexMesh) and background.cell_dim == background.dim == 2


def _on_active(background: SimplexMesh | CartesianGrid | Octree, sizes: FloatArray) -> FloatArray:
    """Return sizes without a bound at the inactive nodes of a grid."""
    if not isinstance(background, CartesianGrid) or background.active is None:
        return sizes
    return np.where(background.active.ravel()[:, None], sizes, np.inf)
