"""`limit_metric`: gradient limiting of metrics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from adaptsize._checks import as_plain_array, as_slope, as_threads, check_type, describe
from adaptsize._kernels import metric_limit as kernels
from adaptsize._kernels.metric_sources import Sources, fill_tree, new_scratch
from adaptsize._progress import reporting
from adaptsize._with_info import with_info
from adaptsize._workers import Workers
from adaptsize.background import AnyBackground, CartesianGrid, Octree, SimplexMesh
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background.interpolation import nodes_in_domain
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics.algebra import AS_UNBOUNDED, UNBOUNDED, power_of_two
from adaptsize.metrics.metric import Metric
from adaptsize.metrics.plane import PlaneDomain, around_corners, plane_domain_of
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback


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
    background: AnyBackground,
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
        any bound.  Mesh nodes that belong to no cell keep their metrics.
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
    background = as_mesh("background", background, CartesianGrid, Octree)
    check_type("metric", metric, Metric)
    points = np.ascontiguousarray(background.points)
    if points.shape != metric.sizes.shape:
        raise ValueError(
            f"metric must have {len(points)} nodes in {background.dim}-D, as the background has, "
            f"got {metric!r}"
        )
    slope = as_one_slope(g)
    threads = as_threads(threads)
    counts = nodes_in_domain(background)[:, None]
    sizes = np.where(counts, metric.sizes, np.inf)
    if not np.isfinite(sizes).any():
        raise ValueError("metric must have a finite size at one node at least, got inf everywhere")
    with reporting(progress) as report:
        field = _Field(points, sizes, metric.directions)
        mesh = background if _is_plane(background) else None
        found, active, n_sources = _limited(field, slope, Workers.of(threads, report), mesh)
    # Nodes in no cell keep their metrics, inactive ones have no bound.
    kept_sizes = metric.sizes if isinstance(background, SimplexMesh) else np.inf
    h = np.where(counts, found.h, kept_sizes)
    r = np.where(counts[:, :, None], found.r, metric.directions)
    limited = Metric.of(h, r)
    # Sizes up to this much larger than the bound count as equal to it.
    kept = (limited.density <= metric.density * (1.0 + 1e-9)) & np.isfinite(sizes).any(axis=1)
    return limited, MetricLimitingInfo(active, kept, n_sources)


def as_one_slope(g: Any) -> float:
    """Return the gradient limit of metrics, which is a number."""
    if callable(g) or as_plain_array("g", g).ndim > 0:
        raise ValueError(
            "g must be one number, as metrics grow along shortest paths by one gradient limit, "
            f"got {describe(g)}"
        )
    return as_slope("g", g)


def _is_plane(background: AnyBackground) -> TypeGuard[SimplexMesh]:
    return isinstance(background, SimplexMesh) and background.cell_dim == background.dim == 2


class _Field(NamedTuple):
    """Metrics at points."""

    points: FloatArray
    """float64[n, dim]"""
    h: FloatArray
    """float64[n, dim]: sizes."""
    r: FloatArray
    """float64[n, dim, dim]: directions."""


def _sources_of(field: _Field, nodes: IntArray) -> Sources:
    """Return the metrics of some nodes as sources."""
    points, h, r = field
    nodes = nodes[along_curve(points[nodes])]
    x = points[nodes]
    boxes = boxes_over(x, x, h[nodes].min(axis=1))
    dim = x.shape[1]
    box_h = np.full((len(boxes), dim), np.finfo(float).max ** 0.25)
    box_r = np.broadcast_to(np.eye(dim), (len(boxes), dim, dim)).copy()
    powers = [np.empty((len(stack), dim * (dim + 1))) for stack in (x, boxes)]
    numbers = nodes.astype(np.int64)
    sources = Sources(x, h[nodes], r[nodes], powers[0], numbers, boxes, box_h, box_r, powers[1])
    fill_tree((0,) * dim, sources, *np.empty((2, dim, dim)))
    return sources


def _survivors_of(
    field: _Field, nodes: IntArray, g: float, workers: Workers, domain: PlaneDomain | None
) -> Sources:
    """Return the sources among the nodes that no single other one dominates."""
    sources = _sources_of(field, nodes)
    dim = field.points.shape[1]
    by = np.empty(len(sources.number), np.int32)

    def task(first: int, last: int) -> None:
        view = None if domain is None else domain.view()
        kernels.find_dominating((0,) * dim, first, last, sources, g, by, new_scratch(dim), view)

    workers.part(0.0, 0.1).in_chunks(task, len(by))
    return _sources_of(field, np.sort(sources.number[by < 0]))


def _with_corners(sources: Sources, points: FloatArray, g: float, domain: PlaneDomain) -> Sources:
    """Return sources together with the metrics that come to corners."""
    h, r, nodes = around_corners(points, sources, g, domain)
    h, r = np.concatenate([sources.h, h]), np.concatenate([sources.r, r])
    nodes = np.concatenate([sources.number, nodes])
    which = np.arange(len(nodes), dtype=np.int32)
    found = _sources_of(_Field(points[nodes], h, r), which)
    return found._replace(number=nodes[found.number].astype(np.int64))


def _limited(
    field: _Field, g: float, workers: Workers, mesh: SimplexMesh | None
) -> tuple[_Field, IntArray, int]:
    """Return the limited metrics, and the numbers of active sources of each node and of sources.

    Along straight lines, or along paths in a mesh of triangles in the plane with these points.
    """
    points, h, r = field
    bounded = np.flatnonzero(np.isfinite(h).any(axis=1)).astype(np.int32)
    scale = power_of_two(h)
    finite, found = np.where(np.isfinite(h), h / scale, UNBOUNDED), np.array(r, order="C")
    active = np.zeros(len(h), np.int32)
    places = points / scale
    domain = None if mesh is None else plane_domain_of(SimplexMesh(places, mesh.cells))
    scaled = _Field(places, finite, found)
    sources = _survivors_of(scaled, bounded, g, workers, domain)
    dominated = np.ones(len(h), np.bool_)
    dominated[sources.number] = False
    finite[dominated] = UNBOUNDED  # these bounds have no effect
    n_sources = len(sources.number)
    if domain is not None:
        sources = _with_corners(sources, places, g, domain)
    axes = (0,) * points.shape[1]
    order = along_curve(places)

    def task(first: int, last: int) -> None:
        scratch, view = new_scratch(len(axes)), None if domain is None else domain.view()
        kernels.limit_metrics(
            axes, places, order, first, last, sources, g, finite, found, active, scratch, view
        )

    workers.part(0.1, 1.0).in_chunks(task, len(order))
    h = np.where(finite >= AS_UNBOUNDED, np.inf, finite * scale)
    return _Field(points, h, found), active, n_sources
