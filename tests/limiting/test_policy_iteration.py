"""Policy iteration against plain sweeps, on meshes small enough for both."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient
from adaptsize._kernels.fast_marching import sweep_cells
from adaptsize.limiting.fast_marching import cells_in, iterate_policies
from adaptsize.limiting.gradient_limit import Slope


def _problem(dim, seed, *, stretch=1.0, coincident=0):
    """Random Delaunay cells, then stretched, with some nodes moved onto others; random g."""
    rng = np.random.default_rng(seed)
    points = rng.random((150, dim))
    cells = Delaunay(points).simplices
    points[:, 0] *= stretch
    for i, j in rng.integers(0, 150, (coincident, 2)):
        points[i] = points[j]
    h0 = np.where(rng.random(150) < 0.05, rng.uniform(0.01, 0.1, 150), np.inf)
    h0[0] = 0.01
    return SimplexMesh(points, cells), h0, rng.uniform(0.1, 1.0, len(cells))


def _swept(mesh, h0, g):
    """Repeat the local update of all nodes until nothing changes: the slow twin."""
    h, candidate = h0.copy(), np.empty(mesh.n_points)
    for _ in range(20_000):
        sweep_cells(cells_in(mesh), h, (g, 1), True, candidate)
        lower = np.minimum(h, candidate)
        if (lower >= h * (1.0 - 1e-15)).all():
            return lower
        h = lower
    raise AssertionError("the sweeps have not converged")


def _solve(mesh, h0, g):
    start = limit_gradient(mesh, h0, g, method="edge-based")
    steps = []
    h, unfinished = iterate_policies(mesh, Slope(g), start, lambda text, share: steps.append(text))
    assert not unfinished
    return h, len(steps)


@pytest.mark.parametrize("coincident", [0, 40])
@pytest.mark.parametrize("stretch", [1.0, 10.0])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_policies_solve_what_plain_sweeps_converge_to(dim, stretch, coincident):
    if dim == 1:
        rng = np.random.default_rng(60_004)
        x = np.cumsum(rng.uniform(0.0, 1.0, 40) * (rng.random(40) < 0.7))
        mesh = SimplexMesh(x[:, None], np.column_stack([np.arange(39), np.arange(1, 40)]))
        h0 = np.where(np.arange(40) % 13 == 5, 0.1, np.inf)
        g = rng.uniform(0.1, 1.0, 39)
    else:
        mesh, h0, g = _problem(dim, 60_001, stretch=stretch, coincident=coincident)
    h, n_steps = _solve(mesh, h0, g)
    expected = _swept(mesh, h0, g)
    assert_allclose(h, expected, rtol=1e-12)
    for method in ("fast-marching", "positive-coefficient"):
        assert_allclose(limit_gradient(mesh, h0, g, method=method), expected, rtol=1e-12)
    assert n_steps < 30  # as Newton's method does, not as sweeps


@pytest.mark.parametrize("tiny", [0.0, 1e-20, 1e-17])
def test_limits_that_vanish_in_rounding_leave_the_equations_solvable(tiny):
    # Regression: coincident nodes of equal size referred to each other in a circle, and
    # the matrix was singular.
    mesh, h0, g = _problem(3, 60_003, stretch=20.0, coincident=60)
    h, _ = _solve(mesh, h0, tiny * g)
    assert_allclose(h, np.full(150, h0.min()), rtol=1e-12)


def test_a_limit_that_depends_on_the_size_converges_from_a_smallest_size_of_zero():
    # The sizes are transformed, and the smallest of them is 0.
    mesh, h0, _ = _problem(2, 60_005, stretch=10.0)
    h, info = limit_gradient.with_info(mesh, h0, lambda h: 0.25 + 0.0 * h, method="fast-marching")
    assert info.converged
    assert_allclose(h, limit_gradient(mesh, h0, 0.25, method="fast-marching"), rtol=1e-6)
