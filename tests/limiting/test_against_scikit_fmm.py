"""Fast marching on grids is what scikit-fmm computes, an implementation of its own."""

import numpy as np
import pytest

import adaptsize as ads
from adaptsize.limiting import FastMarching

skfmm = pytest.importorskip("skfmm", reason="scikit-fmm is compiled when it is installed")

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


@pytest.mark.parametrize("order", [1, 2])
def test_sizes_grow_like_its_distance(problem, order):
    grid, h0, phi = problem
    if order == 2:  # from one source
        first = tuple(np.argwhere(np.isfinite(h0))[0])
        h0, phi = np.full(grid.shape, np.inf), np.ones(grid.shape)
        h0[first], phi[first] = 1.0, 0.0
    h = ads.limit_gradient(grid, h0, 0.3, method=FastMarching(order=order))
    # Both solve the same quadratic equation at each node.
    wanted = 1.0 + 0.3 * skfmm.distance(phi, dx=grid.spacing, order=order)
    np.testing.assert_allclose(h, wanted, rtol=1e-10)
