"""Cartesian grids: what they hold, how they refuse, their simplices, sizes between nodes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SizeFunction
from adaptsize.background import Image
from adaptsize.errors import OutsideError

INF = np.inf
SHAPES = [(7,), (5, 4), (4, 5, 3)]


def random_grid(shape, seed, *, share_active=1.0):
    rng = np.random.default_rng(seed)
    dim = len(shape)
    active = rng.random(shape) < share_active if share_active < 1.0 else None
    return CartesianGrid(rng.normal(size=dim), rng.uniform(0.1, 2.0, dim), shape, active=active)


def hat_functions(grid, points):
    """Weight of each node at each point of the box, float64[n, n_points]: products of hats."""
    along = (points - grid.lower) / grid.spacing
    index = np.indices(grid.shape).reshape(grid.dim, -1).T
    return np.maximum(1.0 - np.abs(along[:, None] - index), 0.0).prod(axis=2)


# --- what a grid is ----------------------------------------------------------------


def test_bad_arguments_are_named():
    ones = np.ones((2, 2), bool)
    cases = [
        (
            ([0, 0], 0.0, (2, 2)),
            {},
            r"spacing must be from 1e-60 to 1e\+60, got spacing\[0\] = 0",
        ),
        (([0, 0], [1, 1, 1], (2, 2)), {}, r"spacing must be a number or have shape \(2,\)"),
        (([0, 1e17], 1.0, (2, 2)), {}, r"spacing must be well above the rounding .*spacing\[1\]"),
        (([0], 1e60, (9,)), {}, "grid must have coordinates of 1e-60 to"),
        (([9e59], 1e58, (20,)), {}, "grid must have coordinates of 1e-60 to"),  # the last node
        (([0, 0], 1.0, (2, 1)), {}, r"shape must be at least 2, got shape\[1\] = 1"),
        (([0] * 4, 1.0, (2,) * 4), {}, "shape must be 1, 2 or 3 integers"),
        (([0, 0], 1.0, (2**16, 2**15)), {}, "shape must give at most 2147483647 nodes"),
        (([0, 0, 0], 1.0, (2**40,) * 3), {}, "shape must give at most 2147483647 nodes"),
        (([0, 0], 1.0, (2, 3)), {"active": ones}, r"active must be booleans of shape \(2, 3\)"),
        (([0, 0], 1.0, (2, 2)), {"active": ones * 1}, "active must be booleans .*got int64"),
        (([0, 0], 1.0, (2, 2)), {"active": ~ones}, "active must mark at least one node"),
    ]
    for arguments, keywords, message in cases:
        with pytest.raises(ValueError, match=message):
            CartesianGrid(*arguments, **keywords)


# --- around points ------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(0.0, 3.0))
def test_grid_around_points_covers_them_and_no_more_than_a_spacing(seed, dim, margin):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(1, 5), dim)) * 10.0
    spacing = rng.uniform(0.2, 5.0, dim)
    grid = CartesianGrid.around(points, spacing, margin=margin)
    below = points.min(axis=0) - margin - grid.lower
    above = grid.upper - points.max(axis=0) - margin
    assert_allclose(below, above, atol=1e-12)
    assert (below > -1e-8 * spacing).all()
    assert (below <= 0.5 * spacing * (1.0 + 1e-9)).all()
    assert_array_equal(grid.spacing, spacing)


# --- simplices -----------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
def test_mesh_of_a_grid_fills_it_and_fits_together(shape):
    grid = random_grid(shape, 79)
    mesh = grid.mesh
    per_box = {1: 1, 2: 2, 3: 6}[grid.dim]
    assert mesh.n_cells == per_box * grid.n_cells
    assert_array_equal(mesh.points, grid.points)
    box = grid.spacing.prod()
    assert_allclose(mesh.signed_measures, box / per_box, rtol=1e-12)
    assert mesh.facet_cell_counts.max() == 2
    # Facets of one cell only lie on the faces of the box.
    outer = mesh.points[mesh.facets[mesh.facet_cell_counts == 1]]
    on_face = np.isclose(outer, grid.lower) | np.isclose(outer, grid.upper)
    assert on_face.all(axis=1).any(axis=1).all()


def test_mesh_of_active_nodes_has_whole_boxes_only():
    active = np.ones((3, 3, 3), bool)
    active[0, 0, 0] = False
    mesh = CartesianGrid([0, 0, 0], 1.0, (3, 3, 3), active=active).mesh
    assert (mesh.n_points, mesh.n_cells) == (27, 6 * 7)
    assert 0 not in mesh.cells
    assert_allclose(mesh.measures.sum(), 7.0)
    alone = np.zeros((2, 2), bool)
    alone[0, 0] = True
    with pytest.raises(ValueError, match="active must leave at least one box"):
        _ = CartesianGrid([0, 0], 1.0, (2, 2), active=alone).mesh


# --- between the nodes ---------------------------------------------------------------


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_interpolation_is_the_sum_of_products_of_hats(shape, seed):
    rng = np.random.default_rng(seed)
    grid = random_grid(shape, seed)
    values = rng.uniform(0.1, 1.0, shape)
    points = rng.uniform(grid.lower - 1.0, grid.upper + 1.0, (20, grid.dim))
    inside = np.clip(points, grid.lower, grid.upper)
    expected = hat_functions(grid, inside) @ values.ravel()
    result, distances = grid.locator.interpolate(values, points)
    assert_allclose(result, expected, rtol=1e-12)
    assert_allclose(distances, np.linalg.norm(points - inside, axis=1), atol=1e-12)


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_at_nodes_the_values_are_exact_whatever_the_neighbours(shape, seed):
    grid = random_grid(shape, seed)
    rng = np.random.default_rng(seed)
    values = np.where(rng.random(shape) < 0.5, INF, rng.uniform(0.1, 1.0, shape))
    size = SizeFunction(grid, values)
    assert_array_equal(size(grid.points), values.ravel())
    nudged = grid.points * (1.0 + np.finfo(float).eps)
    finite = np.isfinite(values.ravel())
    assert_allclose(size(nudged)[finite], values.ravel()[finite], rtol=1e-12)


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_nodes_that_are_not_active_do_not_count(shape, seed):
    rng = np.random.default_rng(seed)
    active = rng.random(shape) < 0.6
    active.flat[0] = True
    grid = random_grid(shape, seed).with_active(active)
    values = rng.uniform(0.1, 1.0, shape)
    points = rng.uniform(grid.lower, grid.upper, (20, grid.dim))
    weights = hat_functions(grid, points) * active.ravel()
    total = weights.sum(axis=1)
    expected = np.full(20, INF)
    np.divide(weights @ values.ravel(), total, out=expected, where=total > 0.0)
    result = SizeFunction(grid, values)(points)
    assert_allclose(result, expected, rtol=1e-9)  # total may be small
    # Whatever is written there, it is not seen.
    assert_array_equal(SizeFunction(grid, np.where(active, values, 1e9))(points), result)


# --- size functions -------------------------------------------------------------------


def test_points_outside_are_refused_on_request():
    grid = CartesianGrid([0, 0], 1.0, (2, 2))
    size = SizeFunction(grid, np.ones((2, 2)), outside="error")
    assert_array_equal(size([[1.0, 1.0 + 1e-10]]), [1.0])
    with pytest.raises(OutsideError, match=r"points\[0\] = \(0.5, 3\) at a distance of 2"):
        size([[0.5, 3.0]])


@pytest.mark.parametrize("origin", [[0.0], [0.0, 0.0, 0.0], [0.0, np.nan], [0.0, np.inf]])
def test_an_image_has_a_finite_origin_of_its_dimension(origin):
    with pytest.raises(ValueError, match="origin must be 2 finite numbers"):
        Image(np.zeros((3, 4)), origin=origin)
    assert Image(np.zeros((3, 4)), origin=[1.0, 2.0]).origin.tolist() == [1.0, 2.0]
