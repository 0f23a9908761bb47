"""Source tracking on simplices from the sizes for slightly different bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import repair
from adaptsize._kernels.track import polish_again, start_from_cells
from adaptsize.limiting.changes import Changes
from adaptsize.limiting.source_tracking import (
    KEEP,
    POLISH,
    TrackedSolution,
    Tracks,
    Work,
    as_tracked,
    empty_heap,
    finish,
    follow,
)
from adaptsize.limiting.warm_marching import resume_edge_based
from adaptsize.typing import IntArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.problem import Problem

# With more nodes to track anew than this share of all, a start from nothing is as quick.
_MOST = 0.5

# Rounds of looking for nodes whose source has fallen further than they have.
_ROUNDS = 3

# Nodes that begin anew.
_BACK = 2


def resume_source_tracking(
    mesh: SimplexMesh, earlier: TrackedSolution, problem: Problem, changes: Changes
) -> TrackedSolution | None:
    """Track sources from the solution for other bounds.

    Nodes whose size goes back to a changed bound, be it lower or higher, are put back; they and
    the nodes around changes begin as in `solve_source_tracking`, and take the sources of their
    neighbours.

    Parameters
    ----------
    mesh : SimplexMesh
    earlier : TrackedSolution
        Of the same mesh and slope.
    problem : Problem
    changes : Changes
        Of ``problem.h0``.

    Returns
    -------
    TrackedSolution or None
        None if it is not worth while.

    Notes
    -----
    Every candidate is admissible, as in a full solution, so that errors cannot add up.
    """
    if mesh.dim == 1:
        along = resume_edge_based(mesh, earlier, problem, changes)
        return None if along is None else as_tracked(along)
    before: Tracks | None = earlier.memory
    if before is None or before.near.ring.size == 0:
        return None
    fate = _fates(before, changes, mesh.n_points)
    back = np.flatnonzero(fate == _BACK).astype(np.int32)
    if len(back) > _MOST * mesh.n_points:
        return None
    h0, slope = problem.h0, float(problem.slope.values[0])
    work = Work(before.axes, before.state.copy(), before.source.copy(), empty_heap(mesh.n_points))
    work.state[back, mesh.dim] = h0[back]
    work.source[back] = -1
    work.source[back, 0] = back
    contested = np.zeros(mesh.n_points, np.uint8)
    dense = _begin_around(mesh, work, before, problem, changes, back, contested)
    tracks = before._replace(
        state=work.state, source=work.source, bent=before.bent.copy(), dense=before.dense or dense
    )
    moves = POLISH if tracks.dense and problem.face_sources else 0
    if moves > 0:
        _polish_around(mesh, work, tracks, problem, changes, fate)
    taken = follow(work, tracks, h0, slope, moves, contested, problem.report)
    for _ in range(_ROUNDS):
        fell = work.state[:-1, mesh.dim] < earlier.h
        repair.queue_behind_lowered(
            work.state, work.axes, slope, work.source, fell, KEEP, *work.heap
        )
        if work.heap[3][0] == 0:
            break
        taken += follow(work, tracks, h0, slope, moves, contested, problem.report)
    return finish(mesh, work, tracks, h0, slope, taken, residual=problem.residual)


def _fates(before: Tracks, changes: Changes, n: int) -> npt.NDArray[np.uint8]:
    """Return `_BACK` for nodes whose size goes back to a changed bound, or is above their own."""
    changed = np.zeros(n, np.bool_)
    changed[changes.nodes] = True
    fate = np.zeros(n, np.uint8)
    fate[changes.lowered] = _BACK  # and so what bends there
    repair.find_dependents(before.source, before.bent, changed, fate)
    return fate


def _begin_around(
    mesh: SimplexMesh,
    work: Work,
    before: Tracks,
    problem: Problem,
    changes: Changes,
    back: IntArray,
    contested: npt.NDArray[np.uint8],
) -> bool:
    """Begin as a full solution does in the cells around (In/Out: work, contested).

    Returns whether two neighbours have finite bounds there.
    """
    n, slope = mesh.n_points, float(problem.slope.values[0])
    cells = Surroundings(mesh, before)
    cells.add(back)
    rim = cells.nodes.copy()
    rim[back] = False
    cells.add(changes.nodes)
    around = np.flatnonzero(cells.nodes).astype(np.int32)
    sizes = work.state[around, mesh.dim]
    dense = start_from_cells(
        work.axes,
        mesh.cells[np.concatenate(cells.found)],
        problem.h0,
        slope,
        problem.face_sources,
        KEEP,
        work.state,
        work.source,
    )
    fell = around[work.state[around, mesh.dim] < sizes]
    # The nodes at the rim hand on their sources, which are as good as they get.
    rim[fell] = False
    others = np.flatnonzero(rim).astype(np.int32)
    others = others[work.state[others, mesh.dim] < problem.h0[others]]
    contested[others] = 2
    h = np.ascontiguousarray(work.state[:n, mesh.dim])
    repair.queue(h, np.concatenate([fell, others]), *work.heap)
    return bool(dense)


def _polish_around(
    mesh: SimplexMesh,
    work: Work,
    tracks: Tracks,
    problem: Problem,
    changes: Changes,
    fate: npt.NDArray[np.uint8],
) -> None:
    """Look for better sources where a bound beside a source fell (In/Out: work)."""
    n, near = mesh.n_points, tracks.near
    cells = Surroundings(mesh, tracks)
    cells.add(changes.lowered)
    found = np.empty(n, np.int32)
    count = repair.find_served_from(work.source, cells.nodes, fate, found)
    refused = np.full((1 if tracks.convex else n + 1, mesh.dim), -1, np.int32)
    polish_again(
        work.state,
        work.axes,
        near.nbr_ptr,
        near.nbr,
        near.cells,
        near.ring_ptr,
        near.ring,
        near.patch,
        near.clearance,
        problem.h0,
        float(problem.slope.values[0]),
        work.source,
        refused,
        *work.heap,
        found[:count],
        not tracks.convex,
        POLISH,
    )


class Surroundings:
    """Cells around nodes, and the nodes of these cells."""

    def __init__(self, mesh: SimplexMesh, tracks: Tracks) -> None:
        self.nodes = np.zeros(mesh.n_points, np.bool_)
        self.found: list[IntArray] = []
        self._marks = np.zeros(mesh.n_cells, np.bool_)
        self._mesh, self._near = mesh, tracks.near

    def add(self, nodes: IntArray) -> None:
        """Add the cells around more nodes."""
        room = np.empty(self._mesh.n_cells, np.int32)
        count = repair.cells_around(
            self._near.ring_ptr,
            self._near.ring,
            nodes,
            self._marks,
            self.nodes,
            self._mesh.cells,
            room,
        )
        self.found.append(room[:count])
