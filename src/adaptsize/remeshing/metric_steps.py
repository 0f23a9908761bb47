"""Metrics whose sizes fall in steps, each mesh the background of the next.

Mmg reads a metric at the nodes of its input and interpolates between them.  Where sizes are some
thousand times smaller than the cells, as in a boundary layer, it makes hardly any of the cells, and
the next run on its result finds no nodes at which the metric is small.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from adaptsize.errors import BackendError
from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import Arrays, MeshingProblem, mesh_of
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.metrics import Metric
    from adaptsize.quality.by_place import RequestedElements


def in_steps(
    problem: MeshingProblem, made: Arrays, run: Callable[[Arrays, Metric], Arrays]
) -> Arrays:
    """Return a mesh that serves a metric: the given one, or one that is made in steps.

    Parameters
    ----------
    problem : MeshingProblem
        With a metric.
    made : mapping of str to array
        The best mesh so far.
    run : callable
        Takes a mesh and the metric at its nodes, and returns the next mesh.

    Returns
    -------
    mapping of str to array
        If no step serves the metric, the mesh whose edges are least too long on average.
    """
    if problem.facets.required.any():
        return made
    metric = problem.directions
    first = _elements(problem, made, metric)
    if _missing(first) <= tuning.MISSING:
        problem.served.append((mesh_of(made), first))
        return made
    best, least = made, first.excess()
    current: Arrays = first_mesh(problem)
    reached, missing = np.inf, 0.0
    floors, largest = _floors(problem)
    for floor in np.repeat(floors, tuning.TURNS_OF_STEP).tolist():
        if floor == reached:
            continue

        def bounded(points: FloatArray, floor: float = floor) -> Metric:
            return _coarsened(metric(points), floor, largest)

        try:
            current = run(current, bounded(current["points"]))
        except BackendError:  # also if the time is over
            break
        found = _elements(problem, current, metric)
        if found.excess() < least:
            best, least = current, found.excess()
        missing, before = _missing(_elements(problem, current, bounded)), missing
        if missing <= tuning.MISSING:
            reached = floor
        elif missing > before > tuning.LOST:
            break
    return best


def is_far(problem: MeshingProblem) -> bool:
    """Return whether steps come first: in space a single run may not end within a minute."""
    if problem.metric is None or problem.task != "tetrahedra" or problem.facets.required.any():
        return False
    base = problem.mesh if problem.metric_mesh is None else problem.metric_mesh
    least = float(problem.metric(base.points).sizes.min())
    return float(problem.mesh.edge_lengths.mean()) > tuning.EDGE_OVER_LEAST_SIZE * least


def first_mesh(problem: MeshingProblem) -> Arrays:
    """Return the mesh of a request as arrays."""
    facets = problem.facets
    return {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "regions": problem.regions,
        "facets": facets.nodes,
        "facet_groups": facets.groups,
        "ridges": problem.ridges,
    }


def _coarsened(metric: Metric, floor: float, largest: float) -> Metric:
    """Return a metric whose least sizes are at least the floor.

    The aspect ratios are kept, up to the largest size: a floor for each size alone would make all
    of a layer isotropic first, which takes far more cells.
    """
    from adaptsize.metrics import Metric

    scaled = metric.sizes * np.maximum(floor / metric.sizes[:, :1], 1.0)
    return Metric.of(np.minimum(scaled, np.maximum(largest, metric.sizes)), metric.directions)


def _floors(problem: MeshingProblem) -> tuple[FloatArray, float]:
    """Return the least sizes of the steps, evenly from the edges of the mesh to those requested.

    Also return the largest size.
    """
    base = problem.mesh if problem.metric_mesh is None else problem.metric_mesh
    first = float(problem.mesh.edge_lengths.mean())
    sizes = problem.directions(base.points).sizes
    last, largest = float(sizes.min()), float(sizes.max())
    last = max(last, tuning.FINEST[problem.task] * float(np.ptp(base.points, axis=0).max()))
    if first <= last:
        return np.array([last]), largest
    count = int(np.ceil(np.log(first / last) / np.log(tuning.FACTOR_OF_STEP)))
    return first * (last / first) ** (np.arange(1, count + 1) / count), largest


def _elements(
    problem: MeshingProblem, made: Arrays, metric: Callable[[FloatArray], Metric]
) -> RequestedElements:
    from adaptsize.quality.by_place import RequestedElements

    return RequestedElements.of_metric(mesh_of(made), metric, problem.metric_mesh, tuning.SAMPLE)


def _missing(elements: RequestedElements) -> float:
    found = elements.served()
    return 0.0 if found is None else found.too_coarse
