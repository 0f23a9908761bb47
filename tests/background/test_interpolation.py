"""`interpolate`: nodal values of any background at any points."""

import numpy as np
import pytest
from meshes import random_square

from adaptsize import CartesianGrid, Octree, SimplexMesh, interpolate, refine_at_boundary
from adaptsize.background.interpolation import cell_gradients, hat_gradients

GRID = CartesianGrid((-1.0, -1.0), 0.25, (9, 9))
TREE = Octree.build(
    [-1, -1], [1, 1], refine_at_boundary(lambda x: np.hypot(*x.T) - 0.5), max_level=4
)
POINTS = np.random.default_rng(3).uniform(-0.7, 0.7, (200, 2))


def linear(points):
    return 3.0 + points @ [2.0, -1.0]


@pytest.mark.parametrize("background", [random_square(80, 1), GRID, TREE], ids=repr)
def test_linear_functions_are_exact_on_every_background(background):
    values = linear(background.points).reshape(background.nodal_shape)
    found = interpolate(background, values, POINTS)
    inside = ~np.isnan(interpolate(background, values, POINTS, outside="nan"))
    assert inside.sum() > 100
    np.testing.assert_allclose(found[inside], linear(POINTS[inside]), atol=1e-12)


def test_points_outside_get_the_nearest_value_or_nan():
    values = linear(GRID.points).reshape(GRID.shape)
    outside = [[4.0, 0.5], [0.0, 0.0]]
    found = interpolate(GRID, values, outside)
    np.testing.assert_allclose(found, [linear(np.array([1.0, 0.5])), 3.0])
    np.testing.assert_array_equal(
        np.isnan(interpolate(GRID, values, outside, outside="nan")), [True, False]
    )


def test_corners_are_not_outside_by_rounding():
    grid = CartesianGrid((1e6, 1e6), 0.1, (4, 4))
    assert np.isfinite(interpolate(grid, np.ones((4, 4)), [grid.upper], outside="nan")).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("background", [random_square(80, 1), GRID], ids=repr)
def test_only_what_is_outside_by_more_than_rounding_is_nan(background, scale):
    if isinstance(background, CartesianGrid):
        background = CartesianGrid(scale * background.origin, scale * background.spacing, (9, 9))
    else:
        background = background.moved(scale * background.points)
    values = np.ones(background.nodal_shape)
    end = background.points[background.points[:, 0].argmax()]
    across = np.zeros(2)
    across[0] = background.diagonal
    points = [end + off * across for off in (1e-14, 1e-10, 1e-3)]
    found = np.isnan(interpolate(background, values, points, outside="nan"))
    np.testing.assert_array_equal(found, [False, True, True])


def test_gradients_in_the_plane_are_those_of_the_hat_functions():
    rng = np.random.default_rng(77)
    points = rng.random((40, 2))
    points[30:] = np.linspace(0.0, 1.0, 10)[:, None] * [0.5, 0.25]
    cells = np.array([rng.permutation(40)[:3] for _ in range(200)] + [[30, 33, 36]])
    mesh, values = SimplexMesh(points, cells), rng.random(40)
    values[7] = np.inf
    found = cell_gradients(mesh, values)
    measures, hats = hat_gradients(mesh)
    bounded = np.isfinite(values[cells]).all(axis=1)
    assert (found[~bounded] == 0.0).all()
    assert found[-1].tolist() == [0.0, 0.0]
    solid = bounded & (measures > 0.0)
    expected = np.einsum("cv,cvd->cd", values[cells[solid]], hats[solid])
    np.testing.assert_allclose(found[solid], expected, rtol=1e-9, atol=1e-9)
