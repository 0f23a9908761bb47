"""Recovered gradients and second derivatives, and the indicator made of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from recovery import MESHES, gradient_errors, root_mean_square, solve_poisson, wave

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize.sizes import recovered_gradient, recovered_hessian, zz_indicator


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("stretch", [1.0, 1e4])
def test_derivatives_of_quadratics_are_exact(dim, stretch):
    mesh = MESHES["jittered" if dim == 2 else "cube"](9)
    scale = np.ones(dim)
    scale[0] = stretch
    x = mesh.points * scale + 7.0
    stretched = SimplexMesh(x, mesh.cells)
    rng = np.random.default_rng(33)
    a = rng.normal(size=(dim, dim))
    a = (a + a.T) / np.outer(scale, scale)
    b = rng.normal(size=dim) / scale
    u = 0.5 * np.einsum("ni,ij,nj->n", x, a, x) + x @ b
    # Values of size 100 and their rounding over the spacing, 0.25, and its square.
    gradient = recovered_gradient(stretched, u)
    assert_allclose(gradient * scale, (x @ a + b) * scale, atol=1e-9)
    hessian = recovered_hessian(stretched, u)
    expected = np.broadcast_to(a, hessian.shape)
    assert_allclose(hessian * np.outer(scale, scale), expected * np.outer(scale, scale), atol=1e-7)
    assert_array_equal(hessian, hessian.swapaxes(1, 2))


@pytest.mark.parametrize(
    ("kind", "counts", "orders"),
    [
        ("jittered", (21, 41, 81), (1.8, 0.9)),
        ("regular", (21, 41, 81), (1.9, 1.4)),
        ("cube", (9, 17), (1.7, 0.9)),
    ],
)
def test_order_of_gradient_and_hessian(kind, counts, orders):
    # Root mean squares over all nodes: inner ones of regular meshes are of second order,
    # but those near the boundary, whose share falls like 1 / n, of first.
    error = np.array(
        [
            (
                root_mean_square(recovered_gradient(mesh, u) - gradient),
                root_mean_square(recovered_hessian(mesh, u) - hessian),
            )
            for mesh in map(MESHES[kind], counts)
            for u, gradient, hessian in [wave(mesh.points)]
        ]
    )
    found = np.log(error[:-1] / error[1:]) / np.log(2.0)
    assert (found > orders).all(), f"errors {error}, orders {found}"
    largest = [np.abs(part).max() for part in wave(MESHES[kind](9).points)[1:]]
    assert (error[-1] < np.multiply(largest, 0.06)).all(), f"errors {error} of {largest}"


@pytest.mark.parametrize("kind", ["jittered", "cube"])
def test_hessian_is_that_of_a_weighted_fit_around_each_node(kind):
    mesh = MESHES[kind](6)
    dim = mesh.dim
    x = mesh.points * np.array([1.0, 30.0, 5.0])[:dim]
    u = np.exp(0.4 * mesh.points.sum(axis=1))
    found = recovered_hessian(SimplexMesh(x, mesh.cells), u)
    near = np.eye(mesh.n_points, dtype=bool)
    near[mesh.edges[:, 0], mesh.edges[:, 1]] = near[mesh.edges[:, 1], mesh.edges[:, 0]] = True
    for node in range(0, mesh.n_points, 5):
        patch = np.flatnonzero((near @ near)[node])
        away = x[patch] - x[node]
        far = np.einsum("ni,ij,nj->n", away, np.linalg.inv(away.T @ away / len(patch)), away)
        root = np.exp(-far / (4.0 * 0.7**2))
        pairs = [(a, b) for a in range(dim) for b in range(a, dim)]
        columns = [np.ones(len(patch)), *away.T, *(away[:, a] * away[:, b] for a, b in pairs)]
        fit = np.linalg.lstsq(np.column_stack(columns) * root[:, None], u[patch] * root, rcond=None)
        for (a, b), c in zip(pairs, fit[0][dim + 1 :], strict=True):
            assert found[node, a, b] == pytest.approx((1 + (a == b)) * c, rel=1e-7, abs=1e-9)


def test_hessian_is_of_second_order_inside_regular_meshes():
    error = []
    for n in (21, 41):
        mesh = MESHES["regular"](n)
        u, _, hessian = wave(mesh.points)
        inside = np.abs(mesh.points).max(axis=1) < 0.7  # three layers in on the coarser one
        error.append(np.abs(recovered_hessian(mesh, u) - hessian)[inside].max())
    assert np.log2(error[0] / error[1]) > 1.9


@pytest.mark.parametrize("kind", ["jittered", "regular"])
def test_zz_indicator_estimates_the_error_of_finite_elements(kind):
    off = []
    for n in (21, 41):
        mesh = MESHES[kind](n)
        u, _, hessian = wave(mesh.points)
        values = solve_poisson(mesh, u, -np.trace(hessian, axis1=1, axis2=2))
        true = gradient_errors(mesh, values, lambda x: wave(x)[1])
        eta = zz_indicator(mesh, values)
        off.append(abs(np.linalg.norm(eta) / np.linalg.norm(true) - 1.0))
        # Cell by cell too, if not in each.
        assert 0.9 < np.median(eta / true) < 1.1
    assert off[1] < 0.03
    assert off[1] < off[0]


def test_hessian_in_a_plate_with_one_layer_of_cells():
    # Nothing is known of u_zz: z^2 is linear at the nodes.
    mesh = CartesianGrid([0.0, 0.0, 0.0], 0.1, (7, 7, 2)).mesh
    x, y, z = mesh.points.T
    assert_allclose(recovered_hessian(mesh, 5.0 * z - x), 0.0, atol=1e-9)
    found = recovered_hessian(mesh, x**2 + 3.0 * x * y + 2.0 * y * z)
    assert_allclose(found[:, :2], [[[2.0, 3.0, 0.0], [3.0, 0.0, 2.0]]] * mesh.n_points, atol=1e-9)


def test_cells_without_volume_and_nodes_in_no_cell():
    points = [[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.5], [9, 9]]
    mesh = SimplexMesh(points, [[0, 1, 2], [1, 3, 2], [1, 4, 2]])
    eta = zz_indicator(mesh, np.arange(6.0) ** 2)
    assert np.isfinite(eta).all()
    assert eta[2] == 0.0
    assert_array_equal(recovered_gradient(mesh, np.arange(6.0))[5], 0.0)


def two_materials(n, ratio):
    """Linear elements for -div(a grad u) = f with a = 1 on the left of x = 0 and ``ratio`` right.

    The solution is sin(x) cos(y) on the left, and over ``ratio`` on the right.
    """
    mesh = MESHES["regular"](n)
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.0
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=1 + right.astype(int))
    x, y = mesh.points.T
    u = np.sin(x) * np.cos(y) / np.where(x > 0.0, ratio, 1.0)
    values = solve_poisson(
        mesh, u, 2.0 * np.sin(x) * np.cos(y), coefficient=np.where(right, ratio, 1.0)
    )

    def exact(p):
        a = np.where(p[:, 0] > 0.0, ratio, 1.0)[:, None]
        x, y = p.T
        return np.column_stack([np.cos(x) * np.cos(y), -np.sin(x) * np.sin(y)]) / a

    return mesh, values, gradient_errors(mesh, values, exact)


@pytest.mark.parametrize("ratio", [100.0, 1000.0])
def test_zz_indicator_is_right_where_the_gradient_jumps_between_regions(ratio):
    for n, most in ((21, 0.02), (41, 0.005)):
        mesh, values, true = two_materials(n, ratio)
        eta = zz_indicator(mesh, values)
        assert abs(np.linalg.norm(eta) / np.linalg.norm(true) - 1.0) < most
    without = zz_indicator(SimplexMesh(mesh.points, mesh.cells), values)
    assert np.linalg.norm(without) > 1.5 * np.linalg.norm(true)  # as if the gradient did not jump


@pytest.mark.parametrize("dim", [2, 3])
def test_nothing_is_recovered_from_functions_that_are_linear_in_each_region(dim):
    mesh = CartesianGrid(np.zeros(dim), 0.25, (9,) * dim).mesh
    interface = np.flatnonzero(mesh.points[:, 0] == 1.0)
    x = mesh.points + np.random.default_rng(9).uniform(-0.03, 0.03, size=mesh.points.shape)
    x[interface, 0] = 1.0
    inside = x[mesh.cells].mean(axis=1)[:, 0] > 1.0
    tagged = SimplexMesh(x, mesh.cells, cell_tags=np.where(inside, 7, 3))
    u = x.sum(axis=1) + 1000.0 * np.maximum(x[:, 0] - 1.0, 0.0)
    assert zz_indicator(tagged, u).max() < 1e-9
    assert_allclose(recovered_hessian(tagged, u), 0.0, atol=1e-7)
    away = x[:, 0] > 1.0
    assert_allclose(recovered_gradient(tagged, u)[away, 0], 1001.0)
    assert_allclose(recovered_gradient(tagged, u)[interface, 0], 501.0)


def test_regions_of_single_cells_take_the_derivatives_of_the_whole_mesh():
    mesh = MESHES["jittered"](9)
    single = SimplexMesh(mesh.points, mesh.cells, cell_tags=np.arange(mesh.n_cells))
    u = wave(mesh.points)[0]
    assert_allclose(zz_indicator(single, u), zz_indicator(mesh, u))
    assert_allclose(recovered_hessian(single, u), recovered_hessian(mesh, u))


def test_zz_indicator_of_several_fields_is_the_root_of_the_sum_of_squares():
    mesh = MESHES["jittered"](9)
    fields = np.random.default_rng(5).normal(size=(mesh.n_points, 3))
    single = [zz_indicator(mesh, field) for field in fields.T]
    assert_allclose(zz_indicator(mesh, fields), np.linalg.norm(single, axis=0))
    for bad in (fields[:-1], fields[:, :0], fields[:, :, None]):
        with pytest.raises(ValueError, match="values must have"):
            zz_indicator(mesh, bad)
