"""Schemes on grids against slow twins, and sizes around gaps in grids."""

import numpy as np
from backgrounds import active_nodes
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adaptsize import CartesianGrid, limit_gradient
from adaptsize.limiting import HamiltonJacobi


def smaller_neighbours(h, axis):
    """Return the smaller one of both neighbours along an axis, inf beyond the ends."""
    h = np.moveaxis(h, axis, 0)
    outside = np.full_like(h[:1], np.inf)
    smaller = np.minimum(np.concatenate([outside, h[:-1]]), np.concatenate([h[1:], outside]))
    return np.moveaxis(smaller, 0, axis)


def root_by_bisection(v, spacing, g):
    """Return h with sum_a max((h - v_a) / dx_a, 0)^2 = g^2, float64[dim, n] to float64[n]."""
    low = v.min(axis=0)
    high = np.min(v + spacing[:, None] * g, axis=0)
    for _ in range(54):
        middle = 0.5 * (low + high)
        steepness = (np.maximum((middle - v) / spacing[:, None], 0.0) ** 2).sum(axis=0)
        too_low = steepness < g**2
        low, high = np.where(too_low, middle, low), np.where(too_low, high, middle)
    return high


def twin(grid, h0, g):
    """Limit by plain sweeps."""
    active = active_nodes(grid)
    h = np.where(active, h0, np.inf)
    while True:
        v = np.stack([smaller_neighbours(h, axis).ravel() for axis in range(grid.dim)])
        nodes = np.flatnonzero(np.isfinite(v.min(axis=0)) & active.ravel())
        root = root_by_bisection(v[:, nodes], grid.spacing, g.flat[nodes])
        nodes, root = nodes[root < h.flat[nodes]], root[root < h.flat[nodes]]
        if (root >= h.flat[nodes] * (1.0 - 1e-14)).all():
            return h
        h.flat[nodes] = root


def problem(seed, dim, most):
    """Return a random grid with inactive nodes, bounds on some nodes, and g at the nodes."""
    rng = np.random.default_rng(seed)
    shape = tuple(map(int, rng.integers(2, (60, 12, 6)[dim - 1], dim)))
    active = rng.random(shape) < rng.choice([0.7, 0.9, 1.0])
    node = int(rng.integers(active.size))
    active.flat[node] = True
    spacing = np.exp(rng.uniform(0.0, np.log(most), dim))
    grid = CartesianGrid((0.0,) * dim, spacing, shape, active=active)
    # Bounds that differ by several rises, and free nodes.
    h0 = rng.uniform(0.01, 5.0, shape) * spacing.min()
    h0[rng.random(shape) > rng.choice([0.1, 0.5, 1.0])] = np.inf
    h0.flat[node] = 0.5
    return grid, h0, rng.uniform(0.0, 1.0, shape) * (rng.random(shape) < 0.95)


@given(seed=st.integers(0, 2**32 - 1), dim=st.integers(1, 3), most=st.sampled_from([1, 5, 1000]))
@settings(max_examples=40)
def test_marching_solves_what_plain_sweeps_converge_to(seed, dim, most):
    grid, h0, g = problem(seed, dim, most)
    expected = twin(grid, h0, g)
    h = limit_gradient(grid, h0, g, method="fast-marching")
    assert_allclose(h, expected, rtol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), dim=st.integers(1, 3))
@settings(max_examples=20)
def test_the_iteration_of_first_order_converges_to_marching(seed, dim):
    grid, h0, g = problem(seed, dim, most=3)
    g = np.maximum(g, 0.05)  # where g = 0 a start that is too low stays
    marched = limit_gradient(grid, h0, g, method="fast-marching")
    rng = np.random.default_rng(seed)
    start = rng.uniform(0.9, 1.1, grid.shape) * np.where(np.isfinite(marched), marched, 1.0)
    scheme = HamiltonJacobi(tol=1e-10, max_iter=100_000)
    h = limit_gradient(grid, h0, g, method=scheme, initial=start)
    # At rest to 1e-10 g: over the nodes a size passes this adds up to less than 1e-8 of it.
    assert_allclose(h, marched, rtol=1e-7)
