"""Meshes made to sizes that live on a Cartesian grid."""

import numpy as np

from adaptsize import CartesianGrid, SizeFunction
from adaptsize.remeshing.sizing import as_size, known_points


def test_beside_the_active_nodes_the_size_of_the_nearest_one_holds():
    active = np.zeros((4, 3), bool)
    active[0, :], active[1, 0] = True, True
    grid = CartesianGrid([0.0, 0.0], [1.0, 10.0], (4, 3), active=active)
    size = as_size(
        SizeFunction(grid, np.where(active, 1.0 + np.arange(12).reshape(4, 3), np.inf)), None
    )
    np.testing.assert_array_equal(size(grid.points), [1, 2, 3, 4, 2, 3, 4, 2, 3, 4, 2, 3])


def test_of_a_grid_only_nodes_with_a_smaller_size_are_passed_on():
    grid = CartesianGrid([0.0, 0.0, 0.0], 1.0, (9, 8, 7))
    cone = SizeFunction(grid, grid.sample(lambda x: 1.0 + np.linalg.norm(x - [4, 3, 2], axis=1)))
    known = {tuple(p) for p in known_points(cone, 3).tolist()}
    # A cone is least of three along an axis in the planes through its tip only.
    assert known == {tuple(p) for p in grid.points.tolist() if p[0] == 4 or p[1] == 3 or p[2] == 2
                     if any(0 < p[d] < grid.shape[d] - 1 and p[d] == (4, 3, 2)[d]
                            for d in range(3))}  # fmt: skip
    active = grid.points[:, 0].reshape(grid.shape) != 4
    some = SizeFunction(grid.with_active(active), cone.values)
    assert {tuple(p) for p in known_points(some, 3).tolist()} == {p for p in known if p[0] != 4}
    flat = SizeFunction(grid, np.ones(grid.shape))
    assert known_points(flat, 3).shape == (0, 3)
    assert known_points(flat, 2).shape == (0, 2)
