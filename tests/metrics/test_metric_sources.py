"""Metrics from second derivatives, from layers and from curvature."""

import numpy as np
import pytest
from metric_oracle import largest_ratio, random_rotations
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.metrics import Metric


def square(n, dim=2):
    rng = np.random.default_rng(61)
    axis = np.linspace(0.0, 1.0, n)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    inner = ((points > 0.0) & (points < 1.0)).all(axis=1)
    points[inner] += rng.uniform(-0.2, 0.2, (inner.sum(), dim)) / n
    return ads.SimplexMesh(points, Delaunay(points).simplices)


def quadratic(points, matrix):
    return 0.5 * np.einsum("ni,ij,nj->n", points, matrix, points)


@pytest.mark.parametrize("dim", [2, 3])
def test_quadratic_fields_give_their_own_axes(dim):
    mesh = square(7, dim)
    q = random_rotations(np.random.default_rng(67), 1, dim)[0]
    curvature = np.array([400.0, -25.0, 4.0])[:dim]
    values = quadratic(mesh.points, q * curvature @ q.T)
    metric = ads.metric_from_hessian(mesh, values, tolerance=0.02, norm=np.inf)
    # h = sqrt(2 eps / |lambda|)
    expected = Metric(
        np.tile([0.01, 0.04, 0.1][:dim], (mesh.n_points, 1)),
        np.broadcast_to(q, (mesh.n_points, dim, dim)),
    )
    assert largest_ratio(metric, expected) < 1e-6


def test_isotropic_derivatives_give_the_sizes_of_size_from_hessian():
    mesh = square(12)
    radius = np.linalg.norm(mesh.points, axis=1)
    hessian = (1.0 + radius)[:, None, None] * np.eye(2)
    for norm in (1.0, 2.0, np.inf):
        metric = ads.metric_from_hessian(mesh, hessian=hessian, tolerance=0.01, norm=norm)
        steepness = 1.0 + radius
        exponent = 0.5 if np.isinf(norm) else norm / (2 * norm + 2)
        share = 1.0
        if not np.isinf(norm):
            integral = (
                mesh.measures * (steepness ** (2 * exponent))[mesh.cells].mean(axis=1)
            ).sum()
            share = integral ** (1 / norm)
        expected = np.sqrt(0.02 / share) * steepness**-exponent
        assert_allclose(metric.sizes, np.repeat(expected[:, None], 2, axis=1), rtol=1e-12)


@pytest.mark.parametrize("norm", [1.0, 2.0, 4.0, np.inf])
def test_the_target_number_of_elements_is_met_after_the_limits(norm):
    mesh = square(20)
    values = np.tanh(20.0 * (mesh.points[:, 0] - 0.5))
    metric = ads.metric_from_hessian(
        mesh, values, elements=3000, norm=norm, hmin=0.005, hmax=0.3, max_aspect=20.0
    )
    assert_allclose(metric.predicted_elements(mesh), 3000, rtol=1e-3)
    assert metric.sizes.min() >= 0.005
    assert metric.sizes.max() <= 0.3
    assert metric.aspect_ratio.max() <= 20.0 * (1.0 + 1e-12)


def test_a_surface_has_the_metric_of_its_plane_and_is_round_along_the_normal():
    flat = square(9)
    q = random_rotations(np.random.default_rng(73), 1, 3)[0]
    lifted = ads.SimplexMesh(flat.points @ q[:, :2].T, flat.cells)
    matrix = np.array([[90.0, 30.0], [30.0, 20.0]])
    values = quadratic(flat.points, matrix)
    options = {"tolerance": 0.01, "norm": 2.0}
    in_plane = ads.metric_from_hessian(flat, values, **options)
    on_surface = ads.metric_from_hessian(lifted, values, **options)
    assert_allclose(on_surface.sizes[:, :2], in_plane.sizes, rtol=1e-8)
    assert_allclose(on_surface.sizes[:, 2], in_plane.sizes[:, 1], rtol=1e-8)
    for u in ([1.0, 0.0], [0.0, 1.0], [0.6, 0.8]):
        assert_allclose(on_surface.size_along(q[:, :2] @ u), in_plane.size_along(u), rtol=1e-7)
    full = q[:, :2] @ matrix @ q[:, :2].T
    given = ads.metric_from_hessian(lifted, hessian=np.tile(full, (81, 1, 1)), **options)
    assert largest_ratio(given, on_surface) < 1e-6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "one of values and hessian must be given, got none"),
        ({"values": np.zeros(25), "hessian": np.zeros((25, 2, 2))}, "got both"),
        ({"values": np.zeros(25), "elements": 5}, "got both"),
        ({"hessian": np.tile([[0, 1], [0, 0]], (25, 1, 1))}, r"symmetric, got hessian\[0\]"),
    ],
)
def test_bad_arguments_of_the_hessian_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ads.metric_from_hessian(square(5), **{"tolerance": 1.0, **arguments})


def test_layers_grow_geometrically_from_the_first_height():
    # The tops of layers of heights h, h r, h r^2 ... are where the size is the next height.
    heights = 0.001 * 1.2 ** np.arange(20)
    tops = np.concatenate([[0.0], np.cumsum(heights)])[:20]
    normals = np.tile([0.6, 0.8], (20, 1))
    metric = ads.metric_from_layers(tops, normals, first_height=0.001, tangential=10.0)
    assert_allclose(metric.size_along([0.6, 0.8]), heights, rtol=1e-12)
    assert_allclose(metric.size_along([-0.8, 0.6]), np.minimum(10.0, 1000 * heights), rtol=1e-12)


def test_layers_end_where_they_are_as_high_as_long():
    metric = ads.metric_from_layers(
        [0.0, -3.0, np.inf, 0.0], [[0, 0, 2], [0, 0, -1], [0, 0, 1], [0, 0, 0]],
        first_height=0.01, growth=1.5, tangential=0.7, max_aspect=5.0,
    )  # fmt: skip
    expected = [[0.01, 0.05, 0.05], [0.7, 0.7, 0.7], [0.7, 0.7, 0.7], [0.01, 0.01, 0.01]]
    assert_allclose(metric.sizes, expected, rtol=1e-14)
    assert_allclose(metric.size_along([0.0, 0.0, 1.0])[0], 0.01)


@pytest.mark.parametrize("k", [0.25, 1.0])
def test_the_last_layer_is_bounded_by_the_size_along_the_wall(k):
    d = np.linspace(0.0, 5.0, 50)
    along = np.linspace(0.2, 0.8, 50)
    normals = np.tile([0.6, 0.8], (50, 1))
    metric = ads.metric_from_layers(
        d, normals, first_height=0.01, tangential=along, last_over_tangential=k
    )
    across = metric.size_along([0.6, 0.8])
    assert_allclose(across, np.minimum(0.01 + 0.2 * d, k * along), rtol=1e-12)
    assert_allclose(metric.size_along([-0.8, 0.6]), along, rtol=1e-12)


@pytest.mark.parametrize("k", [0.0, 1.5, np.nan])
def test_a_bad_bound_of_the_last_layer_is_refused(k):
    with pytest.raises(ValueError, match="last_over_tangential"):
        ads.metric_from_layers([0.0], [[0, 1]], first_height=0.1, last_over_tangential=k)


def tube(n, layers, radius):
    angle, z = np.meshgrid(2 * np.pi * np.arange(n) / n, np.arange(float(layers)))
    x = np.column_stack([radius * np.cos(angle.ravel()), radius * np.sin(angle.ravel()), z.ravel()])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(layers - 1)))
    a, b = n * j + i, n * j + (i + 1) % n
    return ads.SimplexMesh(x, np.vstack([np.c_[a, b, a + n], np.c_[b, b + n, a + n]]))


def test_a_cylinder_needs_short_edges_around_it_only():
    mesh = tube(40, 6, 2.0)
    metric = ads.metric_from_curvature(mesh, elements_per_radian=5.0, max_aspect=30.0)
    inner = (mesh.points[:, 2] > 0.5) & (mesh.points[:, 2] < 4.5)
    x, y, _ = mesh.points.T
    around = np.column_stack([-y, x, 0.0 * x])
    assert_allclose(metric.size_along(around)[inner], 0.4, rtol=1e-9)
    assert_allclose(metric.size_along([0.0, 0.0, 1.0])[inner], 12.0, rtol=1e-9)
    # The open rim is a feature edge, a circle of the same curvature.
    assert_allclose(metric.size_along(around)[~inner], 0.4, rtol=1e-9)


def test_a_sphere_has_the_isotropic_size_of_its_curvature():
    rng = np.random.default_rng(79)
    points = rng.normal(size=(400, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    from scipy.spatial import ConvexHull

    mesh = ads.SimplexMesh(points, ConvexHull(points).simplices)
    metric = ads.metric_from_curvature(mesh, crease_angle=60.0)
    assert_allclose(metric.sizes, 0.25, rtol=0.01)


def test_solids_have_bounds_on_their_boundary_and_plane_meshes_are_isotropic():
    solid = square(4, 3)
    assert np.isinf(ads.metric_from_curvature(solid).sizes).all()  # a cube is flat
    angle = np.arange(16) * np.pi / 8
    points = np.vstack([[0, 0], 2 * np.column_stack([np.cos(angle), np.sin(angle)])])
    disk = ads.SimplexMesh(points, [[0, i, i % 16 + 1] for i in range(1, 17)])
    metric = ads.metric_from_curvature(disk, hmax=1.0)
    assert_allclose(metric.sizes[:, 0], [1.0] + [0.5] * 16)
    assert_allclose(metric.aspect_ratio, 1.0)
