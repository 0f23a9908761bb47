"""Sizes from the curvature of a boundary that is given by its signed distance on a grid."""

import numpy as np
import pytest
from distance_shapes import Ellipse, ball, box, grid_across
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, limit_gradient, size_from_curvature
from adaptsize.geometry import signed_distance

G, K = 0.25, 4.0
RADIUS = 0.6
BALL, ELLIPSE = ball(RADIUS), Ellipse(0.8, 0.4)


def directions(n, dim):
    """Unit vectors spread over the circle or the sphere (Fibonacci's spiral)."""
    turn = np.arange(n) * np.pi * (3.0 - np.sqrt(5.0))
    if dim == 2:
        return np.column_stack([np.cos(turn), np.sin(turn)])
    height = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_asked_between_the_nodes_is_right_on_the_boundary(dim, sign):
    # Linear across: multilinear interpolation errs by the second derivatives of the distance,
    # 1 / R in dim - 1 directions, times G h^2 / 8; and the curvature by h^2 / (4 R^2).
    grid = grid_across(48 if dim == 2 else 24, dim)
    spacing = grid.spacing[0]
    wanted = RADIUS / K
    bound = wanted * spacing**2 / (3.5 * RADIUS**2) + G * (dim - 1) * spacing**2 / (8.0 * RADIUS)
    h0 = size_from_curvature(grid, sign * grid.sample(BALL), g=G)
    found = SizeFunction(grid, h0)(RADIUS * directions(200, dim))
    assert_allclose(found, wanted, atol=1.2 * bound)


@pytest.mark.parametrize("angle", [0.15, 0.25, 0.6])
def test_a_square_has_no_curvature_at_any_angle(angle):
    c, s = np.cos(angle), np.sin(angle)
    grid = CartesianGrid([-1.3, -1.3], 2.6 / 250, (251, 251))
    phi = grid.sample(lambda x: np.abs(x @ np.array([[c, -s], [s, c]])).max(axis=1) - 0.8)
    assert (size_from_curvature(grid, phi) > 100.0).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_limited_sizes_are_right_on_the_boundary_and_inside(sign):
    grid = grid_across(48)
    phi = sign * grid.sample(BALL)
    h = limit_gradient(grid, size_from_curvature(grid, phi, g=G), G)
    wanted = RADIUS / K
    # As above, 0.0013 and 0.0007; the limiter adds little where the field is a distance.
    assert_allclose(SizeFunction(grid, h)(RADIUS * directions(200, 2)), wanted, rtol=2.5e-3)
    inside = (phi < 0.0) & (phi > -0.35)
    assert_allclose(h[inside], (wanted - G * phi)[inside], rtol=5e-3)


def exact_on_ellipse(x):
    """Limited sizes inside the ellipse: the smallest of 1 / (K kappa) + g distance."""
    t = np.linspace(0.0, 2.0 * np.pi, 1500)
    away = np.linalg.norm(x[:, None] - ELLIPSE.at(t), axis=2)
    return (1.0 / (K * ELLIPSE.curvature_at(t)) + G * away).min(axis=1)


def errors_on_ellipse(n, asked):
    """Relative errors of the limited sizes on the boundary and inside, from what is asked for."""
    grid = grid_across(n)
    phi = grid.sample(ELLIPSE)
    h0 = asked(grid, phi)
    h = limit_gradient(grid, h0, G)
    at = ELLIPSE.at(np.linspace(0.0, 2.0 * np.pi, 157))
    inside = phi.ravel() < 0.0
    return (
        SizeFunction(grid, h)(at) / exact_on_ellipse(at) - 1.0,
        h.ravel()[inside] / exact_on_ellipse(grid.points[inside]) - 1.0,
    )


def test_sizes_that_change_along_the_boundary_are_right():
    for part in errors_on_ellipse(96, lambda grid, phi: size_from_curvature(grid, phi, g=G)):
        assert np.abs(part).max() < 0.03


@pytest.mark.parametrize("dim", [2, 3])
def test_flat_boundaries_ask_for_nothing(dim):
    def slope(x):  # no axis is normal to it
        normal = np.array([3.0, 4.0, 12.0])[:dim]
        return x @ (normal / np.linalg.norm(normal)) - 0.1

    grid = grid_across(20, dim)
    assert_array_equal(size_from_curvature(grid, grid.sample(slope)), np.inf)
    assert_array_equal(size_from_curvature(grid, grid.sample(slope), hmax=0.3), 0.3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_radii_from_two_and_a_quarter_spacings_are_resolved(sign):
    grid = CartesianGrid([-8.0, -8.0], 1.0, (17, 17))
    for centre in np.random.default_rng(90210).uniform(-0.5, 0.5, (20, 2)):
        phi = sign * grid.sample(lambda x, c=centre: np.linalg.norm(x - c, axis=1) - 2.25)
        asked = size_from_curvature(grid, phi, g=0.0)
        assert_allclose(asked[np.isfinite(asked)], 2.25 / K, rtol=0.05)
        assert np.isfinite(asked).any()


@pytest.mark.parametrize("radius", [12.0, 40.0])
def test_sizes_of_pixels_are_smoothed(radius):
    # The distance of a mask ripples along the boundary with the steps of the pixels.
    n = int(2.6 * radius)
    grid = CartesianGrid([0.0, 0.0], 1.0, (n, n))
    mask = grid.sample(lambda x: np.linalg.norm(x - n / 2 - 0.2, axis=1) - radius) < 0.0
    phi = signed_distance(grid, mask)
    spread = []
    for smoothing in (0, 16):
        h0 = size_from_curvature(grid, phi, g=0.0, smoothing=smoothing)
        ratio = K * h0[np.isfinite(h0)] / radius
        assert np.median(ratio) == pytest.approx(1.0, abs=0.06)
        spread.append(np.quantile(ratio, 0.05))
    assert spread[1] > 0.65
    assert spread[1] > spread[0] + 0.1


def test_limits_of_the_size_and_tolerance():
    grid = grid_across(40)
    phi = grid.sample(BALL)
    h0 = size_from_curvature(grid, phi, hmin=0.2, hmax=0.5, tolerance=0.1)
    assert_array_equal(np.unique(h0), [0.2, 0.5])
    assert_array_equal(h0[phi < -0.1], 0.5)
    assert_array_equal(h0[(phi <= 0.0) & (phi >= -0.1)], 0.2)


def test_bad_arguments_are_named():
    grid = grid_across(10)
    phi = grid.sample(BALL)
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="boundary must be a SimplexMesh, or distances on a"):
        size_from_curvature(mesh, np.zeros(3))
    with pytest.raises(ValueError, match=r"boundary must have shape \(11, 11\)"):
        size_from_curvature(grid, phi.T[:5])
    with pytest.raises(ValueError, match=r"boundary must be zero near nodes .* 5\."):
        size_from_curvature(grid, phi + 6.0)
    with pytest.raises(ValueError, match="boundary must be a signed distance"):
        size_from_curvature(grid, 3.0 * phi)
    with pytest.raises(ValueError, match="boundary must be zero near"):
        size_from_curvature(grid, np.full(grid.shape, np.nan))
    line = CartesianGrid([0.0], 0.1, (5,))
    with pytest.raises(ValueError, match="grid must be 2-D or 3-D"):
        size_from_curvature(line, np.zeros(5))


def test_edges_and_corners_of_a_box_are_not_curvature():
    grid = grid_across(24, 3)
    assert_array_equal(size_from_curvature(grid, grid.sample(box(1.4, 1.2, 1.0))), np.inf)


def test_inactive_nodes_ask_for_nothing():
    grid = grid_across(40)
    phi = grid.sample(BALL)
    inside = phi <= 0.0
    everywhere = size_from_curvature(grid, phi)
    h0 = size_from_curvature(grid.with_active(inside), phi)
    assert_array_equal(h0[inside], everywhere[inside])
    assert_array_equal(h0[~inside], np.inf)
