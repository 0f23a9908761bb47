"""`SignedDistance`: distances and signs of polygons and surfaces, as a function of points."""

import numpy as np
import pytest
from distance_shapes import polygon
from meshes import random_square

from adaptsize import SignedDistance, signed_distance

RNG = np.random.default_rng(7)


def star(n, seed, centre=(0.0, 0.0)):
    """Return a star-shaped polygon and its radius as a function of the angle's index."""
    radii = 1.0 + 0.5 * np.random.default_rng(seed).uniform(-1, 1, n)
    angles = 2 * np.pi * np.arange(n) / n
    return centre + np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)


def by_brute_force(polygons, points):
    """Return distances to all segments; inside is what an odd number of polygons holds."""
    each = np.array([polygon(corners)(points) for corners in polygons])
    return np.sign(each).prod(axis=0) * np.abs(each).min(axis=0)


@pytest.mark.parametrize("n", [3, 4, 40, 1001])
@pytest.mark.parametrize("turned", [False, True])
def test_polygons_with_holes_agree_with_all_segments_and_angles(n, turned):
    hole = 0.3 * star(7, 2)
    island = 0.1 * star(5, 3)
    polygons = [star(n, 1), hole[::-1] if turned else hole, island, star(6, 4, (5.0, 0.0))]
    points = RNG.uniform(-2, 6, (2000, 2))
    found = SignedDistance(polygons)(points)
    np.testing.assert_allclose(found, by_brute_force(polygons, points), atol=1e-12)
    np.testing.assert_array_equal(SignedDistance(polygons).unsigned(points), np.abs(found))


def test_points_at_the_heights_of_corners_have_the_right_sign():
    corners = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    x = np.array([-0.5, 0.5, 1.5, 2.5])
    for y, inside in [(0.0, 0), (0.5, 2), (1.0, 1), (1.5, 1), (2.0, 0)]:
        values = SignedDistance(corners)(np.stack([x, np.full(4, y)], axis=1))
        assert (values < 0).sum() == inside, y


def test_many_polygons_through_each_other_agree_with_all_segments_at_the_heights_of_corners():
    polygons = [RNG.integers(0, 30, (n, 2)).astype(float) for n in RNG.integers(3, 30, 100)]
    polygons = [p for p in polygons if (p[0] != p[-1]).any()]
    x, y = points = (RNG.integers(0, 60, (500, 2)) / 2.0 + [0.25, 0.0]).T
    n_crossed = np.zeros(len(x), int)
    for corners in polygons:
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            (ax, ay), (bx, by) = (a, b) if a[1] < b[1] else (b, a)
            n_crossed += (ay <= y) & (y < by) & ((bx - ax) * (y - ay) > (x - ax) * (by - ay))
    values = SignedDistance(polygons)(points.T)
    assert 0.2 < (values < 0).mean() < 0.8
    np.testing.assert_array_equal((values < 0)[values != 0], (n_crossed % 2 == 1)[values != 0])


def test_meshes_agree_with_signed_distance():
    mesh = random_square(60, 3)
    points = random_square(500, 4, half_width=2.0)
    np.testing.assert_allclose(
        SignedDistance(mesh)(points.points), signed_distance(points, mesh.boundary().mesh)
    )
