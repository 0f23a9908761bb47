"""Warm start: check that only bounds differ from an earlier call, and reuse its solution."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting.exact import ExactSolution, solve_exact_again
from adaptsize.limiting.gradient_limit import SizeTransform
from adaptsize.limiting.solution import Solution

if TYPE_CHECKING:
    from adaptsize.limiting.info import LimitingInfo, Record
    from adaptsize.limiting.problem import Problem


def resume(
    record: Record, method: str, problem: Problem, transform: SizeTransform | None
) -> Solution | None:
    """Return the solution of a problem, computed from that of an earlier one.

    None if the method does not support this, or not in this case.  The problem must then be
    solved from scratch.
    """
    if transform is not record.transform:  # sizes below those of the table
        return None
    if not isinstance(record.solution, ExactSolution):
        return None
    if problem.point_sources is not None or record.problem.point_sources is not None:
        return None
    return solve_exact_again(
        record.domain,
        problem.h0,
        problem.slope,
        record.solution,
        face_sources=problem.face_sources,
        threads=problem.threads,
        report=problem.report,
    )


def refuse_others(
    info: LimitingInfo,
    background: SimplexMesh | CartesianGrid | Octree,
    method: str,
    problem: Problem,
    transform: SizeTransform | None,
) -> None:
    """Raise a ValueError if the earlier call differs in more than the bounds."""
    before = info.record.problem
    if info.method != method:
        raise ValueError(
            f"initial must come from the same method: it is of method={info.method!r}, "
            f"this call of method={method!r}"
        )
    refuse_background(info.record, background)
    then, now = info.record.transform, transform
    same = then is now or (then is not None and now is not None and then.is_same_limit(now))
    if not (same and _equal(before.slope.values, problem.slope.values)):
        raise ValueError("initial must come from a call with the same g, got a different g")
    if before.periodicity is not None:
        raise ValueError("initial must not come from a call with periodic")
    for name in ("order", "face_sources", "floor"):
        then, now = getattr(before, name), getattr(problem, name)
        if then != now:
            raise ValueError(f"initial must come from a call with {name}={now!r}, got {then!r}")


def refuse_background(record: Record, background: SimplexMesh | CartesianGrid | Octree) -> None:
    """Raise a ValueError if the earlier call had another background."""
    if not is_same(record.background, background):
        raise ValueError(
            f"initial must come from the same background: it is of {record.background!r}, "
            f"this call of {background!r}; leave it out after remeshing"
        )


def with_start(record: Record | None, method: str, problem: Problem) -> Problem:
    """Return the problem, with the earlier sizes as start if the iteration allows any start."""
    if record is None or method != "hamilton-jacobi":
        return problem
    start = record.solution.h
    if np.isinf(start[np.isfinite(problem.h0)]).any():
        return problem  # a component had no bound
    return replace(problem, initial=np.minimum(start, problem.h0))


def is_same(a: object, b: object) -> bool:
    """Return whether two backgrounds have the same nodes and cells."""
    if a is b:
        return True
    if isinstance(a, SimplexMesh) and isinstance(b, SimplexMesh):
        return _equal(a.points, b.points) and _equal(a.cells, b.cells)
    if isinstance(a, Octree) and isinstance(b, Octree):
        return (
            a.root_shape == b.root_shape
            and _equal(a.lower, b.lower)
            and _equal(a.upper, b.upper)
            and _equal(a.levels, b.levels)
        )
    if isinstance(a, CartesianGrid) and isinstance(b, CartesianGrid):
        return (
            a.shape == b.shape
            and _equal(a.origin, b.origin)
            and _equal(a.spacing, b.spacing)
            and (a.active is None) == (b.active is None)
            and (a.active is None or _equal(a.active, b.active))
        )
    return False


def _equal(a: object, b: object) -> bool:
    return a is b or bool(np.array_equal(a, b))  # type: ignore[arg-type]
