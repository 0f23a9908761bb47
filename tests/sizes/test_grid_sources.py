"""Sources on Cartesian grids: as on meshes, with boxes for cells, and on octrees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from solids import circle, outline

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CartesianGrid,
    CurveSource,
    PointSource,
    RegionSource,
    SimplexMesh,
    size_from_curvature,
    size_from_sources,
)
from adaptsize.background import Octree
from adaptsize.sizes._on_grid import nodes_near

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


def test_curve_with_a_free_end():
    # inf at the right end: the size holds at the left end only.
    grid = CartesianGrid([0.0, 0.0], 1.0, (4, 2))
    h0 = size_from_sources(grid, CurveSource([[0.25, 0.5], [2.5, 0.5]], [0.1, INF]), g=0.2)
    assert_allclose(h0[0], 0.1 + 0.2 * np.hypot(0.25, 0.5), rtol=1e-14)
    assert np.isfinite(h0[:2]).all()
    assert np.isinf(h0[2:]).all()


def test_far_curve_costs_no_more_than_the_grid():
    h0 = size_from_sources(GRID, CurveSource([[-1e12, 3.0], [1e12, 3.0]], 0.1), g=0.25)
    assert_allclose(h0[:, 1:], 0.35, rtol=1e-3)  # 1e12 has four digits after the point


@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.5]))
@settings(deadline=None, max_examples=50)
def test_curve_misses_no_box_and_asks_for_no_less_than_its_cones(shape, seed, g):
    rng = np.random.default_rng(seed)
    grid = random_grid(shape, rng)
    ends = rng.uniform(grid.lower - 0.3, grid.upper + 0.3, (3, grid.dim))
    size = rng.uniform(0.01, 0.2, 3)
    h0 = size_from_sources(grid, CurveSource(ends, size), g=g).ravel()

    share = np.linspace(0.0, 1.0, 400)[:, None]
    samples = np.concatenate([a + share * (b - a) for a, b in (ends[:2], ends[1:])])
    at_samples = np.concatenate([a + share * (b - a) for a, b in (size[:2], size[1:])]).ravel()
    cones = at_samples + g * distances_from(grid.points, samples)
    touched = corners_of_boxes_around(grid, samples)
    assert (h0 <= np.where(touched, cones, INF).min(axis=1) * (1.0 + 1e-12)).all()
    # Between two samples a cone reaches lower by half a step of them at most.
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1).max()
    slack = 0.5 * (g * length + np.abs(np.diff(size)).max()) / 399.0
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


def test_no_simplices_are_made():
    grid = CartesianGrid([0.0, 0.0], 1.0, (4, 3))
    sources = [PointSource([1, 1], 0.1), CurveSource([[0, 0], [2, 2]], 0.1),
               BoxSource([0, 0], [1, 1], 0.1), BallSource([1, 1], 0.5, 0.1), BoundarySource(1.0),
               lambda x: 1.0 + x[:, 0]]  # fmt: skip
    assert np.isfinite(size_from_sources(grid, sources)).all()
    assert "mesh" not in vars(grid)


# --- active nodes ----------------------------------------------------------------------


def test_nodes_that_are_not_active_get_nothing():
    rng = np.random.default_rng(103)
    active = rng.random((6, 7)) < 0.7
    full = CartesianGrid([0.0, 0.0], 1.0, (6, 7))
    grid = full.with_active(active)
    curve = [[0.5, 0.5], [4.5, 5.5]]
    seen = []
    sources = [
        BoxSource([1, 1], [3, 4], 0.2),
        BallSource([3, 3], 1.2, 0.2),
        lambda x: seen.extend(x.tolist()) or np.full(len(x), 0.7),
    ]
    for source in sources:
        h0 = size_from_sources(full, source, g=0.1)
        assert_array_equal(size_from_sources(grid, source, g=0.1), np.where(active, h0, INF))
    assert seen[full.n_points :] == full.points[active.ravel()].tolist()
    for source in (PointSource(curve, 0.1), CurveSource(curve, 0.1), BoundarySource(0.1)):
        assert np.isinf(size_from_sources(grid, source, g=0.1)[~active]).all()


def test_a_point_where_no_node_is_active_acts_on_the_nearest_active_one():
    active = np.zeros((8, 8), bool)
    active[0, :], active[:, 7] = True, True
    grid = CartesianGrid([0.0, 0.0], 1.0, (8, 8), active=active)
    h0 = size_from_sources(grid, PointSource([2.4, 1.3], 0.1), g=0.5)
    expected = np.full((8, 8), INF)
    expected[0, 1] = 0.1 + 0.5 * np.hypot(2.4, 0.3)
    assert_allclose(h0, expected, rtol=1e-14)


# --- refusals; octrees --------------------------------------------------------------------


def test_sources_with_tags_are_refused():
    for source in (RegionSource(1, 0.1), BoundarySource(0.1, tags=[2])):
        with pytest.raises(ValueError, match=r"tags need a SimplexMesh, a grid has none; got Cart"):
            size_from_sources(GRID, source)


def test_an_octree_is_served_by_its_mesh():
    tree = Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 2, 2, 2, 2])
    sources = [
        PointSource([0.6, 0.7], 0.01),
        BallSource([0.2, 0.2], 0.1, 0.1),
        lambda x: x[:, 0] + 1,
    ]
    h0 = size_from_sources(tree, sources)
    assert h0.shape == tree.nodal_shape
    assert_array_equal(h0, size_from_sources(SimplexMesh(tree.points, tree.mesh.cells), sources))


# --- curvature of a boundary beside the nodes -----------------------------------------------


@pytest.mark.parametrize("masked", [False, True])
def test_nodes_near_a_mesh_are_found_by_halving(masked):
    rng = np.random.default_rng(107)
    grid = CartesianGrid([-1.0, -0.7], [0.03, 0.05], (61, 37))
    if masked:
        grid = grid.with_active(rng.random(grid.shape) < 0.5)
    curve = outline(circle(5, 0.6))
    for within in (0.0, 0.02, 0.3):
        near = curve.locator.nearest(grid.points)[2] <= within
        expected = np.argwhere(near.reshape(grid.shape) & (not masked or grid.active))
        found = nodes_near(grid, curve, within)
        assert_array_equal(found[np.lexsort(found.T[::-1])], expected)


def test_curvature_of_a_circle_shows_at_the_boxes_that_it_passes():
    # Radius 2 and 4 elements per radian: 0.5.
    boundary = outline(circle(200, 2.0))
    grid = CartesianGrid.around(boundary.points, 0.2, margin=0.5)
    tree = Octree([-4, -4], [4, 4], (16, 16), np.zeros(256, int))
    for background, spacing in ((grid, 0.2), (tree, 0.5)):
        h0 = size_from_curvature(background, boundary)
        assert h0.shape == background.nodal_shape
        beside = np.abs(np.linalg.norm(background.points, axis=1) - 2.0) < np.sqrt(2.0) * spacing
        assert_allclose(h0.ravel(), np.where(beside, 0.5, INF), rtol=1e-3)
        with pytest.raises(ValueError, match="boundary must be given, as there is none in"):
            size_from_curvature(background)
    away = CartesianGrid([9.0, 9.0], 0.2, (4, 4))
    with pytest.raises(ValueError, match="boundary must pass through nodes of the background"):
        size_from_curvature(away, boundary)
    with pytest.raises(ValueError, match="boundary must consist of segments in 2-D"):
        size_from_curvature(grid, grid.mesh)
