"""The positive coefficient scheme of Barth and Sethian, as a limiter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels.barth_sethian import fill_hat_gradients, fill_residuals, smallest_altitude
from adaptsize._kernels.fast_marching import sweep_cells
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

_CFL = 0.5
_MOST_STEPS = 20_000


def solve_positive_coefficient(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: Slope,
    *,
    start: FloatArray,
    floor: bool,
    tol: float,
    max_iter: int | None,
    report: ProgressCallback,
) -> Solution:
    r"""Iterate the scheme [1]_ on :math:`h_t + \max(|\nabla h| - g, 0) = 0` to steady state.

    Each step computes ``h_i - dt R_i / W_i`` with the residuals of `fill_residuals`; dt is
    half the smallest altitude of the mesh.  The result is kept above the upstream values
    and, with ``floor``, above the smallest Hopf-Lax update of the node's cells.

    Parameters
    ----------
    mesh : SimplexMesh
    h0 : float64[n]
        inf allowed.
    slope : Slope
    start : float64[n]
        Start values, ``<= h0``.  Nodes that are inf here stay inf (a component without bound).
    floor : bool
        True: the result is the fast marching solution.  False: the scheme as
        published, which undershoots at point sources and does not converge to the
        limited size there.
    tol : float
        Stop when no size decreases faster than ``tol * g`` per unit of time.
    max_iter : int or None
        None: 20 diagonals over dt, 20000 at most.
    report : callable

    Returns
    -------
    Solution
        ``residual`` is the largest rate of change in the last step, divided by g.
        ``converged`` is False if ``max_iter`` steps did not meet ``tol``.

    References
    ----------
    .. [1] T. J. Barth, J. A. Sethian, J. Comput. Phys. 145 (1998) 1-40.
    """
    free = np.isinf(start)
    ceiling = np.where(free, 0.0, np.minimum(start, h0))  # free nodes share no cell with others
    u = ceiling.copy()
    measures = np.empty(mesh.n_cells)
    gradients = np.empty((*mesh.cells.shape, mesh.dim))
    fill_hat_gradients(mesh.points, mesh.cells, measures, gradients)
    altitude = float(smallest_altitude(measures, gradients))
    if np.isinf(altitude):  # no cell with a volume: nothing moves
        return Solution(np.where(free, np.inf, u), 0, 0.0)
    dt = _CFL * altitude
    if max_iter is None:
        max_iter = int(min(20.0 * mesh.diagonal / altitude, _MOST_STEPS)) + 1
    fastest = dt * float(slope.values.max())

    residual, weight, upstream = np.empty(u.shape), np.empty(u.shape), np.empty(u.shape)
    lowest = np.full(u.shape, -np.inf)
    rate = np.inf
    for step in range(1, max_iter + 1):
        bounds = (slope.values, slope.step)
        fill_residuals(mesh.cells, measures, gradients, u, *bounds, residual, weight, upstream)
        moved = u - dt * np.divide(residual, weight, out=np.zeros_like(u), where=weight > 0.0)
        moved = np.maximum(moved, np.minimum(upstream, u))
        if floor:
            sweep_cells(mesh.points, (0,) * mesh.dim, mesh.cells, u, *bounds, lowest)
            moved = np.maximum(moved, np.minimum(lowest, u))
        change = float((u - moved).max())
        rate = change / fastest if fastest > 0.0 else change
        u = moved
        if step % 50 == 0:
            report("positive coefficient scheme", step / max_iter)
        if rate < tol:
            return Solution(np.where(free, np.inf, u), step, rate)
    unfinished = (
        f"the positive coefficient scheme stopped after max_iter = {max_iter} steps with "
        f"residual {rate:.2g}, above tol = {tol:g}: give more steps, or method='fast-marching'"
    )
    return Solution(np.where(free, np.inf, u), max_iter, rate, unfinished)
