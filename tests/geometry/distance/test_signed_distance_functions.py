"""Signed distance to zero levels of functions that are far from distances."""

import numpy as np
import pytest
from meshes import jittered_square
from numpy.testing import assert_allclose

from adaptsize import CartesianGrid, Octree, signed_distance


def radius(x):
    return np.linalg.norm(x, axis=1)


def to_circle(x):
    return radius(x) - 1.0


# Zero on the unit circle (sphere); slopes there from 1 to 5, from e^-1 to e, 4, and 0.1 to 5.8.
FAR_FROM_DISTANCES = {
    "waves": lambda x: (radius(x) ** 2 - 1.0) * (2.0 + np.sin(3.0 * x[:, 0] + 1.0)),
    "exponential": lambda x: np.expm1(2.0 * to_circle(x)) * np.exp(x[:, 0]),
    "quartic": lambda x: (x**2).sum(axis=1) ** 2 - 1.0,
    "valley": lambda x: (((x - 1.0 / np.sqrt(2.0)) ** 2).sum(axis=1) + 0.05) * to_circle(x),
}
EACH = pytest.mark.parametrize("function", FAR_FROM_DISTANCES.values(), ids=FAR_FROM_DISTANCES)


def grid_of(n, dim=2):
    return CartesianGrid([-1.83, -1.79, -1.81][:dim], 3.6 / n, (n + 1,) * dim)


def exact_on(grid):
    return to_circle(grid.points).reshape(grid.shape)


@EACH
@pytest.mark.parametrize("dim", [2, 3])
def test_projection_is_exact_in_the_band(function, dim):
    grid = grid_of(40, dim)
    exact, h = exact_on(grid), grid.spacing.max()
    phi = signed_distance(grid, function)
    near = np.abs(exact) <= 3.0 * h
    # Differences over 0.001 spacings have a relative error of 1e-6 h^2 / 6 in the gradient,
    # whose direction moves the foot by d times that and the distance by its square.
    assert_allclose(phi[near], exact[near], atol=1e-8 * h)
    # Beyond, the paraboloid around a foot up to a spacing away: third order in that, seen
    # largest at the centre, where curvature and distance all but cancel.
    assert_allclose(phi, exact, atol=0.01 * h)
    assert np.abs(phi - exact).mean() < 1e-4 * h


@EACH
def test_everywhere_exact_with_an_endless_band(function):
    grid = grid_of(40)
    phi = signed_distance(grid, function, band=np.inf)
    # Beside the centre the way to the foot is ill conditioned, by 1 over the share of the radius.
    assert_allclose(phi, exact_on(grid), atol=1e-5 * grid.spacing.max())


@EACH
def test_second_order_and_more_beyond_the_band(function):
    errors = []
    for n in (20, 40, 80):
        grid = grid_of(n)
        exact = exact_on(grid)
        # Away from the centre, where the order is lost.
        far = (np.abs(exact) > 3.0 * grid.spacing.max()) & (exact > -0.7)
        errors.append(np.abs(signed_distance(grid, function, band=1.0) - exact)[far].max())
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (order > 1.5).all(), f"errors {errors}, orders {order}"
    assert errors[-1] < 1e-4


def test_corners_of_the_zero_level():
    # max(|x|, |y|) - 1 has the level sets of a square; its distance is round at the corners.
    grid = CartesianGrid([-2.01, -2.03], 0.1, (41, 41))
    away = np.abs(grid.points) - 1.0
    exact = np.hypot(*np.maximum(away, 0.0).T) + np.minimum(away.max(axis=1), 0.0)
    for band in (3.0, np.inf):
        phi = signed_distance(grid, lambda x: np.abs(x).max(axis=1) - 1.0, band=band).ravel()
        projected = np.abs(exact) <= band * 0.1
        assert_allclose(phi[projected], exact[projected], atol=1e-9)
        assert_allclose(phi, exact, atol=0.15 * 0.1)


def test_distances_go_straight_through_thin_parts_and_between_parts():
    # Two discs 3 spacings apart, each nearest on its side.
    def two(x):
        return np.minimum(radius(x - [0.9, 0.0]) ** 2, radius(x - [-0.9, 0.0]) ** 2) - 0.7**2

    grid = CartesianGrid([-2.01, -1.52], 0.13, (32, 25))
    to_left, to_right = (radius(grid.points - [c, 0.0]) - 0.7 for c in (-0.9, 0.9))
    phi = signed_distance(grid, two).ravel()
    assert_allclose(phi, np.minimum(to_left, to_right), atol=2e-3 * 0.13)


def test_meshes_and_octrees():
    function = FAR_FROM_DISTANCES["waves"]
    mesh = jittered_square(41, 613, half_width=1.8)

    def near(centres, sizes):
        return np.abs(to_circle(centres)) < sizes[:, 0]

    tree = Octree.build([-1.8, -1.79], [1.8, 1.81], near, max_level=6)
    solid = Octree.build([-1.5] * 3, [1.6] * 3, near, max_level=4)
    for background, h in ((mesh, 0.09), (tree, 0.057), (solid, 0.2)):
        phi = signed_distance(background, function)
        exact = to_circle(background.points)
        close = np.abs(exact) <= 3.0 * h
        assert_allclose(phi[close], exact[close], atol=1e-7 * h)
        assert_allclose(phi, exact, atol=0.01 * h)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_functions_of_one_sign_are_refused(sign):
    with pytest.raises(ValueError, match="boundary must change its sign"):
        signed_distance(grid_of(4), lambda x: sign * (1.0 + radius(x)))
