"""Sources on Cartesian grids: as on meshes, with boxes for cells, and on octrees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CartesianGrid,
    CurveSource,
    PointSource,
    RegionSource,
    size_from_sources,
)

INF = np.inf
SHAPES = [(9,), (7, 6), (5, 6, 4)]
GRID = CartesianGrid([0.0, 0.0], [1.0, 2.0], (4, 3))  # 0 to 3, 0 to 4


def random_grid(shape, rng):
    return CartesianGrid(rng.normal(size=len(shape)), rng.uniform(0.2, 0.5, len(shape)), shape)


def distances_from(points, where):
    return np.linalg.norm(points[:, None] - where, axis=2)


def corners_of_boxes_around(grid, points):
    """Whether each node is a corner of a closed box that holds (the clipped) one of points."""
    along = (np.clip(points, grid.lower, grid.upper) - grid.lower) / grid.spacing
    box = np.minimum(np.floor(along), np.array(grid.shape) - 2)
    index = np.indices(grid.shape).reshape(grid.dim, -1).T
    offset = index[:, None] - box
    return ((offset == 0) | (offset == 1)).all(axis=2)


# --- points ---------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:the source at")
@pytest.mark.parametrize("shape", SHAPES)
def test_points_lower_the_corners_of_their_boxes_and_no_other_node(shape):
    rng = np.random.default_rng(101)
    grid = random_grid(shape, rng)
    points = rng.uniform(grid.lower - 0.5, grid.upper + 0.5, (4, grid.dim))
    size = rng.uniform(0.01, 0.1, 4)
    asked = size + 0.3 * distances_from(grid.points, points)
    expected = np.where(corners_of_boxes_around(grid, points), asked, INF).min(axis=1)
    h0 = size_from_sources(grid, PointSource(points, size), g=0.3)
    assert_allclose(h0, expected.reshape(shape), rtol=1e-13)


# --- curves ---------------------------------------------------------------------------


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.5]))
@settings(deadline=None, max_examples=50)
def test_curve_acts_where_it_is_longer_than_between_samples_and_asks_for_no_less_than_its_cones(
    shape, seed, g
):
    rng = np.random.default_rng(seed)
    grid = random_grid(shape, rng)
    ends = rng.uniform(grid.lower - 0.3, grid.upper + 0.3, (2, grid.dim))
    size = rng.uniform(0.01, 0.2, 2)
    h0 = size_from_sources(grid, CurveSource(ends, size), g=g).ravel()

    share = np.linspace(0.0, 1.0, 400)[:, None]
    samples = ends[0] + share * (ends[1] - ends[0])
    at_samples = (size[0] + share * (size[1] - size[0])).ravel()
    cones = at_samples + g * distances_from(grid.points, samples)
    length, between = np.linalg.norm(ends[1] - ends[0]), 0.25 * grid.spacing.min()
    touched = corners_of_boxes_around(grid, samples) & (
        (samples >= grid.lower) & (samples <= grid.upper)
    ).all(axis=1)
    counts = (touched.sum(axis=1) - 1) * length / 399.0 > between
    off = (g + abs(size[1] - size[0]) / length) * between
    nearest = np.where(touched, cones, INF).min(axis=1)
    assert (h0[counts] <= nearest[counts] + off).all()
    # Between two samples a cone reaches lower by half a step of them at most.
    slack = 0.5 * (g * length + abs(size[1] - size[0])) / 399.0
    assert (h0 >= cones.min(axis=1) - slack - 1e-12).all()


# --- boxes, balls, boundary, functions -------------------------------------------------


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=50)
def test_boxes_and_balls_act_on_the_boxes_of_the_grid_that_they_meet(shape, seed):
    rng = np.random.default_rng(seed)
    grid = random_grid(shape, rng)
    x = grid.points
    centre = rng.uniform(grid.lower - 0.3, grid.upper + 0.3)
    half, radius = rng.uniform(0.0, 0.8, grid.dim), rng.uniform(0.0, 0.8)
    # The boxes at a node make one box, cut off at the faces of the grid.
    low, high = np.maximum(x - grid.spacing, grid.lower), np.minimum(x + grid.spacing, grid.upper)

    away = np.linalg.norm(np.maximum(np.abs(x - centre) - half, 0.0), axis=1)
    meets = ((low <= centre + half) & (high >= centre - half)).all(axis=1)
    h0 = size_from_sources(grid, BoxSource(centre - half, centre + half, 0.1), g=0.3)
    assert_allclose(h0.ravel(), np.where(meets, 0.1 + 0.3 * away, INF), rtol=1e-12)

    away = np.maximum(np.linalg.norm(x - centre, axis=1) - radius, 0.0)
    meets = np.linalg.norm(centre - np.clip(centre, low, high), axis=1) <= radius
    h0 = size_from_sources(grid, BallSource(centre, radius, 0.1), g=0.3)
    assert_allclose(h0.ravel(), np.where(meets, 0.1 + 0.3 * away, INF), rtol=1e-12)


def test_boundary_of_a_grid_is_that_of_its_mesh():
    shape = (6, 5, 5)
    active = np.ones(shape, bool)
    active[2, 2, 2] = False
    for grid in (
        CartesianGrid([0] * 3, 1.0, shape),
        CartesianGrid([0] * 3, 1.0, shape, active=active),
    ):
        h0 = size_from_sources(grid, BoundarySource(0.5))
        expected = np.full(grid.n_points, INF)
        expected[grid.mesh.boundary().nodes] = 0.5
        assert_array_equal(h0.ravel(), expected)


# --- refusals; octrees --------------------------------------------------------------------


def test_sources_with_tags_are_refused():
    for source in (RegionSource(1, 0.1), BoundarySource(0.1, tags=[2])):
        with pytest.raises(ValueError, match=r"tags need a SimplexMesh, a grid has none; got Cart"):
            size_from_sources(GRID, source)


# --- curvature of a boundary beside the nodes -----------------------------------------------


def test_nodes_that_are_not_active_get_nothing():
    active = np.random.default_rng(103).random((6, 7)) < 0.7
    full = CartesianGrid([0.0, 0.0], 1.0, (6, 7))
    for source in (BoxSource([1, 1], [3, 4], 0.2), BallSource([3, 3], 1.2, 0.2)):
        h0 = size_from_sources(full, source, g=0.1)
        masked = size_from_sources(full.with_active(active), source, g=0.1)
        assert_array_equal(masked, np.where(active, h0, INF))
