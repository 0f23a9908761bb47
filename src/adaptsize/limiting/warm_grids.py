"""Fast marching and source tracking on grids from the sizes for slightly different bounds."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import repair, repair_grid
from adaptsize._kernels.track_grid import offer_around
from adaptsize.background.padding import pad, strides_of_padded, unpad
from adaptsize.limiting import grid_marching, grid_tracking
from adaptsize.limiting.changes import Changes
from adaptsize.limiting.solution import Solution
from adaptsize.limiting.source_tracking import TrackedSolution
from adaptsize.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid
    from adaptsize.limiting.problem import Problem

# Suspects looked at between two reports.
_CHUNK = 50_000

# With more nodes to begin anew than this share of all, a start from nothing is as quick; in
# marching, which takes a tenth of a microsecond per node, with more that have lost their support.
_MOST = 0.5
_MOST_LOST = 0.15

# Nodes so many steps around begin anew, too: that their sources were found in the same order
# makes the results of dense rough data three times as seldom different from those from nothing.
_RINGS = 2

# Fate of nodes that begin anew (see `find_dependents`).
_BACK = 2


def resume_grid_marching(
    grid: CartesianGrid, earlier: Solution, problem: Problem, changes: Changes
) -> Solution | None:
    """Solve the equations of `solve_grid_marching`, order 1, from the solution for other bounds.

    Parameters and result as for `adaptsize.limiting.warm_marching.resume_fast_marching`.
    """
    return _march(grid, earlier, problem, changes, False)


def resume_grid_edges(
    grid: CartesianGrid, earlier: Solution, problem: Problem, changes: Changes
) -> Solution | None:
    """Do for `solve_grid_edges` what `resume_grid_marching` does for `solve_grid_marching`."""
    return _march(grid, earlier, problem, changes, True)


def _march(
    grid: CartesianGrid, earlier: Solution, problem: Problem, changes: Changes, edges: bool
) -> Solution | None:
    slope = problem.slope
    bounds, u = pad(grid, problem.h0), pad(grid, earlier.h)
    lowered, raised = _padded(grid, changes.lowered), _padded(grid, changes.raised)
    u[lowered] = bounds[lowered]
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    g = pad(grid, slope.values) if slope.step else slope.values
    geometry = (strides_of_padded(grid), weights, g, slope.step)
    found = _lost(u, bounds, (*geometry, edges), raised, problem)
    if found is None:
        return None
    seeds = np.unique(np.concatenate([lowered, found]))
    seeds = seeds[np.isfinite(u[seeds])].astype(np.int32)
    steepest = float(slope.values.max())
    accepted = grid_marching.accept_all(grid, u, geometry, edges, steepest, seeds, problem.report)
    residual = partial(grid_marching.residual_of, u, geometry, edges) if problem.residual else 0.0
    return Solution(unpad(grid, u), accepted, residual)


def _lost(
    u: FloatArray,
    bounds: FloatArray,
    geometry: tuple[object, ...],
    raised: IntArray,
    problem: Problem,
) -> IntArray | None:
    """Return the nodes that have lost their support, after they were put back (In/Out: u).

    None, and the work is not finished, if they are too many.
    """
    n = u.size
    if len(raised) == 0:
        return raised
    lost, found, count = np.zeros(n, np.bool_), np.empty(n, np.int32), 0
    waiting, suspect, ends = (
        np.zeros(n, np.bool_),
        np.empty(n, np.int32),
        np.array([0, len(raised)]),
    )
    suspect[: len(raised)] = raised[np.argsort(u[raised], kind="stable")]
    waiting[raised] = True
    while ends[1] > 0:
        count = repair_grid.find_lost(
            u, bounds, *geometry, lost, found, count, suspect, waiting, ends, _CHUNK
        )
        problem.report("limiting the gradient", None)
        if count > _MOST_LOST * n:
            return None
    repair_grid.begin_again(u, bounds, *geometry, lost, found[:count])
    return found[:count]


def _padded(grid: CartesianGrid, nodes: IntArray, *, columns: bool = False) -> IntArray:
    """Return the padded numbers of nodes; with ``columns`` those of the column of one axis."""
    strides = (3,) if columns else strides_of_padded(grid)
    index = np.unravel_index(nodes, grid.shape)
    padded = sum((i + 1) * stride for i, stride in zip(index, strides, strict=True)) + columns
    return np.asarray(padded, dtype=np.int32)


def resume_grid_tracking(
    grid: CartesianGrid,
    earlier: TrackedSolution,
    problem: Problem,
    changes: Changes,
) -> Solution | None:
    """Track sources on a grid from the solution for other bounds.

    Parameters and result as for `adaptsize.limiting.warm_tracking.resume_source_tracking`.
    """
    before: grid_tracking.Memory = earlier.memory
    columns = grid.dim == 1
    changed = _padded(grid, changes.nodes, columns=columns)
    lowered = _padded(grid, changes.lowered, columns=columns)
    bounds = before.bounds.copy()
    bounds[changed] = problem.h0.ravel()[changes.nodes]
    segments = _segments(bounds, before.geometry, changed)
    if problem.face_sources and segments.any() and before.tracks.end.size == 1:
        return None
    pairs = _pairs(before.tracks)
    fate = _fates(before, pairs, changed, lowered)
    back = np.flatnonzero(fate == _BACK).astype(np.int32)
    if len(back) > _MOST * grid.n_points:
        return None
    u = before.u.copy()
    tracks = before.tracks._replace(
        source=before.tracks.source.copy(), end=before.tracks.end.copy()
    )
    u[back], tracks.source[back] = bounds[back], back
    seeds = np.zeros(u.size, np.bool_)
    if tracks.end.size > 1:
        _mend_ends(before.geometry, bounds, tracks, np.union1d(back, changed).astype(np.int32))
    _begin_around(grid, before.geometry, u, bounds, tracks, back, lowered, seeds)
    if tracks.end.size > 1:
        _mark_served(before.geometry, u, bounds, tracks, pairs, lowered, fate, seeds)
    started = np.flatnonzero(seeds).astype(np.int32)
    accepted = grid_tracking.accept_all(
        grid, u, bounds, before.geometry, tracks, grid_tracking.POLISH, started, problem.report
    )
    slope = float(problem.slope.values[0])
    memory = before._replace(u=u, bounds=bounds, tracks=tracks)
    return grid_tracking.finish(grid, memory, slope, accepted, residual=problem.residual)


def _segments(bounds: FloatArray, geometry: grid_tracking.Geometry, nodes: IntArray) -> BoolArray:
    """Tell which nodes and one of their neighbours have finite bounds."""
    beside = np.zeros(len(nodes), np.bool_)
    for step in geometry.steps:
        beside |= np.isfinite(bounds[nodes + step])
    return beside & np.isfinite(bounds[nodes])


def _fates(
    before: grid_tracking.Memory, pairs: IntArray, changed: IntArray, lowered: IntArray
) -> npt.NDArray[np.uint8]:
    """Return `_BACK` for nodes whose size goes back to a changed bound, or is above their own."""
    marks = np.zeros(before.u.size, np.bool_)
    marks[changed] = True
    fate = np.zeros(before.u.size, np.uint8)
    fate[lowered] = _BACK  # and so what bends there
    repair.find_dependents(pairs, np.empty((1, 7)), marks, fate)
    for _ in range(_RINGS):
        around = np.zeros(before.u.size, np.bool_)
        nodes = np.flatnonzero(fate == _BACK).astype(np.int32)
        repair_grid.mark_around(nodes, before.geometry.steps, around)
        around &= ~np.isnan(before.u)
        fate[around] = _BACK
    return fate


def _pairs(tracks: grid_tracking.Tracks) -> IntArray:
    """Return sources as rows of nodes."""
    if tracks.end.size == 1:
        return tracks.source[:, None]
    return np.column_stack([tracks.source, tracks.end])


def _mend_ends(
    geometry: grid_tracking.Geometry,
    bounds: FloatArray,
    tracks: grid_tracking.Tracks,
    nodes: IntArray,
) -> None:
    """Tell anew of nodes that are their own sources whether segments begin there."""
    marks = np.zeros(bounds.size, np.bool_)
    repair_grid.mark_around(nodes, geometry.steps, marks)
    near = np.flatnonzero(marks & (tracks.source == np.arange(bounds.size))).astype(np.int32)
    near = near[~np.isnan(bounds[near])]
    tracks.end[near] = np.where(_segments(bounds, geometry, near), -1, -2)


def _begin_around(
    grid: CartesianGrid,
    geometry: grid_tracking.Geometry,
    u: FloatArray,
    bounds: FloatArray,
    tracks: grid_tracking.Tracks,
    back: IntArray,
    lowered: IntArray,
    seeds: BoolArray,
) -> None:
    """Begin as a full solution does around changes (In/Out: u, tracks, seeds)."""
    marks = np.zeros(u.size, np.bool_)
    repair_grid.mark_around(lowered, geometry.steps, marks)
    marks[back] = True
    marks[np.isnan(bounds)] = False
    nodes = np.flatnonzero(marks).astype(np.int32)
    source_before = tracks.source[nodes]
    least_distance = float(1.0 / np.sqrt((1.0 / grid.spacing**2).sum()))
    repair_grid.start_at(
        nodes,
        u,
        bounds,
        geometry.steps,
        geometry.offsets,
        geometry.n_axes,
        geometry.slope,
        tracks.source,
        tracks.end,
        tracks.hidden,
        grid_tracking.KEEP,
        least_distance,
    )
    seeds[nodes[tracks.source[nodes] != source_before]] = True
    if tracks.end.size == 1:
        _offer(grid, geometry, u, bounds, tracks, back, seeds)
    # What is around hands on its sources.
    repair_grid.mark_around(back, geometry.steps, seeds)
    seeds &= tracks.source != np.arange(u.size)


def _offer(
    grid: CartesianGrid,
    geometry: grid_tracking.Geometry,
    u: FloatArray,
    bounds: FloatArray,
    tracks: grid_tracking.Tracks,
    back: IntArray,
    seeds: BoolArray,
) -> None:
    """Let isolated sources offer themselves where nodes begin anew (In/Out: u, tracks, seeds)."""
    finite = np.flatnonzero(np.isfinite(bounds)).astype(np.int32)
    reach = grid_tracking.reach_of(grid, finite.size)
    if reach < 1 or len(back) == 0:
        return
    # Coarse boxes with such nodes, and those beside.
    shape = grid.shape if grid.dim > 1 else (grid.shape[0], 1)
    padded = tuple(n + 2 for n in shape)
    coarse = np.zeros([n // reach + 3 for n in padded], np.bool_)
    box = tuple(i // reach + 1 for i in np.unravel_index(back, padded))
    for shift in np.ndindex(*(3,) * len(shape)):
        coarse[tuple(i + s - 1 for i, s in zip(box, shift, strict=True))] = True
    near = coarse[tuple(i // reach + 1 for i in np.unravel_index(finite, padded))]
    sources = finite[near]
    sources = sources[np.argsort(bounds[sources], kind="stable")]
    before = u.copy()
    offer_around(
        u,
        geometry.strides,
        geometry.per_stride,
        shape,
        geometry.spacing,
        geometry.slope,
        sources,
        reach,
        tracks.source,
        tracks.clear,
        tracks.hidden,
        grid_tracking.KEEP,
    )
    seeds |= u < before


def _mark_served(
    geometry: grid_tracking.Geometry,
    u: FloatArray,
    bounds: FloatArray,
    tracks: grid_tracking.Tracks,
    pairs: IntArray,
    lowered: IntArray,
    fate: npt.NDArray[np.uint8],
    seeds: BoolArray,
) -> None:
    """Have nodes polished again whose source is beside a fallen bound (In/Out: tracks, seeds)."""
    marks = np.zeros(u.size, np.bool_)
    repair_grid.mark_around(lowered, geometry.steps, marks)
    found = np.empty(u.size, np.int32)
    count = repair.find_served_from(pairs, marks, fate, found)
    served = found[:count]
    served = served[tracks.source[served] != served]
    single = served[tracks.end[served] == -2]
    own = u[tracks.source[single]] == bounds[tracks.source[single]]
    tracks.end[single[own]] = -1
    seeds[served] = True
