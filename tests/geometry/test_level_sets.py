"""Curvature of boundaries that are given by their signed distance on a grid."""

import distance_shapes as shapes
import numpy as np
import pytest
from distance_shapes import grid_across
from numpy.testing import assert_array_equal

from adaptsize.geometry import level_set_curvature

RADIUS, TUBE = 0.6, 0.25
BALL, ELLIPSE = shapes.ball(RADIUS), shapes.Ellipse(0.8, 0.4)


def torus_curvature(x):
    """Of the closest point of the tube: 1 / r, and cos(t) / (R + r cos(t)) around the axis."""
    away = np.hypot(x[:, 0], x[:, 1]) - RADIUS
    cosine = away / np.hypot(away, x[:, 2])
    return np.column_stack([np.full(len(x), 1.0 / TUBE), cosine / (RADIUS + TUBE * cosine)])


def near(grid, phi, width=2.0):
    """Nodes up to some spacings from the boundary, those on the border of the grid left out."""
    found = np.zeros(grid.shape, bool)
    core = (slice(1, -1),) * grid.dim
    found[core] = np.abs(phi[core]) <= width * grid.spacing.max()
    return found


def largest_error(grid, shape, exact, **options):
    """The largest error of the boundary's curvature, of nodes up to 2 spacings from it."""
    phi = grid.sample(shape)
    kappa = level_set_curvature(grid, phi, **options)
    inside = near(grid, phi)
    expected = exact(grid.points) if callable(exact) else exact
    expected = np.broadcast_to(expected, (grid.n_points, grid.dim - 1)).reshape(kappa.shape)
    assert np.isfinite(kappa[inside]).all()
    return np.abs(kappa - expected)[inside].max()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_circles_and_spheres_to_the_accuracy_of_the_differences(dim, sign):
    # Under 45 degrees to the axes the third derivatives of the distance r make the differences
    # err by h^2 / (4 r^2), and 1 / (1 - kappa phi) = r / R makes that h^2 / (4 r R).
    grid = grid_across(40, dim)
    h = grid.spacing[0]
    bound = h**2 / (4.0 * (RADIUS - 2.0 * h) * RADIUS) / RADIUS
    error = largest_error(grid, lambda x: sign * BALL(x), sign / RADIUS)
    assert 0.1 * bound < error < 1.02 * bound  # and terms in h^4


SMOOTH = {
    "circle": (2, BALL, 1.0 / RADIUS),
    "ellipse": (2, ELLIPSE, lambda x: ELLIPSE.curvature_at(ELLIPSE.closest(x))[:, None]),
    "sphere": (3, BALL, 1.0 / RADIUS),
    "torus": (3, shapes.torus(RADIUS, TUBE), torus_curvature),
}


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("stretch", [1.0, 0.5])
def test_second_order(name, stretch):
    dim, shape, exact = SMOOTH[name]
    cells = (40, 80) if dim == 3 else (80, 160)
    error = [largest_error(grid_across(n, dim, stretch=stretch), shape, exact) for n in cells]
    order = np.log2(np.divide(error[:-1], error[1:]))
    # Nodes 2 spacings inside come away from the centres of curvature as the grid is refined.
    assert (order > 1.9).all(), f"errors {error}, orders {order}"


@pytest.mark.parametrize("dim", [2, 3])
def test_smoothing_keeps_circles_and_damps_noise(dim):
    grid = grid_across(40, dim)
    phi = grid.sample(BALL)
    inside = near(grid, phi)
    exact = 1.0 / RADIUS
    smooth = level_set_curvature(grid, phi, smoothing=2)[inside]
    assert np.abs(smooth - exact).max() < 0.01 * exact
    noise = np.random.default_rng(8123).normal(scale=0.02 * grid.spacing[0], size=grid.shape)
    error = [
        np.sqrt(np.mean((level_set_curvature(grid, phi + noise, smoothing=n)[inside] - exact) ** 2))
        for n in (0, 1, 2)
    ]
    # White noise of deviation e in phi is one of about sqrt(6) e / h^2 in second differences;
    # one average takes the middle coefficients 1, -2, 1 to 1/4, 0, -1/2, 0, 1/4, deviation 0.61.
    assert error[1] < error[0] / 2.5
    assert error[2] < error[1] / 1.5


def test_kinks_are_those_of_the_distance_however_often_it_is_smoothed():
    grid = grid_across(40)
    phi = grid.sample(BALL)
    phi[3, 5] += 0.02  # something that shows
    # Averages over 4 spacings shorten the gradient near the middle, that of phi is what counts.
    found = [
        level_set_curvature(grid, phi, at_boundary=False, gradient_tolerance=0.06, smoothing=n)
        for n in (0, 32)
    ]
    assert_array_equal(*map(np.isfinite, found))
