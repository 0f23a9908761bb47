"""The callback for Gmsh's sizes: the size function, and Gmsh's own size where there is none."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction
from adaptsize.bridges import gmsh_callback


def test_plane_sizes_ignore_the_third_coordinate():
    grid = CartesianGrid((0.0, 0.0), 1.0, (3, 3))
    size = SizeFunction(grid, 0.1 + 0.2 * grid.points[:, 0].reshape(grid.shape))
    callback = gmsh_callback(size)
    assert callback(2, 7, 0.5, 1.0, 99.0, 1e22) == pytest.approx(0.2)
    assert type(callback(2, 7, 0.5, 1.0, 0.0, 1e22)) is float


def test_free_sizes_are_left_to_gmsh():
    mesh = SimplexMesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    callback = gmsh_callback(SizeFunction(mesh, np.full(4, np.inf)))
    assert callback(3, 1, 0.2, 0.2, 0.2, 0.7) == 0.7
