"""`limit_on_sphere`: sizes that grow along great circles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import CartesianGrid, limit_on_sphere

EARTH = 6_371_008.8


def haversine(a, b, radius=EARTH):
    """Slow twin of the distance: all pairs of points in degrees."""
    (lon_a, lat_a), (lon_b, lat_b) = np.deg2rad(a).T[:, :, None], np.deg2rad(b).T[:, None, :]
    s = np.sin(0.5 * (lat_a - lat_b)) ** 2
    s += np.cos(lat_a) * np.cos(lat_b) * np.sin(0.5 * (lon_a - lon_b)) ** 2
    return 2.0 * radius * np.arcsin(np.sqrt(np.minimum(s, 1.0)))


def random_problem(n, seed, share):
    rng = np.random.default_rng(seed)
    lon = rng.uniform(-400.0, 400.0, n)  # more than once around
    lat = np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, n)))
    h0 = np.where(rng.random(n) < share, rng.uniform(1e3, 3e6, n), np.inf)
    h0[0] = 1e3
    return np.column_stack([lon, lat]), h0


@pytest.mark.parametrize("share", [0.02, 1.0])
@pytest.mark.parametrize("g", [0, 0.05, 0.3])
@pytest.mark.parametrize("seed", [8201, 8202])
def test_sizes_are_the_minimum_over_all_bounds(seed, g, share):
    points, h0 = random_problem(400, seed, share)
    expected = (h0[None, :] + g * haversine(points, points)).min(axis=1)
    h = limit_on_sphere(points, h0, g)
    assert_allclose(h, expected, rtol=1e-9)
    assert_allclose(limit_on_sphere(points, h, g), h, rtol=1e-12)
    assert (h[:, None] <= h + g * haversine(points, points) * (1 + 1e-7) + 1e-3).all()


def test_a_point_beside_the_seam_and_near_the_pole():
    grid = CartesianGrid([-180.0, -90.0], 10.0, (37, 19))
    h0 = np.full(grid.shape, np.inf)
    h0[36, 17] = 1.0  # 180 degrees east, 80 degrees north
    h = limit_on_sphere(grid, h0, 0.5, radius=2)
    assert h.shape == grid.shape
    assert h[0, 17] == pytest.approx(1.0, abs=1e-12)  # 180 degrees west is the same place
    assert_allclose(h[:, 18], 1.0 + np.deg2rad(10.0), rtol=1e-12)  # the pole
    assert h[18, 17] == pytest.approx(1.0 + np.deg2rad(20.0))  # over the pole
    assert h[18, 1] == pytest.approx(1.0 + np.pi, abs=1e-7)  # the opposite point


def test_threads_and_types_do_not_matter_and_inactive_nodes_have_no_effect():
    grid = CartesianGrid([0, 0], 1, (40, 30), active=np.arange(1200).reshape(40, 30) % 7 > 0)
    h0 = np.random.default_rng(8204).integers(10_000, 900_000, grid.shape)
    h = limit_on_sphere(grid, h0, 0.1, threads=1)
    assert np.array_equal(h, limit_on_sphere(grid, h0.astype(float), 0.1, threads=2))
    assert np.isinf(h[~grid.active]).all()
    rest = limit_on_sphere(grid.points[grid.active.ravel()], h0[grid.active].tolist(), 0.1)
    assert_allclose(h[grid.active], rest, rtol=1e-14)


def test_no_points_and_bad_threads_are_refused_by_name():
    with pytest.raises(ValueError, match="h0 must be finite at one node at least"):
        limit_on_sphere(np.empty((0, 2)), [], 0.2)
    with pytest.raises(ValueError, match=r"threads must be a whole number, got 1\.5"):
        limit_on_sphere([[0.0, 0.0]], [1.0], 0.2, threads=1.5)
