"""The Hamilton-Jacobi iteration on Cartesian grids, as a limiter."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from adaptsize._messages import Message
from adaptsize.background import AnyMesh, CartesianGrid
from adaptsize.background.marching import pad, strides_of_padded, unpad
from adaptsize.limiting import tuning
from adaptsize.limiting.fast_marching import march_grid
from adaptsize.limiting.problem import Problem, Scheme, Solution, checked_start
from adaptsize.options import Option
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class HamiltonJacobi(Scheme):
    r"""The iteration of :math:`h_t + |\nabla h| = g` below the obstacle h0 to steady state.

    The largest h with :math:`h \le h_0` and :math:`|\nabla h| \le g` solves
    :math:`\max(|\nabla h| - g, h - h_0) = 0`.  One step of the iteration is

    .. math:: h \leftarrow \min\bigl(h_0,\; h - \Delta t\,(D(h) - g)\bigr)

    where D is the Godunov upwind value of the gradient: along each axis it uses the steeper
    of the two descents towards a neighbour, if there is one.  Boundaries need no special
    treatment, because a missing neighbour contributes nothing.  At order 2 the differences
    are corrected by ENO second differences [2]_, and the time step is that of the
    third-order TVD Runge-Kutta method [3]_.

    The scheme works on grids.  It starts from fast marching, or from ``initial``.

    Parameters
    ----------
    order : int, default 1
        1 or 2.
    tol : float, default 1e-3
        The iteration stops when no node changes faster than ``tol`` times the largest g per unit
        of time.
    max_iter : int, optional
        Largest number of steps, by default the steps of ten crossings of the grid, plus 200.

    Notes
    -----
    *Obstacle form.*  The published iteration [1]_,
    :math:`h + \Delta t\,(\min(D, g) - D)` from h0, can only lower sizes.  *Any* field that is
    nowhere too steep is a steady state.  Hence a start that is too low stays too low, and an
    overshoot of order 2 during the iteration is permanent.  On the model problem of two
    sources on 101 x 101 nodes, its error at order 2 is 0.084 from a fast marching start and
    0.25 from a constant.  From a start that is too high, the obstacle form has the same
    solution.  Where the start is too low, it also rises, at the rate g.  It has one steady
    state for every start (at order 2, no start was found to change it), and an error of 0.096
    on that problem.  So the solution for a slightly different h0, too high at some nodes and
    too low at others, is a good start, and a constant is a valid one.  Only where g = 0, a
    start that is too low stays.

    *Ridges.*  Where a node has two lower neighbours along an axis, [1]_ adds both squares.
    The steeper one alone is the Godunov flux.  Its steady state at order 1 is that of fast
    marching, which solves the same quadratic equation node by node.

    *Order and guarantees.*  No size falls below the minimum of ``h0`` and ``initial``.  Order 1
    is monotone: a smaller h0 or g gives a smaller h.  When it stops, D <= g (1 + tol) at every
    node.  Order 2 is not monotone.  It is of second order where the solution is smooth, also
    at the boundary of the set where h = h0; no undershoot was observed there.  It is of first
    order at isolated point sources and where fronts meet.  There it undershoots, on the model
    problem by 0.012 of 25 (order 1: by 0.007).  Forward Euler diverges with the second-order
    differences, and the second-order Runge-Kutta method does not converge to a steady state;
    therefore the third-order method is used.

    *Cost.*  Information propagates by less than one node per step.  The number of steps is
    therefore set by the longest path from a bound to a node that it limits.  The total cost is
    :math:`O(n^{1 + 1/d})` for n nodes in d dimensions if there are few bounds.  It is near O(n)
    if h0 is nearly limited already, or if ``initial`` is close and the change is local.  A small
    change of a bound does not converge faster than a large one, because it propagates over
    the same distance.  Fast marching is O(n) on grids.  Choose the iteration for a good
    start, for short paths, or for its second order.  Memory: 3 arrays of the grid at order 1,
    4 at order 2, and one more if g varies.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, eqs. (16), (17).
    .. [2] S. Osher, C.-W. Shu, "High-order essentially nonoscillatory schemes for
       Hamilton-Jacobi equations", SIAM J. Numer. Anal. 28 (1991) 907-922.
    .. [3] C.-W. Shu, S. Osher, "Efficient implementation of essentially non-oscillatory
       shock-capturing schemes", J. Comput. Phys. 77 (1988) 439-471.
    """

    name: ClassVar[str] = "hamilton-jacobi"
    optional: ClassVar[frozenset[str]] = frozenset({"initial"})
    cfl: ClassVar[float] = 0.9
    r""":math:`\Delta t \sqrt{\sum_a 1/\Delta x_a^2}`.  Order 1 is monotone up to 1.  Order 2 needs
    the damping of long steps: at 0.5 the switching of its differences prevents convergence below a
    rate of about 1e-4 g.  The published :math:`\Delta t = \Delta x/2` is half the root of the
    dimension."""
    order: Annotated[int, Option(lower=1.0, upper=2.0)] = 1
    tol: Annotated[float, Option(above=True)] = 1e-3
    max_iter: Annotated[int | None, Option(lower=1.0)] = None

    def supports(self, domain: AnyMesh | CartesianGrid) -> str:
        """Return which backgrounds the scheme needs."""
        return "" if isinstance(domain, CartesianGrid) else "a CartesianGrid"

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem; the residual is the largest rate of change, divided by the largest g."""
        # Needed even with a start: its inf mark the nodes that are not connected to any bound.
        start = checked_start(problem.initial, march_grid(problem).h)
        solution = self.iterate(problem, start)
        if self.order == 1:
            return solution
        # A few sizes may be too steep along an edge.
        return replace(solution, h=march_grid(replace(problem, h0=solution.h), along_edges=True).h)

    def iterate(self, problem: Problem, start: FloatArray) -> Solution:
        """Iterate from start values, which must be finite wherever the limited size is.

        They are lowered to ``h0`` where they exceed it.  Nodes that are inf here are ignored and
        stay inf (a component without a bound).
        """
        from adaptsize._kernels.hamilton_jacobi import iterate_hamilton_jacobi

        grid = problem.grid
        h0, slope, order, max_iter = problem.h0, problem.slope, self.order, self.max_iter
        takes_part = np.isfinite(start)
        if grid.active is not None:
            takes_part &= grid.active
        weights = grid.spacing**-2.0
        dt = self.cfl / math.sqrt(float(weights.sum()))
        if max_iter is None:
            diagonal = float(np.linalg.norm((np.array(grid.shape) - 1) * grid.spacing))
            max_iter = tuning.CROSSINGS * math.ceil(diagonal / dt) + tuning.MORE_STEPS

        strides = np.array(strides_of_padded(grid, order))
        bound = pad(grid, h0, order, takes_part)
        g = slope.values.copy()
        if slope.step:
            g = pad(grid, slope.values, order, takes_part)
        fastest = dt * float(np.fmax.reduce(g))
        # Where the rows along the last axis begin that contain nodes which take part.
        begin = (np.argwhere(takes_part.any(axis=-1)) + order) @ strides[:-1] + order
        rows = (begin, grid.shape[-1], strides)
        arguments = (bound, g, slope.step, *rows, weights, order, dt, self.tol * fastest)
        u = pad(grid, np.minimum(start, h0), order, takes_part)
        spare = np.full_like(u, np.nan)
        stage = np.full_like(u, np.nan) if order == 2 else spare
        # The work is in nodes times axes: about 0.1 s between two progress calls.
        work = rows[0].size * grid.shape[-1] * grid.dim * (1 if order == 1 else 6)
        chunk = max(1, int(5e7 / max(work, 1)))
        taken, moving = 0, 1
        while moving and taken < max_iter:
            some = min(chunk, max_iter - taken)
            steps, moving = iterate_hamilton_jacobi(some, u, spare, stage, arguments)
            if steps % 2:
                u, spare = spare, u
            taken += steps
            problem.report("Hamilton-Jacobi iteration", taken / max_iter)
        np.subtract(u, spare, out=spare)
        np.abs(spare, out=spare)
        change = float(np.fmax.reduce(spare, initial=0.0))
        rate = change / fastest if fastest > 0.0 else change
        unfinished = ""
        if change > self.tol * fastest:
            unfinished = Message(
                "the Hamilton-Jacobi iteration stopped after max_iter = {} steps with residual "
                "{:.2g}, above tol = {:g}: give more steps, a start nearer to the solution, or "
                "{method:'fast-marching'}",
                *(max_iter, rate, self.tol),
            )
        h = np.where(takes_part, unpad(grid, u, order), np.inf)
        return Solution(h, taken, rate, unfinished)
