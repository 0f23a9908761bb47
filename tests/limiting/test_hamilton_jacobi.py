"""The iterative Hamilton-Jacobi limiter on Cartesian grids."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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


def _square(n, half_width=50.0):
    """Return an n x n grid of a square about the origin and the coordinates of its nodes."""
    grid = CartesianGrid([-half_width] * 2, 2.0 * half_width / (n - 1), (n, n))
    return grid, *np.meshgrid(*grid.axes, indexing="ij")


def _two_sources(n):
    """Return the model problem: (-10, 0) has 1, (10, 0) has 5, g = 0.3."""
    grid, x, y = _square(n)
    exact = np.minimum(1.0 + 0.3 * np.hypot(x + 10.0, y), 5.0 + 0.3 * np.hypot(x - 10.0, y))
    h0 = np.where((y == 0.0) & (np.abs(x) == 10.0), exact, np.inf)
    return grid, h0, exact


# --- exact solutions -----------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_linear_sizes_within_the_limit_stay(order):
    grid = CartesianGrid((0.0, 0.0), (1.0, 0.25), (12, 9))
    x, y = np.meshgrid(*grid.axes, indexing="ij")
    h0 = 3.0 + 0.6 * 0.3 * x - 0.79 * 0.3 * y  # slope 0.993 g
    solution = _solve(grid, h0, 0.3, order)
    assert_array_equal(solution.h, h0)
    assert (solution.iterations, solution.residual, solution.unfinished) == (1, 0.0, "")


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
def test_inactive_nodes_block(order):
    # A wall at x = 5 with a door at its upper end: sizes come through the door only.
    active = np.ones((11, 11), dtype=bool)
    active[5, :-1] = False
    grid = CartesianGrid((0.0, 0.0), 1.0, (11, 11), active=active)
    h0 = np.full(grid.shape, np.inf)
    h0[4, 0] = 1.0
    h0[5, 0] = 0.01  # of an inactive node: not read
    h = _solve(grid, h0, 0.3, order, tol=1e-4).h
    assert np.isinf(h[~active]).all()
    # The way from (4, 0) to (6, 0): 10 up along the wall, 2 through the door, 10 down.
    assert h[6, 0] == pytest.approx(1.0 + 0.3 * 22.0, abs=1e-3)
    active[5] = False
    closed = CartesianGrid((0.0, 0.0), 1.0, (11, 11), active=active)
    start = np.where(np.arange(11)[:, None] < 5, 9.0, np.inf) * np.ones(11)
    h = _solve(closed, h0, 0.3, order, start=start, tol=1e-4).h
    assert np.isfinite(h[:5]).all()
    assert np.isinf(h[5:]).all()  # no bound in there: nothing asked


# --- the discrete equation --------------------------------------------------------------


def _quadratic(neighbours, spacing, g):
    """Return h with sum over axes of (max(h - v_a, 0) / dx_a)^2 = g^2, v_a the lower neighbour."""
    pairs = sorted((v, dx) for v, dx in zip(neighbours, spacing, strict=True) if np.isfinite(v))
    h = np.inf
    for count in range(1, len(pairs) + 1):
        v, dx = np.array(pairs[:count]).T
        if h <= v[-1]:
            break
        a, b, c = (dx**-2.0).sum(), (v / dx**2).sum(), ((v / dx) ** 2).sum() - g**2
        h = (b + np.sqrt(max(b * b - a * c, 0.0))) / a
    return h


def _expected_from_neighbours(grid, h, h0, g):
    """Return min(h0, update from the neighbours), node by node."""
    expected = np.full(grid.shape, np.inf)
    for node in np.argwhere(np.isfinite(h)):
        lower = []
        for axis in range(len(grid.shape)):
            values = [np.inf]
            for by in (-1, 1):
                other = node.copy()
                other[axis] += by
                if 0 <= other[axis] < grid.shape[axis]:
                    values.append(h[tuple(other)])
            lower.append(min(values))
        i = tuple(node)
        expected[i] = min(h0[i], _quadratic(lower, grid.spacing, g[i]))
    return expected


@given(seed=st.integers(0, 2**32 - 1), dim=st.integers(1, 3))
@settings(max_examples=25)
def test_first_order_solves_the_upwind_quadratic_at_every_node(seed, dim):
    rng = np.random.default_rng(seed)
    shape = (9, 6, 4)[:dim]
    active = rng.random(shape) < 0.85
    active.flat[0] = True
    grid = CartesianGrid((0.0,) * dim, rng.uniform(0.5, 2.0, dim), shape, active=active)
    h0 = np.where(rng.random(shape) < 0.3, rng.uniform(0.1, 2.0, shape), 6.0)
    g = rng.uniform(0.2, 0.5, shape)
    h = _solve(grid, h0, g, 1, tol=1e-10, max_iter=5000, start=rng.uniform(0.1, 9.0, shape)).h
    # The last step moved no node by more than 1e-10 dt g; near the steady state the error
    # is larger by no more than the number of nodes that a size passes.
    assert_allclose(h, _expected_from_neighbours(grid, h, h0, g), rtol=1e-7)


# --- starts --------------------------------------------------------------------------


def _bumps(amplitude=1.0):
    grid, x, y = _square(61, half_width=1.0)
    return grid, 0.3 + amplitude * 0.2 * np.sin(9.0 * x + 1.0) * np.sin(7.0 * y)


@pytest.mark.parametrize("order", ORDERS)
def test_the_solution_does_not_depend_on_the_start(order):
    grid, h0 = _bumps()
    from_bound = _solve(grid, h0, 0.3, order, start=h0).h
    rng = np.random.default_rng(32)
    for start in (100.0, 0.01, rng.uniform(0.05, 0.6, grid.shape)):
        h = _solve(grid, h0, 0.3, order, start=start).h
        assert_allclose(h, from_bound, rtol=1e-6)
    assert (h < h0 - 1e-6).mean() > 0.5  # most of it is limited


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_solution_of_a_nearby_problem_is_a_good_start(order, factor):
    # 60 sources, one of which changes: only what it limits has to be found anew, and that
    # is near, whereas from a constant all have to be.
    rng = np.random.default_rng(33)
    grid = CartesianGrid((0.0, 0.0), 1.0 / 60.0, (61, 61))
    h0 = np.full(grid.shape, np.inf)
    sources = rng.choice(h0.size, 60, replace=False)
    h0.flat[sources] = rng.uniform(0.05, 0.1, 60)
    before = _solve(grid, h0, 0.3, order, tol=1e-6)
    h0.flat[sources[0]] *= factor
    scratch = _solve(grid, h0, 0.3, order, tol=1e-6)
    again = _solve(grid, h0, 0.3, order, tol=1e-6, start=before.h)
    assert np.abs(before.h - scratch.h).max() > 1e-3
    assert_allclose(again.h, scratch.h, atol=1e-6)
    assert again.iterations < 0.8 * scratch.iterations


# --- accuracy --------------------------------------------------------------------------


# --- stopping ------------------------------------------------------------------------


def test_the_cap_is_reported():
    grid, h0, _ = _two_sources(101)
    solution = _solve(grid, h0, 0.3, 1, tol=1e-3, max_iter=7)
    assert "max_iter = 7 steps" in solution.unfinished
    assert solution.iterations == 7
    assert solution.residual > 1e-3


def test_the_residual_is_the_last_rate_over_g():
    grid, h0, _ = _two_sources(101)
    solution = _solve(grid, h0, 0.3, 1, tol=0.02, start=30.0)
    n_before = solution.iterations - 1
    before = _solve(grid, h0, 0.3, 1, tol=0.02, start=30.0, max_iter=n_before)
    dt = 0.9 / np.sqrt(2.0)  # the spacing is 1
    rate = np.abs(solution.h - before.h).max() / (0.3 * dt)
    assert solution.residual == pytest.approx(rate, rel=1e-9)
    assert rate <= 0.02 < before.residual


def test_progress_is_reported_and_may_stop_the_work():
    grid, h0, _ = _two_sources(101)
    shares = []
    _solve(grid, h0, 0.3, 1, tol=1e-3, report=lambda text, share: shares.append(share))
    assert shares
    assert all(0.0 < share <= 1.0 for share in shares)

    def interrupt(text, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _solve(grid, h0, 0.3, 1, report=interrupt)
