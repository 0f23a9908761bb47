"""Signed distance to what a mask shows, finer than its pixels."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage
from scipy.spatial import cKDTree

from adaptsize import CartesianGrid, SimplexMesh, signed_distance


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


def test_the_distance_is_one_beyond_the_band():
    grid, mask, exact = disc(20.0, [0.3, 0.4])
    phi = signed_distance(grid, mask)
    # The distance of a boundary that is off by 0.3 at most is off by no more.
    assert np.abs(phi - exact).max() < 0.35
    rise = np.abs(np.diff(phi, axis=0)).max(), np.abs(np.diff(phi, axis=1)).max()
    assert max(rise) < 1.01


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


@pytest.mark.parametrize("width", [1, 2])
def test_thin_lines_are_not_lost(width):
    mask = np.zeros((40, 40), bool)
    mask[5:35, 20 - width + 1 : 21] = True
    grid = CartesianGrid([0.0, 0.0], 1.0, mask.shape)
    phi = signed_distance(grid, mask)
    assert (phi[6:34, 20] < -0.2).all()
    # The edge stays between the centres of the pixels inside and out.
    assert_allclose(phi[20, 21:30], np.arange(21, 30) - 20.5, atol=0.25)


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


def test_objects_go_on_beyond_the_border():
    mask = np.zeros((30, 30), bool)
    mask[:12] = True
    grid = CartesianGrid([0.0, 0.0], 1.0, mask.shape)
    exact = np.broadcast_to(np.arange(30.0)[:, None] - 11.5, mask.shape)
    # The filter sees a flat continuation beyond the border, 12 pixels away.
    assert_allclose(signed_distance(grid, mask), exact, atol=0.01)


def test_no_smoothing_gives_the_staircase_roughly():
    grid, mask, exact = disc(10.0, [0.3, 0.4])
    rough = signed_distance(grid, mask, smoothing=0.0)
    fine = signed_distance(grid, mask)
    near = np.abs(exact) < 1.5
    assert np.abs(rough - exact)[near].mean() > 1.5 * np.abs(fine - exact)[near].mean()
    to_pixels = cKDTree(grid.points[mask.ravel()]).query(grid.points)[0].reshape(grid.shape)
    assert_allclose(rough[~mask], to_pixels[~mask] - 0.5, atol=0.5)


@pytest.mark.parametrize("boundary", ["function", "floats", "surface"])
def test_smoothing_is_refused_for_other_boundaries(boundary):
    grid = CartesianGrid([-2.0, -2.0], 0.1, (41, 41))
    phi = np.linalg.norm(grid.points, axis=1).reshape(grid.shape) - 1.0
    given = {
        "function": lambda x: np.linalg.norm(x, axis=1) - 1.0,
        "floats": phi,
        "surface": SimplexMesh([[-1, -1], [1, -1], [0, 1]], [[0, 1], [1, 2], [2, 0]]),
    }[boundary]
    with pytest.raises(ValueError, match="smoothing is for boolean images"):
        signed_distance(grid, given, smoothing=1.5)
