"""`limit_metric` against closed forms, a search of all nodes, and the laws of limiting."""

import numpy as np
import pytest
from metric_oracle import largest_ratio, limited_by_all, random_metric, random_rotations
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.metrics import Metric, limit_metric

G = 0.3


def random_mesh(seed, n, dim):
    rng = np.random.default_rng(seed)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * dim), axis=-1).reshape(-1, dim)
    points = np.vstack([corners, rng.random((n - 2**dim, dim))])
    return ads.SimplexMesh(points, Delaunay(points).simplices), rng


def curved_layer(points):
    """Sizes of 0.01 across a curved line or surface, growing away from it, and 0.2 along it."""
    x, y = points[:, 0], points[:, 1]
    away = x - 0.5 - 0.1 * np.sin(2.0 * np.pi * y)
    normals = np.zeros_like(points)
    normals[:, 0], normals[:, 1] = 1.0, -0.2 * np.pi * np.cos(2.0 * np.pi * y)
    return ads.metric_from_layers(
        away, normals, first_height=0.01, growth=1.6, tangential=0.2, max_aspect=20.0
    )


def everywhere(dim, decades):
    mesh, rng = random_mesh(17, 90 if dim == 2 else 70, dim)
    metric = random_metric(rng, mesh.n_points, dim, decades) if decades else None
    return mesh, metric or curved_layer(mesh.points)


CASES = [(2, 0), (2, 0.05), (2, 1.0), (2, 6.0), (3, 0), (3, 0.05), (3, 1.0), (3, 6.0)]


@pytest.mark.parametrize("dim", [2, 3])
def test_sizes_of_one_point_grow_by_g_times_the_distance_along_its_own_directions(dim):
    mesh, rng = random_mesh(5, 60, dim)
    sizes = np.full((mesh.n_points, dim), np.inf)
    sizes[7] = np.sort(10.0 ** rng.uniform(-3, 0, dim))
    directions = random_rotations(rng, mesh.n_points, dim)
    limited = limit_metric(mesh, Metric(sizes, directions), G)
    distance = np.linalg.norm(mesh.points - mesh.points[7], axis=1)
    assert_allclose(limited.sizes, sizes[7] + G * distance[:, None], rtol=1e-14)
    along = limited.directions.swapaxes(1, 2) @ directions[7]
    assert_allclose(np.abs(along), np.broadcast_to(np.eye(dim), along.shape), atol=1e-14)


def test_two_crossing_layers_share_their_ellipse():
    # At the middle both have the sizes 0.1 + 0.5 g and 1 + 0.5 g, along x and along y.
    grid = ads.CartesianGrid([0.0, 0.0], 0.5, (3, 2))
    sizes = np.full((6, 2), np.inf)
    sizes[0] = sizes[4] = 0.1, 1.0
    directions = np.tile(np.eye(2), (6, 1, 1))
    directions[4] = [[0.0, 1.0], [1.0, 0.0]]
    limited = limit_metric(grid, Metric(sizes, directions), G)
    assert_allclose(limited.sizes[2], 0.25, rtol=1e-14)


@pytest.mark.parametrize(("dim", "decades"), CASES)
def test_equals_the_search_of_all_nodes(dim, decades):
    mesh, metric = everywhere(dim, decades)
    found = limit_metric(mesh, metric, G)
    expected = limited_by_all(mesh.points, metric, G)
    # In space the solver is exact to 1e-6 where a contact of ellipsoids is nearly lost.
    assert largest_ratio(found, expected) < (1e-10 if dim == 2 else 1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_isotropic_metrics_are_limited_as_sizes(dim):
    mesh, rng = random_mesh(29, 300, dim)
    h = np.where(rng.random(mesh.n_points) < 0.5, 10.0 ** rng.uniform(-2, 0, mesh.n_points), np.inf)
    limited = limit_metric(mesh, Metric.isotropic(h, dim), G)
    expected = ads.limit_gradient(mesh, h, G, method=ads.limiting.Exact(face_sources=False))
    assert_allclose(limited.sizes, np.repeat(expected[:, None], dim, axis=1), rtol=1e-13)


def test_grids_and_octrees_are_limited_at_their_nodes():
    grid = ads.CartesianGrid([0.0, 0.0], 0.25, (5, 5))
    metric = curved_layer(grid.points)
    expected = limited_by_all(grid.points, metric, G)
    assert largest_ratio(limit_metric(grid, metric, G), expected) < 1e-10
    octree = ads.Octree.build(
        [0.0, 0.0], [1.0, 1.0], lambda centres, sizes: centres[:, 0] < 0.5, max_level=3
    )
    metric = curved_layer(octree.points)
    expected = limited_by_all(octree.points, metric, G)
    assert largest_ratio(limit_metric(octree, metric, G), expected) < 1e-10


def test_scaling_of_mesh_and_metric_scales_the_result():
    mesh, metric = everywhere(2, 1.0)
    for factor in (1e-30, 1e30):
        scaled = ads.SimplexMesh(factor * mesh.points, mesh.cells)
        limited = limit_metric(scaled, metric.scaled(factor), G)
        expected = limit_metric(mesh, metric, G)
        assert_allclose(limited.sizes, factor * expected.sizes, rtol=1e-9)


def test_limiting_twice_changes_nothing_where_all_axes_agree():
    mesh, rng = random_mesh(41, 80, 2)
    q = random_rotations(rng, 1, 2)[0]
    sizes = 10.0 ** rng.uniform(-2, 0, (mesh.n_points, 2))
    metric = Metric(sizes, np.broadcast_to(q, (mesh.n_points, 2, 2)))
    once = limit_metric(mesh, metric, G)
    assert largest_ratio(limit_metric(mesh, once, G), once) < 1e-12


def test_threads_do_not_change_the_result():
    mesh, _ = random_mesh(47, 20_000, 2)
    metric = curved_layer(mesh.points)
    one = limit_metric(mesh, metric, G, threads=1)
    two = limit_metric(mesh, metric, G, threads=3)
    assert_array_equal(one.sizes, two.sizes)
    assert_array_equal(one.directions, two.directions)


def test_inactive_nodes_of_a_grid_have_no_bound_and_no_effect():
    active = np.ones((4, 4), bool)
    active[3, 3] = False
    grid = ads.CartesianGrid([0.0, 0.0], 0.25, (4, 4), active=active)
    h = np.where(active, 1.0, 0.01).ravel()
    limited = limit_metric(grid, Metric.isotropic(h, 2), G)
    assert_array_equal(limited.sizes[:-1], 1.0)
    assert np.isinf(limited.sizes[-1]).all()
