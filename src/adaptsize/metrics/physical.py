"""Sources of metrics, and the limited metrics that they allow."""

from __future__ import annotations

import numpy as np

from adaptsize._kernels import metric_limit as kernels
from adaptsize.limiting.exact.work import along_curve, boxes_over, in_chunks, read_only
from adaptsize.metrics.algebra import with_finite_sizes
from adaptsize.typing import FloatArray, IntArray, ProgressCallback


def sources_of(points: FloatArray, h: FloatArray, r: FloatArray, nodes: IntArray) -> kernels.Sources:
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
    sources = kernels.Sources(x, h[nodes], r[nodes], nodes, boxes, box_h, box_r)
    kernels.fill_boxes((0,) * dim, sources, *np.empty((2, dim, dim)))
    return sources


def limit_in_space(
    points: FloatArray,
    h: FloatArray,
    r: FloatArray,
    g: float,
    threads: int,
    report: ProgressCallback,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the sizes and directions of the metrics limited along straight lines.

    Also returns the number of active sources of each node.
    """
    bounded = np.flatnonzero(np.isfinite(h).any(axis=1)).astype(np.int32)
    finite, unbounded = with_finite_sizes(h)
    found = np.ascontiguousarray(r).copy()
    active = np.zeros(len(h), np.int32)
    if len(bounded):
        dim = points.shape[1]
        sources = sources_of(points, finite, found, bounded)
        order, places = read_only(along_curve(points)), read_only(points)

        def task(first: int, last: int) -> None:
            scratch = kernels.new_scratch(dim)
            kernels.limit_metrics(
                (0,) * dim, places, order, first, last, sources, g, finite, found, active, scratch
            )

        in_chunks(task, len(order), threads, report)
    finite[finite >= unbounded] = np.inf
    return finite, found, active
