"""Local feature size from the medial axis, on shapes whose widths are known."""

import numpy as np
import pytest
from distance_shapes import annulus, ball, box, polygon, regular_polygon, sampled, turned

from adaptsize import feature_size


def at(grid, values, place):
    """Return the value of the node closest to a place."""
    node = np.rint((np.asarray(place) - grid.origin) / grid.spacing).astype(int)
    return values[tuple(node)]


# Widths


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_between_parallel_walls_it_is_half_their_distance(degrees):
    step = 0.02
    grid, phi = sampled(turned(box(1.8, 0.6), degrees), step)
    size = feature_size(grid, phi)
    angle = np.radians(degrees)
    x, y = np.abs(grid.points @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).T
    middle = ((x < 0.5) & (y < 0.3)).reshape(grid.shape)
    # Marching a plane along a diagonal is of first order next to the seeds only.
    assert np.abs(size[middle] - 0.3).max() < 0.5 * step
    assert np.abs(size[middle] - 0.3).mean() < 0.1 * step
    assert np.isinf(size[phi > 0.0]).all()
    assert np.isfinite(size[phi <= 0.0]).all()


@pytest.mark.parametrize("spacings", [2.5, 3.0, 4.0])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_strips_of_a_few_spacings_are_resolved(degrees, spacings):
    step = 0.02
    shape = turned(box(1.8, spacings * step), degrees)
    for shift in ((0.0, 0.0), (0.5, 0.5), (0.31, 0.77)):
        grid, phi = sampled(shape, step, shift=shift)
        inside = feature_size(grid, phi)[phi <= 0.0]
        assert np.median(inside) == pytest.approx(0.5 * spacings * step, rel=0.01)
        # At the ends the corners are close.
        assert inside.max() < 4.0 * step


def test_on_an_annulus_it_converges():
    error = []
    for n in (20, 40, 80):
        grid, phi = sampled(annulus(0.4, 1.0), 1.0 / n, shift=(0.3, 0.6))
        inside = phi <= 0.0
        error.append(np.abs(feature_size(grid, phi)[inside] - 0.3).max())
    order = np.log2(np.divide(error[:-1], error[1:]))
    # Marching at first order.
    assert (order > 0.8).all(), f"errors {error}, orders {order}"
    assert error[-1] < 0.3 / 80.0


@pytest.mark.parametrize("steps", [6.3, 14.0])
def test_in_balls_and_discs_it_is_the_radius(steps):
    rng = np.random.default_rng(20060112)
    for dim, half in ((2, 1.2), (3, 1.0)):
        step = 0.9 / steps
        for _ in range(6):
            grid, phi = sampled(ball(0.9), step, dim=dim, half=half, shift=rng.random(3)[:dim])
            size = feature_size(grid, phi)[phi <= 0.0]
            # A centre up to a spacing off, and rings around it at first order.
            assert size.max() < 0.9 + 1.6 * step
            assert size.min() > 0.9 - 1.3 * step


# Corners


@pytest.mark.parametrize("sides", [3, 5, 6, 12])
def test_at_a_polygon_it_is_at_most_a_side_and_not_small(sides):
    step = 0.015
    shape = turned(regular_polygon(sides, 1.0), 7.0)
    grid, phi = sampled(shape, step)
    size = feature_size(grid, phi)
    side, inner = 2.0 * np.sin(np.pi / sides), np.cos(np.pi / sides)
    at_boundary = (phi <= 0.0) & (phi > -1.5 * step)
    assert size[at_boundary].max() < min(side, 1.0) + 2.5 * step
    assert size[phi <= 0.0].min() > min(side, inner) - 2.5 * step


@pytest.mark.parametrize("corner_angle", [30.0, 10.0])
def test_a_sharp_wedge_is_narrow_unless_it_counts_as_a_corner(corner_angle):
    half = np.radians(10.0)
    wedge = polygon([(-1.0, 0.0), (1.0, -2.0 * np.tan(half)), (1.0, 2.0 * np.tan(half))])
    grid, phi = sampled(wedge, 0.02, half=1.1)
    size = feature_size(grid, phi, corner_angle=corner_angle)
    tip = at(grid, size, (-0.8, 0.0))
    if corner_angle == 30.0:
        assert tip == pytest.approx(0.2 * np.sin(half), abs=0.01)
    else:
        assert tip > 0.3
