"""The schemes for simplex meshes, and for octrees through their conforming mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsize._kernels.edge_based import largest_edge_slope
from adaptsize._kernels.simplex import fill_gradient_norms
from adaptsize.limiting.edge_based import solve_edge_based
from adaptsize.limiting.exact.images import solve_problem
from adaptsize.limiting.fast_marching import solve_fast_marching
from adaptsize.limiting.periodic import in_rounds
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope
    from adaptsize.limiting.problem import Problem

METHODS = (
    "exact",
    "fast-marching",
    "positive-coefficient",
    "edge-based",
)
_DIRECT = {
    "fast-marching": solve_fast_marching,
    "edge-based": solve_edge_based,
}


def choose_method(mesh: SimplexMesh, problem: Problem) -> str:
    """Return the method for ``method="auto"``: the exact one where it applies."""
    is_flat = mesh.cell_dim == mesh.dim
    cell = problem.periodicity
    is_flat = is_flat and (cell is None or cell.is_convex)
    return "exact" if is_flat and not problem.slope.step else "fast-marching"


def solve(mesh: SimplexMesh, method: str, problem: Problem) -> Solution:
    """Run one of METHODS."""
    if method == "positive-coefficient":
        return _iterate(mesh, problem)
    if method == "exact":
        return solve_problem(mesh, problem)
    scheme = _DIRECT[method]
    options: dict[str, Any] = {"report": problem.report}
    return in_rounds(lambda bound: scheme(mesh, bound, problem.slope, **options), problem)


def _iterate(mesh: SimplexMesh, problem: Problem) -> Solution:
    """Run the positive coefficient scheme from ``initial`` or from fast marching."""
    from adaptsize.limiting.barth_sethian import solve_positive_coefficient

    h0, slope = problem.h0, problem.slope
    start = solve_fast_marching(mesh, h0, slope, report=problem.report).h
    if problem.initial is not None:
        if np.isinf(problem.initial[np.isfinite(start)]).any():
            raise ValueError("initial must be finite in every component with a finite h0")
        start = np.where(np.isinf(start), np.inf, np.minimum(problem.initial, h0))
    return solve_positive_coefficient(
        mesh,
        h0,
        slope,
        start=start,
        floor=problem.floor,
        tol=problem.tol,
        max_iter=problem.max_iter,
        report=problem.report,
    )


def slopes(mesh: SimplexMesh, u: FloatArray, slope: Slope) -> tuple[float, FloatArray]:
    """Return the steepest edge and |grad u| in each cell with a volume, as multiples of g."""
    axes = (0,) * mesh.dim
    steepest = largest_edge_slope(mesh.points, axes, mesh.cells, u, slope.values, slope.step)
    norms = np.empty(mesh.n_cells)
    fill_gradient_norms(mesh.points, mesh.cells, u, norms)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms > 0.0, norms / slope.values, 0.0)[mesh.measures > 0.0]
    return float(steepest), ratio
