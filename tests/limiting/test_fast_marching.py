"""Fast marching of distances from seeds, which the geometry uses."""

import numpy as np
import pytest
from meshes import random_square

from adaptsize import CartesianGrid
from adaptsize.errors import ConvergenceWarning
from adaptsize.geometry.distance.fast_marching import march_distance, march_through_mesh
from adaptsize.limiting import FastMarching, limit_gradient


def quiet(text, share):
    pass


def test_distances_from_a_plane_are_exact():
    grid = CartesianGrid([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], (5, 6, 7))
    seeds = np.full(grid.shape, np.inf)
    seeds[:, 2, :] = 0.05
    found = march_distance(grid, seeds, report=quiet)
    exact = 0.05 + 0.2 * np.abs(np.arange(6) - 2)
    np.testing.assert_allclose(found, np.broadcast_to(exact[:, None], grid.shape), rtol=1e-12)


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


@pytest.mark.parametrize("lowered", [False, True])
def test_seeds_are_lowered_only_by_others(lowered):
    grid = CartesianGrid([0.0], 0.1, (11,))
    seeds = np.full(11, np.inf)
    seeds[0], seeds[10] = 0.2, 3.0 if lowered else 1.1
    before = seeds.copy()
    found = march_distance(grid, seeds, report=quiet)
    assert found[10] == pytest.approx(1.2 if lowered else 1.1)
    np.testing.assert_array_equal(seeds, before)


def test_without_seeds_nothing_is_reached():
    grid = CartesianGrid([0.0, 0.0], 0.1, (4, 4))
    reports = []
    found = march_distance(
        grid, np.full((4, 4), np.inf), report=lambda text, share: reports.append(share)
    )
    assert np.isinf(found).all()
    assert reports == [1.0]


def test_marching_through_a_mesh_warns_when_it_becomes_inexact(monkeypatch):
    mesh = random_square(300, seed=5)
    seeds = np.where(np.arange(mesh.n_points) == 0, 0.0, np.inf)
    exact = march_through_mesh(mesh, seeds, report=quiet, text="marching")  # no warning
    monkeypatch.setattr("adaptsize.background.marching._PATIENCE", 0)
    monkeypatch.setattr("adaptsize.background.marching.CHUNK", 10)
    with pytest.warns(ConvergenceWarning, match="changes below 0.1% are ignored"):
        rough = march_through_mesh(mesh, seeds, report=quiet, text="marching")
    np.testing.assert_allclose(rough, exact, rtol=0.05)


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
