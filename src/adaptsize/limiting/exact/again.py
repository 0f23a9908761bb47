"""Exact limiting after few bounds have changed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize.limiting.exact.field import ExactField
from adaptsize.limiting.exact.problem import Problem
from adaptsize.limiting.exact.solve import Found, rises_too_fast, sources_at_nodes
from adaptsize.limiting.exact.waves import Wave
from adaptsize.typing import BoolArray


def solve_again(problem: Problem, before: Found) -> Found | None:
    """Solve a problem that differs from an earlier one by its bounds.

    A size remains the minimum over the entries that existed before; only new entries need to be
    tested.  Nodes whose own bound changed, or whose source was removed, are recomputed.  The
    result is the minimum of the same numbers as in `solve_on_mesh`, and equal bit for bit.

    Returns
    -------
    Found or None
        None if bounds meet in cells, in solids that are not convex, and around folds.  These
        cases are solved from scratch.
    """
    if before.points is None or len(before.field.waves) != 1 or before.proved is not None:
        return None
    plane = None if before.plane is None else before.plane.without_sizes()
    wave = sources_at_nodes(problem, plane)
    if wave is None:
        return None
    old = before.field.waves[0]
    now = _matches(old, wave)
    h0, earlier = problem.h0, before.source
    own = earlier < 0
    now = np.append(now, np.int32(-1))  # for nodes that kept their bound
    anew: BoolArray = np.where(own, h0 != before.h, now[earlier] < 0) | (h0 < before.h)
    h = np.where(anew, h0, before.h)
    source = np.where(anew, np.int32(-1), now[earlier]).astype(np.int32)
    field = ExactField(problem.g, before.field.sight, linear=False, waves=[wave])
    points = before.points
    some = points._replace(order=points.order[anew[points.order]])
    field.lower_by_last(some, h, source, problem.threads, problem.report)
    fresh = np.ones(len(wave.nodes), np.bool_)
    fresh[now[now >= 0]] = False
    if fresh.any():
        rest = points._replace(order=points.order[~anew[points.order]])
        field.lower_by_some(fresh, rest, h, source, problem.threads, problem.report)
    if plane is not None and rises_too_fast(problem, h):
        return None
    return Found(h, source, field, plane=plane, points=points)


def _matches(old: Wave, new: Wave) -> npt.NDArray[np.int32]:
    """Return the number of each entry of a wave in another wave, -1 if it is not there."""
    rows = [_rows(old), _rows(new)]
    _, number = np.unique(np.concatenate(rows), return_inverse=True)
    number = number.ravel()
    at = np.full(number.max(initial=-1) + 1, -1, np.int32)
    at[number[len(rows[0]) :]] = np.arange(len(rows[1]))
    now: npt.NDArray[np.int32] = at[number[: len(rows[0])]]
    return now


def _rows(wave: Wave) -> npt.NDArray[np.void]:
    """Return one value for each entry that identifies it."""
    flat = np.column_stack([wave.nodes.astype(np.float64), wave.table]) + 0.0
    return np.ascontiguousarray(flat).view(np.dtype((np.void, flat.shape[1] * 8))).ravel()
