"""The schemes for Cartesian grids."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from adaptsize.limiting.edge_based import solve_grid_edges
from adaptsize.limiting.exact.images import solve_problem
from adaptsize.limiting.fast_marching_grid import solve_grid_marching
from adaptsize.limiting.periodic import in_rounds
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid
    from adaptsize.limiting.gradient_limit import Slope
    from adaptsize.limiting.problem import Problem

METHODS = ("exact", "fast-marching", "hamilton-jacobi", "edge-based")


def choose_method(grid: CartesianGrid, problem: Problem) -> str:
    """Return the method for ``method="auto"``: the most accurate scheme that applies."""
    cell = problem.periodicity
    if problem.slope.step or problem.order == 2 or not (cell is None or cell.is_convex):
        return "fast-marching"
    return "exact"


def solve(grid: CartesianGrid, method: str, problem: Problem) -> Solution:
    """Run one of METHODS."""
    h0, slope = problem.h0, problem.slope
    report = problem.report
    if method == "hamilton-jacobi":
        return _iterate(grid, problem)
    if method == "fast-marching":

        def march(bound: FloatArray) -> Solution:
            order = problem.order
            return solve_grid_marching(grid, bound, slope, order=order, report=report)

        return in_rounds(march, problem)
    if method == "edge-based":
        return solve_grid_edges(grid, h0, slope, report=report)
    return solve_problem(grid, problem)


def _iterate(grid: CartesianGrid, problem: Problem) -> Solution:
    """Run the Hamilton-Jacobi iteration from ``initial`` or from fast marching."""
    from adaptsize.limiting.hamilton_jacobi import solve_hamilton_jacobi

    h0, slope, start = problem.h0, problem.slope, problem.initial
    # Needed even with a start: its inf mark the nodes that are not connected to any bound.
    marched = solve_grid_marching(grid, h0, slope, order=1, report=problem.report).h
    if start is None:
        start = marched
    elif np.isinf(start[np.isfinite(marched)]).any():
        raise ValueError("initial must be finite in every component with a finite h0")
    solution = solve_hamilton_jacobi(
        grid,
        h0,
        slope.values,
        start=np.where(np.isinf(marched), np.inf, start),
        order=problem.order,
        tol=problem.tol,
        max_iter=problem.max_iter,
        report=problem.report,
    )
    if problem.order == 1:
        return solution
    kept = solve_grid_edges(grid, solution.h, slope, report=problem.report)
    return replace(solution, h=kept.h)


def slopes(grid: CartesianGrid, u: FloatArray, slope: Slope) -> tuple[float, FloatArray]:
    """Return the steepest edge and |grad u| at the centre of each box, as multiples of g.

    On an edge, g is taken at the end of larger size, as in the update of that node.
    """
    g = np.broadcast_to(
        slope.values.reshape((1,) * grid.dim) if not slope.step else slope.values, grid.shape
    )
    steepest = 0.0
    squares = np.zeros([n - 1 for n in grid.shape])
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(grid.dim):
            lower, upper = _ends(u, axis)
            rise = (upper - lower) / grid.spacing[axis]
            at_upper = np.where(rise > 0.0, _ends(g, axis)[1], _ends(g, axis)[0])
            ratio = np.abs(rise) / at_upper
            ratio = ratio[np.isfinite(rise) & (rise != 0.0)]
            steepest = max(steepest, float(ratio.max(initial=0.0)))
            squares += _mean_across(rise, axis) ** 2
        norms = np.sqrt(squares)
        ratio = np.where(norms > 0.0, norms / _mean_of_corners(g), 0.0)
    # Boxes at inf or inactive nodes have no gradient.
    return steepest, ratio[np.isfinite(norms)]


def _ends(values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return the values at both ends of the edges along an axis."""
    n = values.shape[axis]
    return values.take(range(n - 1), axis), values.take(range(1, n), axis)


def _mean_across(along: FloatArray, axis: int) -> FloatArray:
    """Average values on the edges along an axis over the edges of each box."""
    for other in range(along.ndim):
        if other != axis:
            first, last = _ends(along, other)
            along = 0.5 * (first + last)
    return along


def _mean_of_corners(values: FloatArray) -> FloatArray:
    """Average nodal values over the corners of each box."""
    for axis in range(values.ndim):
        first, last = _ends(values, axis)
        values = 0.5 * (first + last)
    return values
