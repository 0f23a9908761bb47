"""The positive coefficient scheme of Barth and Sethian, as a limiter."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from adaptsize._kernels.fast_marching import sweep_cells
from adaptsize._messages import Message
from adaptsize.background import AnyMesh, CartesianGrid, SimplexMesh
from adaptsize.background.interpolation import hat_gradients
from adaptsize.limiting import tuning
from adaptsize.limiting.fast_marching import cells_in, march_mesh
from adaptsize.limiting.problem import Problem, Scheme, Solution, checked_start
from adaptsize.options import Option


@dataclass(frozen=True)
class PositiveCoefficient(Scheme):
    r"""The scheme of Barth and Sethian on :math:`h_t + \max(|\nabla h| - g, 0) = 0`.

    Each step [1]_ computes ``h_i - dt R_i / W_i`` with the residuals and weights of the cells.  The
    result is kept above the upstream values.  The scheme works on meshes, and can only lower its
    start: ``initial``, by default the fast marching solution.

    *The equations as published have no unique solution.*  Where a cell has two downstream nodes,
    both are lowered until its gradient is g, whichever of the two ends up lower; larger bounds may
    give smaller sizes.  The floor leaves the equations of fast marching, so that the default start
    is the solution already, and one step confirms it.  See docs/limiting.md.

    Parameters
    ----------
    floor : "hopf-lax" or None
        ``"hopf-lax"`` keeps the sizes above the smallest Hopf-Lax update of the cells of a node;
        the result is then the fast marching solution, and dt is half of the smallest altitude at
        each node.  None is the scheme as published, with half of the smallest altitude of the mesh
        as dt; it undershoots at point sources and does not converge to the limited size there.
    tol : float, default 1e-3
        The iteration stops when no size decreases faster than ``tol * g`` per unit of time.
    max_iter : int, optional
        Largest number of steps, by default 10 diagonals over dt, 20000 at most.

    References
    ----------
    .. [1] T. J. Barth, J. A. Sethian, J. Comput. Phys. 145 (1998) 1-40.
    """

    name: ClassVar[str] = "positive-coefficient"
    optional: ClassVar[frozenset[str]] = frozenset({"initial"})
    floor: Annotated[Literal["hopf-lax"] | None, Option()] = "hopf-lax"
    tol: Annotated[float, Option(above=True)] = 1e-3
    max_iter: Annotated[int | None, Option(lower=1.0)] = None

    def supports(self, domain: AnyMesh | CartesianGrid) -> str:
        """Return which backgrounds the scheme needs."""
        return "" if isinstance(domain, SimplexMesh) else "a mesh"

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem; the residual is the largest rate of change, divided by g."""
        from adaptsize._kernels.barth_sethian import fill_residuals

        mesh = problem.mesh
        h0, slope, tol, max_iter = problem.h0, problem.slope, self.tol, self.max_iter
        start = checked_start(problem.initial, march_mesh(problem).h)
        free = np.isinf(start)
        ceiling = np.where(free, 0.0, np.minimum(start, h0))  # free nodes share no cell with others
        u = ceiling.copy()
        measures, gradients = hat_gradients(mesh)
        # 1 / |grad N_i| are the altitudes; gradients in flat cells are zero.
        steepness = np.sqrt(np.einsum("cvd,cvd->cv", gradients, gradients)).max(axis=1, initial=0.0)
        steepest = float(steepness.max(initial=0.0))
        if steepest == 0.0:  # no cell with a volume: nothing moves
            return Solution(np.where(free, np.inf, u), 0, 0.0)
        at_nodes = np.full(u.shape, 0.0 if self.floor else steepest)
        np.maximum.at(at_nodes, mesh.cells, steepness[:, None])
        dt = 0.5 / np.where(at_nodes > 0.0, at_nodes, steepest)
        if max_iter is None:
            max_iter = int(min(tuning.PASSES * mesh.diagonal * steepest, tuning.MOST_STEPS)) + 1
        fastest = float(slope.values.max())

        residual, weight, upstream = np.empty(u.shape), np.empty(u.shape), np.empty(u.shape)
        lowest = np.full(u.shape, -np.inf)
        rate = np.inf
        for step in range(1, max_iter + 1):
            bounds = (slope.values, slope.step)
            hats, out = (mesh.cells, measures, gradients), (residual, weight, upstream)
            fill_residuals(hats, u, bounds, out)
            moved = u - dt * np.divide(residual, weight, out=np.zeros_like(u), where=weight > 0.0)
            moved = np.maximum(moved, np.minimum(upstream, u))
            if self.floor:
                sweep_cells(cells_in(mesh), u, bounds, True, lowest)
                moved = np.maximum(moved, np.minimum(lowest, u))
            change = float(((u - moved) / dt).max())
            rate = change / fastest if fastest > 0.0 else change
            u = moved
            if step % 50 == 0:
                problem.report("positive coefficient scheme", step / max_iter)
            if rate < tol:
                return Solution(np.where(free, np.inf, u), step, rate)
        unfinished = Message(
            "the positive coefficient scheme stopped after max_iter = {} steps with residual "
            "{:.2g}, above tol = {:g}: give more steps, or {method:'fast-marching'}",
            *(max_iter, rate, tol),
        )
        return Solution(np.where(free, np.inf, u), max_iter, rate, unfinished)
