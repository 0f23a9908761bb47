"""The iterative Hamilton-Jacobi limiter on Cartesian grids."""

import numpy as np
import pytest
from backgrounds import square_grid, two_sources
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize._progress import silent
from adaptsize.background import CartesianGrid
from adaptsize.limiting import HamiltonJacobi
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import Problem

ORDERS = (1, 2)


def _solve(grid, h0, g, order, *, start=5.0, tol=1e-9, max_iter=None, report=silent):
    """Solve from a constant, or from ``start``."""
    problem = Problem(grid, h0, Slope(np.atleast_1d(np.asarray(g, dtype=float))), report=report)
    scheme = HamiltonJacobi(order, tol, max_iter)
    return scheme.iterate(problem, np.broadcast_to(start, grid.shape))


@pytest.mark.parametrize("order", ORDERS)
def test_the_gradient_limit_counts_where_the_size_is_limited(order):
    # With a bound at the left end, order 1 is the sum of g_i dx: at x = 1 it errs by half of
    # dx times the change of g, 0.0015.  Order 2 lacks a second neighbour at the first node,
    # where it errs by e = dx^2 g' / 2, which its differences carry on as e (1 + 1/3 + 1/9
    # ...), and at the last, where it errs by e again: 2.5 e = 3.75e-5.
    grid = CartesianGrid([0.0], 0.01, (101,))
    (x,) = grid.axes
    g = 0.2 + 0.3 * x
    h0 = np.where(x == 0.0, 1.0, np.inf)
    h = _solve(grid, h0, g, order).h
    if order == 1:
        assert_allclose(np.diff(h), 0.01 * g[1:], rtol=1e-6)
    error = np.abs(h - (1.0 + 0.2 * x + 0.15 * x**2)).max()
    assert error == pytest.approx(0.0015, rel=1e-3) if order == 1 else error < 3.8e-5


@pytest.mark.parametrize("order", ORDERS)
def test_the_solution_does_not_depend_on_the_start(order):
    grid = CartesianGrid([-1.0, -1.0], 1.0 / 30.0, (61, 61))
    x, y = np.meshgrid(*grid.axes, indexing="ij")
    h0 = 0.3 + 0.2 * np.sin(9.0 * x + 1.0) * np.sin(7.0 * y)
    from_bound = _solve(grid, h0, 0.3, order, start=h0).h
    rng = np.random.default_rng(32)
    for start in (100.0, 0.01, rng.uniform(0.05, 0.6, grid.shape)):
        h = _solve(grid, h0, 0.3, order, start=start).h
        assert_allclose(h, from_bound, rtol=1e-6)
    assert (h < h0 - 1e-6).mean() > 0.5  # most of it is limited
    assert _solve(grid, h0, 0.3, order, max_iter=3).iterations == 3


@pytest.mark.parametrize("order", ORDERS)
def test_steps_add_up(order):
    grid = CartesianGrid([0.0, 0.0], 0.1, (21, 16))
    h0 = np.random.default_rng(33).uniform(0.1, 2.0, grid.shape)
    at_once = _solve(grid, h0, 0.3, order, start=h0, max_iter=5).h
    first = _solve(grid, h0, 0.3, order, start=h0, max_iter=2)
    assert first.iterations == 2
    assert not np.array_equal(first.h, h0)
    then = _solve(grid, h0, 0.3, order, start=first.h, max_iter=3).h
    assert not np.array_equal(then, first.h)
    assert_array_equal(then, at_once)


def test_progress_is_reported_and_may_stop_the_work():
    grid = square_grid(101)
    h0, _ = two_sources(grid)
    shares = []
    _solve(grid, h0, 0.3, 1, tol=1e-3, report=lambda text, share: shares.append(share))
    assert shares
    assert all(0.0 < share <= 1.0 for share in shares)

    def interrupt(text, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _solve(grid, h0, 0.3, 1, report=interrupt)
