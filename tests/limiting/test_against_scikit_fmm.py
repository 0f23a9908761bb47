"""Fast marching on grids is what scikit-fmm computes, an implementation of its own."""

from functools import partial

import numpy as np
import pytest

import adaptsize as ads
from adaptsize.limiting import FastMarching

skfmm = pytest.importorskip("skfmm", reason="scikit-fmm is compiled when it is installed")

limit_gradient = partial(ads.limit_gradient, method="fast-marching")

GRIDS = {
    "plane": ads.CartesianGrid([-1.0, 0.5], [0.1, 0.13], (41, 34)),
    "space": ads.CartesianGrid([0.0, 0.0, 0.0], [0.2, 0.25, 0.3], (18, 15, 13)),
}


@pytest.fixture(params=GRIDS)
def problem(request):
    """Return a grid, h0 = 1 at some nodes, and a phi that is zero at them and only there."""
    grid = GRIDS[request.param]
    nodes = np.random.default_rng(1848).choice(grid.n_points, 5, replace=False)
    h0 = np.full(grid.n_points, np.inf)
    h0[nodes] = 1.0
    phi = np.ones(grid.n_points)
    phi[nodes] = 0.0
    return grid, h0.reshape(grid.shape), phi.reshape(grid.shape)


def test_sizes_grow_like_its_distance(problem):
    grid, h0, phi = problem
    h = limit_gradient(grid, h0, 0.3, method="fast-marching")
    # Both solve the same quadratic equation at each node.
    wanted = 1.0 + 0.3 * skfmm.distance(phi, dx=grid.spacing, order=1)
    np.testing.assert_allclose(h, wanted, rtol=1e-10)


def test_sizes_of_second_order_grow_like_its_distance_from_one_source(problem):
    grid, h0, phi = problem
    first = tuple(np.argwhere(np.isfinite(h0))[0])
    only = np.full(grid.shape, np.inf)
    only[first] = 1.0
    phi[:], phi[first] = 1.0, 0.0
    h = limit_gradient(grid, only, 0.3, method=FastMarching(order=2))
    np.testing.assert_allclose(
        h, 1.0 + 0.3 * skfmm.distance(phi, dx=grid.spacing, order=2), rtol=1e-10
    )


def test_sizes_with_a_limit_that_varies_grow_like_its_travel_time(problem):
    grid, h0, phi = problem
    g = np.random.default_rng(1849).uniform(0.1, 0.5, grid.shape)
    h = limit_gradient(grid, h0, g, method="fast-marching")
    np.testing.assert_allclose(
        h, 1.0 + skfmm.travel_time(phi, 1.0 / g, dx=grid.spacing, order=1), rtol=1e-10
    )


def test_inactive_nodes_stop_sizes_as_a_mask_stops_its_distance(problem):
    grid, h0, phi = problem
    active = np.random.default_rng(1850).random(grid.shape) > 0.25
    active[np.isfinite(h0)] = True
    h = limit_gradient(grid.with_active(active), h0, 0.3, method="fast-marching")
    distance = skfmm.distance(np.ma.MaskedArray(phi, ~active), dx=grid.spacing, order=1)
    wanted = 1.0 + 0.3 * np.ma.filled(distance, np.inf)
    reached = np.isfinite(h) & active
    assert reached.sum() > 0.5 * active.sum()
    np.testing.assert_allclose(h[reached], wanted[reached], rtol=1e-10)
