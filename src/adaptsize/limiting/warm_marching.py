"""Fast marching on simplices from the sizes for slightly different bounds."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsize._kernels import march as kernels
from adaptsize._kernels import repair
from adaptsize.limiting.changes import Changes
from adaptsize.limiting.fast_marching import CHUNK, accept_all, patience, residual_of, stars_of
from adaptsize.limiting.solution import Solution

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.problem import Problem

# With more nodes without support than this share of all, a start from nothing is as quick.
_MOST = 0.5


def resume_fast_marching(
    mesh: SimplexMesh, earlier: Solution, problem: Problem, changes: Changes
) -> Solution | None:
    """Solve the equations of `solve_fast_marching` from the solution for other bounds.

    Nodes whose bound fell are fronts.  Where bounds rose, the nodes that no other node
    supports any more are looked for, in order of size, put back, and marched anew.

    Parameters
    ----------
    mesh : SimplexMesh
    earlier : Solution
        By this scheme, of the same mesh and slope.
    problem : Problem
    changes : Changes
        Of ``problem.h0``.

    Returns
    -------
    Solution or None
        That of `solve_fast_marching` to rounding, as the equations have only one where g > 0;
        None if it is not worth while, or if obtuse slivers make nodes depend on each other in
        circles.

    Notes
    -----
    The work is proportional to the nodes whose size is another one, and their neighbours, but for
    some passes over plain arrays.
    """
    return _resume(mesh, earlier, problem, changes, False)


def resume_edge_based(
    mesh: SimplexMesh, earlier: Solution, problem: Problem, changes: Changes
) -> Solution | None:
    """Do for `solve_edge_based` what `resume_fast_marching` does for `solve_fast_marching`."""
    return _resume(mesh, earlier, problem, changes, True)


def _resume(
    mesh: SimplexMesh, earlier: Solution, problem: Problem, changes: Changes, edges: bool
) -> Solution | None:
    n, slope = mesh.n_points, problem.slope
    stars = earlier.memory if earlier.memory is not None else stars_of(mesh, slope)
    march = kernels.march_edges if edges else kernels.march
    sweep = kernels.sweep_edges if edges else kernels.sweep_cells
    geometry = (mesh.points, (0,) * mesh.dim, (0,) * mesh.cell_dim, *stars)
    h = earlier.h.copy()
    h[changes.lowered] = problem.h0[changes.lowered]
    heap = (np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64))
    if not _take_back(geometry, h, problem, heap, changes.raised, edges):
        return None
    repair.queue(h, changes.lowered, *heap)
    most = None if edges else patience(n)
    accepted = accept_all(march, geometry, h, slope, heap, most, problem.report)
    if heap[3][0] > 0:
        return None
    residual = partial(residual_of, mesh, slope, h, sweep) if problem.residual else 0.0
    return Solution(h, accepted, residual, memory=stars)


def _take_back(
    geometry: tuple[Any, ...],
    h: np.ndarray[Any, np.dtype[np.float64]],
    problem: Problem,
    heap: tuple[Any, ...],
    raised: np.ndarray[Any, np.dtype[np.int32]],
    edges: bool,
) -> bool:
    """Put nodes without support back (In/Out: h) and into the heap (In/Out).

    Returns False, and leaves the work unfinished, if they are too many.
    """
    if len(raised) == 0:
        return True
    n = len(h)
    given = (h, problem.h0, problem.slope.values, problem.slope.step, edges)
    lost, found, count = np.zeros(n, np.bool_), np.empty(n, np.int32), 0
    waiting, suspect, ends = (
        np.zeros(n, np.bool_),
        np.empty(n, np.int32),
        np.array([0, len(raised)]),
    )
    suspect[: len(raised)] = raised[np.argsort(h[raised], kind="stable")]
    waiting[raised] = True
    while ends[1] > 0:
        count = repair.find_lost(
            *geometry, *given, lost, found, count, suspect, waiting, ends, CHUNK
        )
        problem.report("limiting the gradient", None)
        if count > _MOST * n:
            return False
    repair.begin_again(*geometry, *given, *heap, lost, found[:count])
    return True
