"""Sources of metrics, and the limited metrics that they allow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._kernels import metric_limit as kernels
from adaptsize._kernels.metric_sources import Sources, fill_tree, new_scratch
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.limiting.exact.work import boxes_over, in_chunks, part_of
from adaptsize.metrics.algebra import AS_UNBOUNDED, UNBOUNDED, power_of_two
from adaptsize.metrics.plane import Walls, around_corners, walls_of
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
    walls: Walls | None,
) -> Sources:
    """Return the sources among the nodes that no single other one dominates."""
    sources = sources_of(points, h, r, nodes)
    dim = points.shape[1]
    by = np.empty(len(sources.number), np.int32)

    def task(first: int, last: int) -> None:
        view = None if walls is None else walls.view()
        kernels.find_dominating((0,) * dim, first, last, sources, g, by, new_scratch(dim), view)

    in_chunks(task, len(by), threads, part_of(report, 0.0, 0.1))
    return sources_of(points, h, r, np.sort(sources.number[by < 0]))


def _with_corners(sources: Sources, points: FloatArray, g: float, walls: Walls) -> Sources:
    """Return sources together with the metrics that come to corners."""
    around = around_corners(points, sources, g, walls)
    h, r = np.concatenate([sources.h, around.h]), np.concatenate([sources.r, around.r])
    nodes = np.concatenate([sources.number, around.nodes])
    which = np.arange(len(nodes), dtype=np.int32)
    found = sources_of(points[nodes], h, r, which)
    return found._replace(number=nodes[found.number].astype(np.int32))


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
    mesh: SimplexMesh | None = None,
) -> Limited:
    """Return the metrics limited along straight lines, or along paths in a plane domain.

    Parameters
    ----------
    points, h, r : float64[n, dim], float64[n, dim], float64[n, dim, dim]
        Sizes may be inf, but not all.
    g : float
    threads : int
        Number of threads, which does not change the result.
    report : callable
    mesh : SimplexMesh, optional
        Triangles in the plane with these points, in which the paths are.
    """
    bounded = np.flatnonzero(np.isfinite(h).any(axis=1)).astype(np.int32)
    scale = power_of_two(h)
    finite, found = np.where(np.isfinite(h), h / scale, UNBOUNDED), np.array(r, order="C")
    active = np.zeros(len(h), np.int32)
    places = points / scale
    walls = None if mesh is None else walls_of(SimplexMesh(places, mesh.cells))
    sources = survivors_of(places, finite, found, bounded, g, threads, report, walls)
    dominated = np.ones(len(h), np.bool_)
    dominated[sources.number] = False
    finite[dominated] = UNBOUNDED  # these bounds have no effect
    n_sources = len(sources.number)
    if walls is not None:
        sources = _with_corners(sources, places, g, walls)
    axes = (0,) * points.shape[1]
    order, places = read_only(along_curve(places)), read_only(places)

    def task(first: int, last: int) -> None:
        scratch, view = new_scratch(len(axes)), None if walls is None else walls.view()
        kernels.limit_metrics(
            axes, places, order, first, last, sources, g, finite, found, active, scratch, view
        )

    in_chunks(task, len(order), threads, part_of(report, 0.1, 1.0))
    h = np.where(finite >= AS_UNBOUNDED, np.inf, finite * scale)
    return Limited(h, found, active, n_sources)
