"""Signed distance to what a mask shows, finer than its pixels."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage

from adaptsize import CartesianGrid, signed_distance


def disc(radius, shift, spacing=(1.0, 1.0)):
    """A grid of pixels around a disc, its mask, and the exact distances."""
    spacing = np.asarray(spacing)
    half = np.ceil((radius + 6.0 * spacing.max()) / spacing)
    grid = CartesianGrid(-half * spacing + shift, spacing, (2 * half + 1).astype(int))
    exact = (np.linalg.norm(grid.points, axis=1) - radius).reshape(grid.shape)
    return grid, exact < 0.0, exact


def test_a_disc_of_radius_40_is_found_to_a_tenth_of_a_pixel():
    # The sides of the pixels are off by 0.3 of a pixel.
    rng = np.random.default_rng(4040)
    own = []
    for shift in rng.uniform(0.0, 1.0, (4, 2)):
        grid, mask, exact = disc(40.0, shift)
        near = np.abs(exact) < 1.0
        # What nodes beside the circle take it to be nearer or farther by.
        own.append(np.abs(signed_distance(grid, mask) - exact)[near].mean())
    assert np.mean(own) < 0.1


def test_discs_do_not_shrink():
    rng = np.random.default_rng(1010)
    for radius in (6.0, 10.0, 40.0):
        bias = []
        for shift in rng.uniform(0.0, 1.0, (6, 2)):
            grid, mask, exact = disc(radius, shift)
            bias.append((signed_distance(grid, mask) - exact)[np.abs(exact) < 2.0].mean())
        # Four rounds of a Gaussian of 1.5 pixels would draw it in by 4 1.5^2 / (2 radius), a
        # tenth of a pixel and more.
        assert abs(np.mean(bias)) < 0.05


def test_a_ball_of_uneven_voxels():
    spacing = np.array([1.0, 1.0, 2.0])
    grid = CartesianGrid([-15.3, -15.1, -16.4], spacing, (31, 31, 17))
    exact = (np.linalg.norm(grid.points, axis=1) - 10.0).reshape(grid.shape)
    phi = signed_distance(grid, exact < 0.0)
    near = np.abs(exact) < 2.0
    assert np.abs(phi - exact)[near].mean() < 0.15
    assert abs((phi - exact)[near].mean()) < 0.1


@pytest.mark.parametrize("seed", [313, 314])
def test_every_pixel_stays_on_its_side(seed):
    rng = np.random.default_rng(seed)
    blobs = ndimage.gaussian_filter(rng.normal(size=(60, 50)), 3.0) > 0.03
    specks = rng.random((60, 50)) > 0.995
    mask = blobs ^ specks
    grid = CartesianGrid([0.0, 0.0], 1.0, mask.shape)
    assert_array_equal(signed_distance(grid, mask) < 0.0, mask)


def test_straight_edges_are_straight():
    grid = CartesianGrid([0.0, 0.0], 1.0, (50, 50))
    x, y = np.meshgrid(np.arange(50.0), np.arange(50.0), indexing="ij")
    # Along the axes nothing is known but that it runs between two rows of pixels.
    assert_allclose(signed_distance(grid, x > 24.2), 24.5 - x, atol=1e-6)
    # The slope is no fraction of small numbers: those leave a stripe that may be 1/2 wide.
    slope = np.array([np.cos(0.4), np.sin(0.4)])
    exact = slope[0] * (x - 25.0) + slope[1] * (y - 20.1)
    phi = signed_distance(grid, exact < 0.0)
    inner = (slice(10, -10),) * 2
    assert np.abs(phi - exact)[inner].mean() < 0.1
