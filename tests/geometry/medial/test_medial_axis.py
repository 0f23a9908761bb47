"""Algorithm 1 on shapes whose medial axis is known."""

import numpy as np
import pytest
from distance_shapes import Ellipse, annulus, box, sampled, torus, turn_about, turned
from scipy.spatial import cKDTree

from adaptsize import CartesianGrid, medial_axis

SHIFTS = [(0.0, 0.0), (0.5, 0.5), (0.31, 0.77)]


def covered(axis_points, found, reach):
    """Return the share of points of the true axis with one found within reach."""
    return float(np.mean(cKDTree(found).query(axis_points)[0] <= reach))


def between(a, b, n=400):
    return np.linspace(a, b, n)


# Positions


def test_points_of_an_annulus_are_of_third_order():
    error = []
    for n in (20, 40, 80):
        grid, phi = sampled(annulus(0.4, 1.0), 1.0 / n, shift=(0.3, 0.6))
        found = medial_axis(grid, phi)
        error.append(np.abs(np.linalg.norm(found.points, axis=1) - 0.7).max())
        # An edge crosses a circle of radius R about 8 R / h times.
        assert len(found.points) > 0.9 * 8.0 * 0.7 * n
    order = np.log2(np.divide(error[:-1], error[1:]))
    # Parabolas: an error of h^3 over the jump of the slopes.
    assert (order > 2.7).all(), f"errors {error}, orders {order}"
    assert error[0] < 0.005 / 20.0


def test_normals_radii_angles_and_distances_of_an_annulus():
    grid, phi = sampled(annulus(0.4, 1.0), 0.02, shift=(0.3, 0.6))
    found = medial_axis(grid, phi)
    outward = found.points / np.linalg.norm(found.points, axis=1)[:, None]
    across = np.abs((found.normals * outward).sum(axis=1))
    np.testing.assert_allclose(across, 1.0, atol=2e-3)
    np.testing.assert_allclose(found.radii, 0.3, atol=1e-4)
    assert found.angles.min() > 175.0
    known = np.isfinite(found.distances)
    exact = np.abs(np.linalg.norm(grid.points, axis=1) - 0.7).reshape(grid.shape)
    # The tangent instead of the circle, at up to a spacing from it: h^2 / (2 R).
    off = np.abs(found.distances - exact)[known]
    assert off.max() < 0.02**2 / 0.7
    assert known.sum() > len(found.points)


@pytest.mark.parametrize("shift", SHIFTS)
def test_axis_of_an_ellipse_ends_at_the_centres_of_curvature(shift):
    step = 1.0 / 60.0
    grid, phi = sampled(Ellipse(1.0, 0.5), step, shift=shift)
    x, y = medial_axis(grid, phi).points.T
    # x = +-(a^2 - b^2) / a, where both fronts fall together and no method has digits.
    inner = np.abs(x) < 0.6
    assert np.abs(y[inner]).max() < 0.002 * step
    assert np.abs(y).max() < 0.5 * step
    assert 0.75 - 1.5 * step < np.abs(x).max() < 0.75 + 2.0 * step
    assert covered(between((-0.7, 0.0), (0.7, 0.0)), np.column_stack([x, y]), step) == 1.0


# False points


@pytest.mark.parametrize("part", [0.001, 0.01, 0.1])
def test_noise_of_a_tenth_of_a_spacing_gives_no_points_near_the_boundary(part):
    step = 1.0 / 60.0
    rng = np.random.default_rng(19731)
    for shape, radius in (
        (turned(box(1.8, 0.8), 20.0), 0.4),
        (annulus(0.5, 1.0), 0.25),
    ):
        grid, phi = sampled(shape, step)
        found = medial_axis(grid, phi + part * step * rng.uniform(-1.0, 1.0, phi.shape))
        assert len(found.points) > 40
        assert found.radii.min() > 0.9 * radius


# In space


@pytest.mark.parametrize("turn", [np.eye(3), turn_about((1.0, 2.0, 3.0), 40.0)])
def test_axis_of_a_torus_is_a_circle(turn):
    step = 1.0 / 32.0
    shape = turned(torus(0.55, 0.22), turn)
    grid, phi = sampled(shape, step, dim=3, half=0.85, shift=(0.3, 0.1, 0.6))
    found = medial_axis(grid, phi)
    x, y, z = (found.points @ turn).T
    assert np.hypot(np.hypot(x, y) - 0.55, z).max() < 1.2 * step
    angle = between(0.0, 2.0 * np.pi)
    circle = 0.55 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    assert covered(circle, found.points @ turn, 2.0 * step) == 1.0


@pytest.mark.parametrize(
    ("distance", "message"),
    [
        (np.full((5, 5), np.nan), r"boundary must be finite, got boundary\[0, 0\] = nan"),
        (np.ones((5, 5)), "boundary must be negative at one node at least"),
        (np.ones((4, 5)), r"boundary must have shape \(5, 5\)"),
    ],
)
def test_a_distance_is_refused_by_the_name_of_its_argument(distance, message):
    with pytest.raises(ValueError, match=message):
        medial_axis(CartesianGrid([0.0, 0.0], 0.1, (5, 5)), distance)
