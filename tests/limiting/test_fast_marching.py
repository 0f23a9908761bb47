"""Fast marching of distances from seeds, which the geometry uses."""

import numpy as np

from adaptsize import CartesianGrid, limit_gradient
from adaptsize.background.marching import march_distance
from adaptsize.limiting import FastMarching


def quiet(text, share):
    pass


def test_distances_from_a_plane_are_exact():
    grid = CartesianGrid([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], (5, 6, 7))
    seeds = np.full(grid.shape, np.inf)
    seeds[:, 2, :] = 0.05
    found = march_distance(grid, seeds, report=quiet)
    exact = 0.05 + 0.2 * np.abs(np.arange(6) - 2)
    np.testing.assert_allclose(found, np.broadcast_to(exact[:, None], grid.shape), rtol=1e-12)


def test_progress_is_the_share_of_nodes_that_were_reached(monkeypatch):
    monkeypatch.setattr("adaptsize.background.marching._CHUNK_OF_GRID", 100)
    grid = CartesianGrid([0.0, 0.0], 0.1, (30, 20))
    seeds = np.full(grid.shape, np.inf)
    seeds[0, 0] = 0.0
    shares = []
    whole = march_distance(grid, seeds, report=lambda text, share: shares.append(share))
    *before, last = shares
    np.testing.assert_allclose(before[:5], np.arange(1, 6) / 6.0)
    assert last == 1.0
    assert max(before) <= 1.0
    monkeypatch.undo()
    np.testing.assert_array_equal(march_distance(grid, seeds, report=quiet), whole)


def test_distances_from_a_point_are_of_first_order():
    error = []
    for n in (20, 40, 80):
        grid = CartesianGrid([-1.0, -1.0], 2.0 / n, (n + 1, n + 1))
        exact = np.linalg.norm(grid.points, axis=1).reshape(grid.shape)
        # Exact close to the point: its tip would cost a logarithm.
        found = march_distance(grid, np.where(exact < 0.3, exact, np.inf), report=quiet)
        error.append(np.abs(found - exact).max())
        assert (found >= exact - 1e-12).all()
    order = np.log2(np.divide(error[:-1], error[1:]))
    assert (order > 0.85).all(), f"errors {error}, orders {order}"


def test_ways_lead_through_the_nodes_that_take_part():
    grid = CartesianGrid([0.0, 0.0], 0.1, (11, 11))
    seeds = np.full(grid.shape, np.inf)
    seeds[0, 0] = 0.0
    where = np.ones(grid.shape, bool)
    where[5, :-1] = False
    found = march_distance(grid, seeds, where=where, report=quiet)
    assert np.isinf(found[~where]).all()
    # Up the wall and around its end, by (0.5, 1).
    around = np.hypot(0.5, 1.0)
    assert around < found[5, 10] < 1.1 * around
    assert found[10, 0] > around + 1.0
    where[5, 10] = False
    assert np.isinf(march_distance(grid, seeds, where=where, report=quiet)[6:]).all()


def test_the_second_order_pass_sorts_sizes_whose_range_has_no_inverse():
    # Regression: numbers of bins out of range, and so writing out of bounds.
    active = np.ones((9, 9), bool)
    active[4] = False
    grid = CartesianGrid([0.0, 0.0], 1e-3, (9, 9), active=active)
    h0 = np.full((9, 9), np.inf)
    h0[0, 0], h0[8, 8] = 1e-310, 1.5e-310
    h = limit_gradient(grid, h0, 1e-310, method=FastMarching(order=2))
    assert (h[:4] == 1e-310).all()
    assert (h[5:] == 1.5e-310).all()


def test_order_two_is_not_monotone():
    # The documentation says so; of order 1 it is.
    grid = CartesianGrid([0.0, 0.0], 0.125, (9, 9))
    rise = np.zeros(2)
    for seed in range(40, 55):
        rng = np.random.default_rng(seed)
        h0 = np.where(rng.random(grid.shape) < 0.15, rng.uniform(0.05, 0.3, grid.shape), np.inf)
        h0[0, 0] = 0.1
        node = tuple(rng.integers(0, 9, 2))
        for order in (1, 2):
            scheme = FastMarching(order=order)
            h = limit_gradient(grid, h0, 0.5, method=scheme)
            lower = h0.copy()
            lower[node] = 0.98 * h[node]
            more = limit_gradient(grid, lower, 0.5, method=scheme)
            rise[order - 1] = max(rise[order - 1], (more / h - 1.0).max())
    assert rise[0] < 1e-14
    assert 1e-3 < rise[1] < 1e-2
