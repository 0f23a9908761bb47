"""Curvature of functions, at steps of their own, and projection at kinks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import Octree
from adaptsize._progress import silent
from adaptsize.geometry.distance.closest_points import ZeroLevelBoundary
from adaptsize.geometry.implicit_surface import largest_curvature, project


def on_sphere(n, dim, seed):
    x = np.random.default_rng(seed).standard_normal((n, dim))
    return x / np.linalg.norm(x, axis=1)[:, None]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("radius", [1e-3, 0.3, 40.0])
def test_of_spheres_of_any_scale_and_any_function(dim, radius):
    y = radius * on_sphere(50, dim, 7)
    step = np.full(50, 0.3)
    for f in (
        lambda x: np.linalg.norm(x, axis=1) - radius,
        lambda x: 50.0 * ((x**2).sum(axis=1) - radius**2),
    ):
        kappa = largest_curvature(f, y, step, least_step=1e-5)
        assert_allclose(kappa, 1.0 / radius, rtol=0.01)


def test_of_a_saddle_the_larger_modulus():
    def torus(x):
        return np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2]) - 0.8

    inner = np.array([[0.2, 0.0, 0.0], [0.0, 0.2, 0.0]])  # 1 / 0.2 around, -1 / 0.8 along
    assert_allclose(
        largest_curvature(torus, inner, np.full(2, 0.1), least_step=1e-5), 5.0, rtol=1e-2
    )


def test_kinks_are_no_curvature():
    def square(x):
        return np.abs(x).max(axis=1) - 1.0

    t = np.array([0.0, 1e-7, 1e-5, 1e-4, 1e-3, 0.1])
    y = np.column_stack([np.ones(6), 1.0 - t])
    kappa = largest_curvature(square, y, np.full(6, 0.2), least_step=1e-4)
    assert_allclose(kappa, 0.0, atol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_project_to_corners_edges_and_faces_of_a_cube(dim):
    def cube(x):
        return 3.0 * (np.abs(x).max(axis=1) - 1.0)

    x = np.random.default_rng(5).uniform(-2.0, 2.0, (400, dim))
    x = x[np.abs(x).max(axis=1) > 1.1]
    wanted = np.clip(x, -1.0, 1.0)
    start = wanted + np.random.default_rng(6).uniform(-0.1, 0.1, x.shape)
    feet = project(cube, x, start, 0.3, silent)
    off = np.linalg.norm(feet - wanted, axis=1)
    # Starts on another face may end beside the edge.
    assert np.quantile(off, 0.99) < 1e-10
    assert off.max() < 0.1


def test_zero_level_boundary_gives_exact_depths():
    def f(p):
        return np.expm1(2.0 * (np.hypot(p[:, 0], p[:, 1]) - 1.0))

    tree = Octree([-2, -2], [2, 2], (1, 1), [4] * 256)
    boundary = ZeroLevelBoundary(f, tree, f(tree.points))
    x = np.random.default_rng(11).uniform(-1.9, 1.9, (200, 2))
    seen = boundary.seen_from(x)
    r = np.hypot(x[:, 0], x[:, 1])
    assert_allclose(seen.depth, 1.0 - r, atol=1e-8)
    assert_allclose(seen.outward, x / r[:, None], atol=1e-5)
    assert_allclose(boundary.distance(x), np.abs(1.0 - r), atol=1e-8)
    assert_allclose(
        boundary.seen_from(tree.points).depth,
        1.0 - np.linalg.norm(tree.points, axis=1),
        atol=1e-8,
    )
