"""Fast marching of distances from seeds, which the geometry uses."""

import numpy as np
import pytest
from meshes import random_square

from adaptsize import CartesianGrid
from adaptsize.errors import ConvergenceWarning
from adaptsize.geometry.distance.fast_marching import march_distance, march_through_mesh


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


def test_marching_through_a_mesh_warns_when_it_becomes_inexact(monkeypatch):
    mesh = random_square(300, seed=5)
    seeds = np.where(np.arange(mesh.n_points) == 0, 0.0, np.inf)
    exact = march_through_mesh(mesh, seeds, report=quiet, text="marching")  # no warning
    monkeypatch.setattr("adaptsize.background.marching._PATIENCE", 0)
    monkeypatch.setattr("adaptsize.background.marching.CHUNK", 10)
    with pytest.warns(ConvergenceWarning, match="changes below 0.1% are ignored"):
        rough = march_through_mesh(mesh, seeds, report=quiet, text="marching")
    np.testing.assert_allclose(rough, exact, rtol=0.05)
