"""Inactive nodes of grids, and nodes in no cell of a mesh, say nothing about the domain."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, metric_from_hessian
from adaptsize.background.interpolation import nodes_in_domain
from adaptsize.metrics import Metric, limit_metric
from adaptsize.sizes import size_from_hessian

SQUARE = CartesianGrid([0, 0], 0.125, (9, 9)).mesh


def with_unused_node(mesh, point):
    return SimplexMesh(np.vstack([mesh.points, point]), mesh.cells)


def test_backgrounds_of_all_kinds():
    active = np.array([[True, True], [True, False]])
    grid = CartesianGrid([0, 0], 1.0, (2, 2), active=active)
    assert nodes_in_domain(grid).tolist() == [True, True, True, False]
    assert nodes_in_domain(CartesianGrid([0, 0], 1.0, (2, 2))).all()
    wider = with_unused_node(SQUARE, [3.0, 3.0])
    assert nodes_in_domain(wider).tolist() == [True] * SQUARE.n_points + [False]


@pytest.mark.parametrize("value", [1e-3, np.inf])
def test_sparse_sizes_are_those_of_the_domain(value):
    active = np.ones((3, 3), np.bool_)
    active[2] = False
    grid = CartesianGrid([0, 0], 1.0, (3, 3), active=active)
    size = SizeFunction(grid, np.where(active, 1.0, value))
    assert size.sparse(0.25)([[0.0, 0.0], [1.0, 1.0]]).tolist() == [1.0, 1.0]

    mesh = with_unused_node(SQUARE, [0.5, 0.5])
    values = np.append(np.ones(SQUARE.n_points), value)
    sparse = SizeFunction(mesh, values).sparse(0.25)
    assert sparse([[0.5, 0.5]]).tolist() == [1.0]


def test_a_metric_at_a_node_in_no_cell_limits_no_other():
    rng = np.random.default_rng(20261127)
    for mesh in (SQUARE, CartesianGrid([0, 0, 0], 0.5, (3, 3, 3)).mesh):
        d = mesh.dim
        sizes = rng.uniform(0.1, 1.0, (mesh.n_points, d))
        axes = np.broadcast_to(np.eye(d), (mesh.n_points, d, d))
        alone = limit_metric(mesh, Metric(sizes, axes), 0.3)
        wider = with_unused_node(mesh, np.full(d, 0.5))
        tiny = Metric(np.vstack([sizes, np.full(d, 1e-3)]), np.concatenate([axes, np.eye(d)[None]]))
        limited, info = limit_metric.with_info(wider, tiny, 0.3)
        np.testing.assert_array_equal(limited.sizes[:-1], alone.sizes)
        np.testing.assert_array_equal(limited.sizes[-1], np.full(d, 1e-3))
        assert info.n_sources <= mesh.n_points


def test_a_fill_value_at_a_node_in_no_cell_does_not_hide_derivatives():
    values = SQUARE.points[:, 0] ** 2
    expected = size_from_hessian(SQUARE, values, tolerance=0.01)
    wider = with_unused_node(SQUARE, [2.0, 2.0])
    found = size_from_hessian(wider, np.append(values, 1e30), tolerance=0.01)
    np.testing.assert_array_equal(found[:-1], expected)
    assert np.isinf(found[-1])

    hessian = np.broadcast_to(np.diag([2.0, 1.0]), (SQUARE.n_points, 2, 2))
    all_given = np.concatenate([hessian, 1e30 * np.eye(2)[None]])
    metric = metric_from_hessian(wider, hessian=all_given, tolerance=0.01, norm=np.inf)
    of_domain = metric_from_hessian(SQUARE, hessian=hessian, tolerance=0.01, norm=np.inf)
    np.testing.assert_array_equal(metric.sizes[:-1], of_domain.sizes)
