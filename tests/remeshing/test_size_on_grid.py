"""Meshes made to sizes that live on a Cartesian grid."""

import numpy as np

from adaptsize import CartesianGrid, SizeFunction
from adaptsize.remeshing.sizing import as_size


def test_beside_the_active_nodes_the_size_of_the_nearest_one_holds():
    active = np.zeros((4, 3), bool)
    active[0, :], active[1, 0] = True, True
    grid = CartesianGrid([0.0, 0.0], [1.0, 10.0], (4, 3), active=active)
    size = as_size(
        SizeFunction(grid, np.where(active, 1.0 + np.arange(12).reshape(4, 3), np.inf)), None
    )
    np.testing.assert_array_equal(size(grid.points), [1, 2, 3, 4, 2, 3, 4, 2, 3, 4, 2, 3])
