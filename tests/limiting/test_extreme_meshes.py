"""Gradient limiting on meshes and sizes at the edge of what is allowed."""

import re

import domains
import numpy as np
import pytest
from meshes import random_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient
from adaptsize.background.topology import components_of

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
MARCHING = ("fast-marching", "edge-based")
ALL = ("exact", *MARCHING, "positive-coefficient")


def message(expected):
    return pytest.raises(ValueError, match=re.escape(expected))


GRID = CartesianGrid([0.0, 0.0], 1.0, (2, 2))


def test_nodes_of_no_cell_keep_their_bound_and_do_not_act():
    points = np.vstack([SQUARE.points, [[0.5, 0.5], [0.0, 0.0]]])
    mesh = SimplexMesh(points, SQUARE.cells)
    for method in ALL:
        h = limit_gradient(mesh, [0.1, 9.0, 9.0, 9.0, 0.01, np.inf], 0.3, method=method)
        assert h[4:].tolist() == [0.01, np.inf]
        assert_allclose(h[1], 0.4, rtol=1e-15)


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_single_cell_is_a_mesh(dim, method):
    mesh = SimplexMesh(np.vstack([np.zeros(dim), np.eye(dim)]), [range(dim + 1)])
    first = np.arange(dim + 1) == 0
    h = limit_gradient(mesh, np.where(first, 0.1, np.inf), 0.3, method=method)
    assert_allclose(h, np.where(first, 0.1, 0.4), rtol=1e-15)
    h = limit_gradient(mesh, np.where(first, np.inf, 0.2), 0.0, method=method)
    assert h.tolist() == [0.2] * (dim + 1)


@pytest.mark.parametrize("method", ALL)
def test_sizes_pass_through_cells_of_no_volume(method):
    # A chain: a flat triangle on a line, then one with two coinciding corners.
    points = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0], [3.0, 0.0]]
    mesh = SimplexMesh(points, [[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    h = limit_gradient(mesh, [0.5, np.inf, np.inf, np.inf, np.inf], 0.5, method=method)
    assert_allclose(h, [0.5, 1.0, 1.5, 1.5, 2.0], rtol=1e-15)


@pytest.mark.parametrize("exponent", [-59, -20, 20, 59])
@pytest.mark.parametrize("method", ALL)
def test_any_sensible_unit_of_length_gives_the_same_sizes(exponent, method):
    # A power of two scales without rounding; 2^(59 log2(10)) is about 1e59.
    scale = 2.0 ** np.floor(exponent * np.log2(10.0))
    mesh = random_square(60, 95)
    h0 = np.where(np.arange(60) % 9 == 0, 0.05, np.inf)
    h = limit_gradient(mesh, h0, 0.3, method=method)
    scaled = SimplexMesh(scale * mesh.points, mesh.cells)
    assert_allclose(limit_gradient(scaled, scale * h0, 0.3, method=method), scale * h, rtol=1e-13)


@pytest.mark.parametrize("scale", [1e-62, 1e62, 1e200])
def test_lengths_whose_powers_leave_the_range_are_refused(scale):
    with message(f"points must have coordinates of 1e-60 to 1e+60 in size, got {scale:g}"):
        SimplexMesh(scale * SQUARE.points, SQUARE.cells)


@pytest.mark.parametrize("gap", [1e-90, 1e-200, 5e-324])
@pytest.mark.parametrize("method", ["auto", "fast-marching"])
def test_nodes_whose_distance_squares_to_zero_share_their_size(gap, method):
    # Regression: the fourth power of the gap underflowed, and was divided by.
    points = [[0.0, 0.0], [gap, 0.0], [1.0, 0.0], [0.0, 1.0]]
    mesh = SimplexMesh(points, [[0, 1, 2], [0, 1, 3], [1, 2, 3]])
    h = limit_gradient(mesh, [0.1, 0.1, np.inf, np.inf], 0.3, method=method)
    assert_allclose(h, [0.1, 0.1, 0.4, 0.4], rtol=1e-15)
    points = np.column_stack([points, np.zeros(4)])
    points = np.vstack([points, [0.0, 0.0, 1.0]])
    mesh = SimplexMesh(points, [[0, 1, 2, 4], [0, 1, 3, 4]])
    h = limit_gradient(mesh, [0.1, 0.1, np.inf, np.inf, np.inf], 0.3, method=method)
    assert_allclose(h, [0.1, 0.1, 0.4, 0.4, 0.4], rtol=1e-15)


@pytest.mark.parametrize("g", [1e-300, 1e-100, 1e-29, 1e29])
@pytest.mark.parametrize("method", ALL)
def test_extreme_limits_reach_every_node(method, g):
    mesh = random_square(200, 96)
    h0 = np.where(np.arange(200) == 17, 0.1, np.inf)
    h = limit_gradient(mesh, h0, g, method=method)
    i, j = mesh.edges.T
    assert np.isfinite(h).all()
    assert (np.abs(h[i] - h[j]) <= g * mesh.edge_lengths * (1 + 1e-12) + 1e-15).all()
    assert h.max() >= 0.1


@pytest.mark.parametrize(
    "background", [SQUARE, GRID, GRID.with_active([[True, True], [True, False]])]
)
def test_a_number_is_a_bound_for_all_nodes(background):
    expected = limit_gradient(background, np.full(background.nodal_shape, 0.1), 0.3)
    assert_array_equal(limit_gradient(background, 0.1, 0.3), expected)


@pytest.mark.parametrize(
    ("background", "method"),
    [(SQUARE, method) for method in ALL]
    + [(GRID, method) for method in ("exact", "fast-marching", "hamilton-jacobi", "edge-based")],
)
def test_equal_bounds_under_a_limit_of_the_size_leave_no_residual(background, method):
    # Regression: the transformed sizes are all 0, and the residual was divided by the largest.
    h, info = limit_gradient.with_info(background, 0.1, lambda h: 0.2 + h, method=method)
    assert (h == 0.1).all()
    assert info.residual == 0.0


def jagged_spiral():
    """Return triangles of random points in a spiral band, with corners all along."""
    mesh = random_square(600, 10)
    x, y = mesh.points[mesh.cells].mean(axis=1).T
    turns = np.hypot(x, y) / 0.35 - np.arctan2(y, x) / (2.0 * np.pi)
    return SimplexMesh(mesh.points, mesh.cells[turns % 1.0 < 0.75])


@pytest.mark.parametrize("g", [0.0, 1e-300, 1e-25, 1e-18, 1e-15])
@pytest.mark.parametrize("make", [jagged_spiral, lambda: domains.wall_box(400)[0]])
def test_hardly_any_gradient_gives_the_least_bound_behind_corners_too(make, g):
    # Regression: lengths were lost to rounding, and with them the directions in which paths bend,
    # so that nodes behind several corners were not reached.
    mesh = make()
    component = components_of(mesh.edges, mesh.n_points)
    reached = component == np.argmax(np.bincount(component))
    for seed in range(2):
        source = np.random.default_rng(seed).choice(np.flatnonzero(reached))
        h0 = np.where(np.arange(mesh.n_points) == source, 0.1, np.where(reached, np.inf, 0.2))
        h, info = limit_gradient.with_info(mesh, h0, g)
        assert ((h >= 0.1) & (h <= 0.1 + 10.0 * g * mesh.diagonal + 1e-15))[reached].all()
        assert info.n_proved == mesh.n_points
        assert (info.sources.roots()[reached] == source).all()
