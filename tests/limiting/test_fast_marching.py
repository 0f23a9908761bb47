"""Fast marching of distances from seeds, which the geometry uses."""

import numpy as np

from adaptsize import CartesianGrid
from adaptsize.geometry.distance.fast_marching import march_distance


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
