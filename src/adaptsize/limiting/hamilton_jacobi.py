"""The Hamilton-Jacobi iteration on Cartesian grids, as a limiter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.hamilton_jacobi import iterate_hamilton_jacobi
from adaptsize.background.padding import pad, strides_of_padded, unpad
from adaptsize.limiting.solution import Solution
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid

# Order 1 is monotone up to 1.  Order 2 needs the damping of long steps: at 0.5 the switches
# of its differences keep it from settling below a rate of about 1e-4 g.
_CFL = 0.9
_WORK_PER_CHUNK = 5e7  # nodes, times axes: about 0.1 s between two progress calls


def solve_hamilton_jacobi(
    grid: CartesianGrid,
    h0: FloatArray,
    slope_values: FloatArray,
    *,
    start: FloatArray,
    order: int,
    tol: float,
    max_iter: int | None,
    report: ProgressCallback,
    cfl: float = _CFL,
) -> Solution:
    r"""Iterate :math:`h_t + |\nabla h| = g` below the obstacle h0 to steady state.

    The largest h with :math:`h \le h_0` and :math:`|\nabla h| \le g` solves
    :math:`\max(|\nabla h| - g, h - h_0) = 0`.  One step of the iteration is

    .. math:: h \leftarrow \min\bigl(h_0,\; h - \Delta t\,(D(h) - g)\bigr)

    with D the Godunov upwind value of the gradient: along each axis the steeper of the two
    falls towards a neighbour, where there is one.  Boundaries need no treatment, as a
    missing neighbour adds nothing.  At order 2 the differences are corrected by ENO second
    differences [2]_ and the step is one of the third-order TVD Runge-Kutta method [3]_.

    Parameters
    ----------
    grid : CartesianGrid
        1-D, 2-D or 3-D; nodes with ``active`` False take no part.
    h0 : float64[shape]
        inf allowed; not read at inactive nodes.
    slope_values : float64[shape] or float64[1]
        g(x), per node or one for all, >= 0.  A limit g(h) must have been removed by the
        change of variable of `SizeTransform`; h0 and start are then the transformed ones.
    start : float64[shape]
        Start values, lowered to ``h0`` where they are above.  Finite wherever the limited
        size is; nodes that are inf here take no part and stay inf (a component without a
        bound).
    order : int
        1 or 2.
    tol : float
        Stop when no node changes faster than ``tol`` times the largest g per unit of time.
    max_iter : int or None
        Most steps.  None: what ten crossings of the grid take, and 200.
    report : callable
    cfl : float
        :math:`\Delta t \sqrt{\sum_a 1/\Delta x_a^2}`, at most 1.  The published
        :math:`\Delta t = \Delta x/2` [1]_ is half the root of the dimension.

    Returns
    -------
    Solution
        ``h <= h0``; inf at inactive nodes.  ``residual`` is the last largest rate of change
        over the largest g; ``converged`` is False if ``max_iter`` steps did not meet ``tol``.

    Notes
    -----
    *Obstacle form.*  The published iteration [1]_,
    :math:`h + \Delta t\,(\min(D, g) - D)` from h0, can only lower.  It is at rest at *any*
    field that is nowhere too steep, so that what a start has too low stays too low, and an
    overshoot of order 2 on the way freezes: on the model problem of two sources on 101 x
    101 nodes its error at order 2 is 0.084 from a fast marching start and 0.25 from a
    constant.  The obstacle form has the same solution above a start that is too high, but
    also rises where it is too low, at the rate g: it has one steady state, whatever the
    start (at order 2: no start was found to change it), and 0.096 on that problem.  So a
    solution for a slightly different h0, too high here and too low there, is a good
    start, and a constant is a valid one.  Only where g = 0 a start that is too low stays.

    *Ridges.*  Where a node has two lower neighbours along an axis, [1]_ adds both squares.
    The steeper one alone is the Godunov flux; its steady state at order 1 is that of fast
    marching, which solves the same quadratic equation node by node.

    *Order and guarantees.*  No size falls below the least of ``h0`` and ``start``.  Order 1 is
    monotone: a smaller h0 or g gives a smaller h; and D <= g (1 + tol) at every node when it
    stops.  Order 2 is not monotone.  It is of second order where the solution is smooth, also
    at the edge of the set where h = h0, where no undershoot was seen; of first order at
    bare point sources, and where fronts meet, which is where it undershoots (on the model
    problem by 0.012 of 25, order 1 by 0.007).  Forward Euler diverges with its
    differences, and the second-order Runge-Kutta step does not come to rest, whence the
    third-order one.

    *Cost.*  Information travels less than one node per step, so that the steps are those of
    the longest way from a bound to what it limits: :math:`O(n^{1 + 1/d})` in all for n nodes
    in d dimensions if the bounds are few, and near O(n) where h0 is nearly limited already
    or ``start`` is close and the change local.  A bound changed by a little is not found
    faster than one changed by much: the news has the same way to go.  Fast marching is
    O(n log n) always; choose the iteration for a good start, for short ways, or for its
    second order.  Memory: 3 arrays of the grid at order 1, 4 at order 2, and one more if g
    varies.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, eqs. (16), (17).
    .. [2] S. Osher, C.-W. Shu, "High-order essentially nonoscillatory schemes for
       Hamilton-Jacobi equations", SIAM J. Numer. Anal. 28 (1991) 907-922.
    .. [3] C.-W. Shu, S. Osher, "Efficient implementation of essentially non-oscillatory
       shock-capturing schemes", J. Comput. Phys. 77 (1988) 439-471.
    """
    takes_part = np.isfinite(start)
    if grid.active is not None:
        takes_part &= grid.active
    weights = grid.spacing**-2.0
    dt = cfl / math.sqrt(float(weights.sum()))
    if max_iter is None:
        diagonal = float(np.linalg.norm((np.array(grid.shape) - 1) * grid.spacing))
        max_iter = 10 * math.ceil(diagonal / dt) + 200

    strides = np.array(strides_of_padded(grid, order))
    bound = pad(grid, h0, order, takes_part)
    varies = slope_values.shape == grid.shape
    g = pad(grid, slope_values, order, takes_part) if varies else slope_values.copy()
    fastest = dt * float(np.fmax.reduce(g))
    rows = (_rows(takes_part, strides, order), grid.shape[-1], strides)
    problem = (bound, g, int(varies), *rows, weights, order, dt, tol * fastest)
    u = pad(grid, np.minimum(start, h0), order, takes_part)
    taken, u, change = _iterate(u, problem, max_iter, report)

    rate = change / fastest if fastest > 0.0 else change
    unfinished = ""
    if change > tol * fastest:
        unfinished = (
            f"the Hamilton-Jacobi iteration stopped after max_iter = {max_iter} steps with "
            f"residual {rate:.2g}, above tol = {tol:g}: give more steps, a start nearer to the "
            "solution, or method='fast-marching'"
        )
    h = np.where(takes_part, unpad(grid, u, order), np.inf)
    return Solution(h, taken, rate, unfinished)


def _iterate(
    u: FloatArray, problem: tuple[Any, ...], max_iter: int, report: ProgressCallback
) -> tuple[int, FloatArray, float]:
    """Take steps from ``u``, which is overwritten; return their number, h, the last change."""
    _, _, _, rows, n_row, strides, _, order, _, _ = problem
    spare = np.full_like(u, np.nan)
    stage = np.full_like(u, np.nan) if order == 2 else spare
    work = len(rows) * n_row * len(strides) * (1 if order == 1 else 6)
    chunk = max(1, int(_WORK_PER_CHUNK / max(work, 1)))
    taken, moving = 0, 1
    while moving and taken < max_iter:
        steps, moving = iterate_hamilton_jacobi(
            min(chunk, max_iter - taken), u, spare, stage, problem
        )
        if steps % 2:
            u, spare = spare, u
        taken += steps
        report("Hamilton-Jacobi iteration", taken / max_iter)
    np.subtract(u, spare, out=spare)
    np.abs(spare, out=spare)
    return taken, u, float(np.fmax.reduce(spare, initial=0.0))


def _rows(
    takes_part: BoolArray, strides: npt.NDArray[np.int64], width: int
) -> npt.NDArray[np.int64]:
    """Return where the rows along the last axis begin, of those with nodes that take part."""
    index = np.argwhere(takes_part.any(axis=-1)) + width
    begin: npt.NDArray[np.int64] = index @ strides[:-1] + width
    return begin
