"""Sources of metrics, and the limited metrics that they allow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._kernels import metric_limit as kernels
from adaptsize._kernels.metric_sources import Sources, fill_tree, new_scratch
from adaptsize.background._mesh_arrays import read_only
from adaptsize.limiting.exact.work import along_curve, boxes_over, in_chunks, part_of
from adaptsize.metrics.algebra import AS_UNBOUNDED, UNBOUNDED, power_of_two
from adaptsize.typing import FloatArray, IntArray, ProgressCallback


def sources_of(points: FloatArray, h: FloatArray, r: FloatArray, nodes: IntArray) -> Sources:
    """Return the metrics of some nodes as sources.

    Parameters
    ----------
    points, h, r : float64[n, dim], float64[n, dim], float64[n, dim, dim]
        Finite.
    nodes : int32[m]
    """
    nodes = nodes[along_curve(points[nodes])]
    x = points[nodes]
    boxes = boxes_over(x, x, h[nodes].min(axis=1))
    dim = x.shape[1]
    box_h = np.full((len(boxes), dim), np.finfo(float).max ** 0.25)
    box_r = np.broadcast_to(np.eye(dim), (len(boxes), dim, dim)).copy()
    powers = [np.empty((len(stack), dim * (dim + 1))) for stack in (x, boxes)]
    sources = Sources(x, h[nodes], r[nodes], powers[0], nodes, boxes, box_h, box_r, powers[1])
    fill_tree((0,) * dim, sources, *np.empty((2, dim, dim)))
    return sources


def survivors_of(
    points: FloatArray,
    h: FloatArray,
    r: FloatArray,
    nodes: IntArray,
    g: float,
    threads: int,
    report: ProgressCallback,
) -> Sources:
    """Return the sources among the nodes that no single other one dominates."""
    sources = sources_of(points, h, r, nodes)
    dim = points.shape[1]
    by = np.empty(len(sources.number), np.int32)

    def task(first: int, last: int) -> None:
        kernels.find_dominating((0,) * dim, first, last, sources, g, by, new_scratch(dim))

    in_chunks(task, len(by), threads, part_of(report, 0.0, 0.1))
    return sources_of(points, h, r, np.sort(sources.number[by < 0]))


class Limited(NamedTuple):
    """Limited metrics."""

    h: FloatArray
    """float64[n, dim]: sizes."""
    r: FloatArray
    """float64[n, dim, dim]: directions."""
    active: IntArray
    """int32[n]: number of sources that determine the metric of each node."""
    n_sources: int
    """Number of sources that no other one dominates."""


def limit_in_space(
    points: FloatArray,
    h: FloatArray,
    r: FloatArray,
    g: float,
    threads: int,
    report: ProgressCallback,
) -> Limited:
    """Return the metrics limited along straight lines.

    Parameters
    ----------
    points, h, r : float64[n, dim], float64[n, dim], float64[n, dim, dim]
        Sizes may be inf, but not all.
    g : float
    threads : int
        Number of threads, which does not change the result.
    report : callable
    """
    bounded = np.flatnonzero(np.isfinite(h).any(axis=1)).astype(np.int32)
    scale = power_of_two(h)
    finite, found = np.where(np.isfinite(h), h / scale, UNBOUNDED), np.array(r, order="C")
    active = np.zeros(len(h), np.int32)
    places = points / scale
    sources = survivors_of(places, finite, found, bounded, g, threads, report)
    dominated = np.ones(len(h), np.bool_)
    dominated[sources.number] = False
    finite[dominated] = UNBOUNDED  # these bounds have no effect
    axes = (0,) * points.shape[1]
    order, places = read_only(along_curve(places)), read_only(places)

    def task(first: int, last: int) -> None:
        scratch = new_scratch(len(axes))
        kernels.limit_metrics(
            axes, places, order, first, last, sources, g, finite, found, active, scratch
        )

    in_chunks(task, len(order), threads, part_of(report, 0.1, 1.0))
    h = np.where(finite >= AS_UNBOUNDED, np.inf, finite * scale)
    return Limited(h, found, active, len(sources.number))
