"""Sizes from points, curves, boundaries, boxes, balls, regions and functions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, random_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
    SimplexMesh,
    size_from_sources,
)
from adaptsize.sizes.touched import _have_edge_in_box

SQUARE = SimplexMesh(
    [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0]],
    [[0, 1, 2], [0, 2, 3], [1, 4, 2]],
    cell_tags=[1, 1, 5],
    tagged_facets=[[0, 3], [4, 1], [2, 1]],
    facet_tags=[7, 8, 9],
)
INF = np.inf


def test_point_inside_a_cell_shows_at_its_nodes():
    # (0.6, 0.3) lies in the triangle of the nodes 0, 1, 2.
    h0 = size_from_sources(SQUARE, PointSource([0.6, 0.3], 0.01), g=0.5)
    expected = [0.01 + 0.5 * np.hypot(0.6, 0.3), 0.01 + 0.5 * 0.5, 0.01 + 0.5 * np.hypot(0.4, 0.7)]
    assert_allclose(h0, [*expected, INF, INF], rtol=1e-14)


def test_point_between_cells_shows_at_the_nodes_of_all_of_them():
    # On the diagonal of the square, and at a corner that three triangles have.
    h0 = size_from_sources(SQUARE, PointSource([0.5, 0.5], 0.01), g=0.5)
    assert_allclose(h0, [*np.full(4, 0.01 + 0.5 * np.sqrt(0.5)), INF], rtol=1e-14)
    h0 = size_from_sources(SQUARE, PointSource([1.0, 1.0], 0.01), g=0.5)
    assert_allclose(h0, 0.01 + 0.5 * np.array([np.sqrt(2.0), 1.0, 0.0, 1.0, np.sqrt(2.0)]))


def test_point_outside_counts_its_distance():
    # 3 to the left of the square: the closest cell is that of the nodes 0, 2, 3.
    with pytest.warns(UserWarning, match="lies 3 outside the domain"):
        h0 = size_from_sources(SQUARE, PointSource([-3.0, 0.5], 1.0), g=0.2)
    far, near = 1.0 + 0.2 * np.hypot(4.0, 0.5), 1.0 + 0.2 * np.hypot(3.0, 0.5)
    assert_allclose(h0, [near, INF, far, near, INF], rtol=1e-14)


def test_curve_between_the_nodes_shows_at_all_cells_it_passes():
    # Squares of side 1 with nodes at whole coordinates; the line y = 0.5 passes one row.
    mesh = structured_square(10, half_width=5.0)
    h0 = size_from_sources(mesh, CurveSource([[-5.0, 0.5], [5.0, 0.5]], 0.1), g=0.25)
    on_row = (mesh.points[:, 1] == 0.0) | (mesh.points[:, 1] == 1.0)
    assert_allclose(h0[on_row], 0.1 + 0.25 * 0.5, rtol=1e-12)
    assert np.isinf(h0[~on_row]).all()


def test_curve_along_edges_gives_its_size_exactly():
    mesh = structured_square(10, half_width=5.0)
    h0 = size_from_sources(mesh, CurveSource([[-5.0, 1.0], [5.0, 1.0]], [0.1, 0.3]))
    on_line = mesh.points[:, 1] == 1.0
    expected = 0.1 + 0.2 * (mesh.points[on_line, 0] + 5.0) / 10.0
    # The slope of the size is 0.02 < g, so that no other point of the curve asks for less.
    assert_allclose(h0[on_line], expected, rtol=1e-12)


def test_tagged_boundaries():
    assert_array_equal(size_from_sources(SQUARE, BoundarySource(0.1, 7)), [0.1, INF, INF, 0.1, INF])
    two = size_from_sources(SQUARE, BoundarySource(0.1, tags=[7, 8]))
    assert_array_equal(two, [0.1, 0.1, INF, 0.1, 0.1])
    inside = structured_square(2, half_width=1.0)
    expected = np.where(np.abs(inside.points).max(axis=1) == 1.0, 0.5, INF)
    assert_array_equal(size_from_sources(inside, BoundarySource(0.5)), expected)


@pytest.mark.parametrize("small", [BoxSource([0.6, 0.3], [0.62, 0.32], 0.01),
                                   BallSource([0.61, 0.31], 0.01, 0.01)])  # fmt: skip
def test_boxes_and_balls_inside_a_cell_show_at_its_nodes(small):
    h0 = size_from_sources(SQUARE, small, g=0.5)
    assert np.isinf(h0[3:]).all()
    # Nodes 0, 1 and 2 are 0.684, 0.498 and 0.793 from its centre, 0.01 to 0.0142 less from it.
    assert_allclose(h0[:3], 0.01 + 0.5 * np.array([0.672, 0.486, 0.781]), atol=0.002)


def test_thin_box_through_tetrahedra_is_not_lost():
    # A rod thinner than any edge: every cell along it is found by its long edges.
    mesh = jittered_cube(6, 13, half_width=5.0)
    rod = BoxSource([-6.0, 0.3, 0.4], [6.0, 0.301, 0.401], 0.05)
    h0 = size_from_sources(mesh, rod, g=0.3)
    line = np.column_stack([np.linspace(-4.9, 4.9, 50), np.full(50, 0.3005), np.full(50, 0.4005)])
    cells = mesh.locator.nearest(line)[0]
    assert np.isfinite(h0[mesh.cells[cells]]).all()


def test_functions_and_mixtures_take_the_smallest():
    sources = [lambda x: 0.1 + x[:, 0], RegionSource(5, 0.5), lambda x: np.full(len(x), np.inf)]
    assert_allclose(size_from_sources(SQUARE, sources), [0.1, 0.5, 0.5, 0.1, 0.5])
    assert_allclose(size_from_sources(SQUARE, sources[0]), 0.1 + SQUARE.points[:, 0])
    assert np.isinf(size_from_sources(SQUARE, [])).all()


def test_surfaces_in_space_carry_sources_too():
    sphere = random_sphere(200, 7)
    h0 = size_from_sources(sphere, PointSource([0.0, 0.0, 1.0], 0.01), g=0.2)
    touched = np.isfinite(h0)
    assert touched.sum() == 3
    distance = np.linalg.norm(sphere.points[touched] - [0.0, 0.0, 1.0], axis=1)
    assert_allclose(h0[touched], 0.01 + 0.2 * distance)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.25, 1.0]))
def test_never_below_what_a_source_asks_for_and_never_lost(seed, g):
    mesh = random_square(30, seed)
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (3, 2))
    size = rng.uniform(0.01, 0.1, 3)
    distance = np.linalg.norm(mesh.points[:, None] - points, axis=2)
    cones = (size + g * distance).min(axis=1)
    h0 = size_from_sources(mesh, PointSource(points, size), g=g)
    assert (h0 >= cones * (1.0 - 1e-14)).all()
    nodes = mesh.cells[mesh.locator.nearest(points)[0]]
    own = size[:, None] + g * distance[nodes, np.arange(3)[:, None]]
    assert (h0[nodes] <= own * (1.0 + 1e-14)).all()
    curve = size_from_sources(mesh, CurveSource(points, 0.05), g=g)
    assert (curve >= 0.05).all()
    assert np.isfinite(curve[nodes]).all()


def test_bad_arguments_are_named():
    cases = [
        (RegionSource(3, 0.1), "sources: tags must be among the cell_tags 1, 5, got 3"),
        (BoundarySource(0.1, [7, 4]), "sources: tags must be among the facet_tags 7, 8, 9, got 4"),
        (PointSource([[0.5, 0.5]], [0.1, 0.2]), r"size must have shape \(1,\)"),
        (CurveSource([[0.5, 0.5]], 0.1), "curve must have at least 2 points"),
        (CurveSource(SQUARE, 0.1), "curve must consist of segments in 2-D"),
        (BoxSource([1, 1], [0, 2], 0.1), "lower must be at most upper"),
        (lambda x: -x[:, 0] - 1.0, r"sources\[0\]\(points\) must be positive"),
    ]
    for source, message in cases:
        with pytest.raises(ValueError, match=message):
            size_from_sources(SQUARE, source)
    with pytest.raises(ValueError, match="g must be"):
        size_from_sources(SQUARE, [], g=-0.1)
    untagged = SimplexMesh(SQUARE.points, SQUARE.cells)
    with pytest.raises(ValueError, match="tags must be region tags of the mesh, which has none"):
        size_from_sources(untagged, RegionSource(1, 0.1))


def test_the_text_of_a_source_does_not_list_its_points():
    assert repr(PointSource([0.0, 1.0], 0.1)) == "PointSource(points=[0.0, 1.0], size=0.1)"
    many = np.random.default_rng(3).random((500, 2))
    shown = "<array of shape (500, 2)>"
    assert repr(PointSource(many, 0.1)) == f"PointSource(points={shown}, size=0.1)"
    assert repr(CurveSource(many.tolist(), 0.1)) == f"CurveSource(curve={shown}, size=0.1)"


def test_sizes_scale_with_the_mesh():
    scale = 3e6
    big = SimplexMesh(scale * SQUARE.points, SQUARE.cells)

    def sources(s):
        return [
            PointSource([0.6 * s, 0.3 * s], 0.01 * s),
            CurveSource(np.array([[0.1, 0.2], [1.5, 0.2]]) * s, 0.1 * s),
            BoxSource([1.5 * s, -s], [3.0 * s, 0.25 * s], 0.05 * s),
            BallSource([0.2 * s, 0.9 * s], 0.05 * s, 0.02 * s),
        ]

    small = size_from_sources(SQUARE, sources(1.0))
    assert_allclose(size_from_sources(big, sources(scale)), scale * small, rtol=1e-9)


def test_the_boundary_of_a_closed_surface_or_curve_is_all_of_it():
    sphere = random_sphere(60, 5)
    assert_array_equal(size_from_sources(sphere, BoundarySource(0.2)), 0.2)
    opened = SimplexMesh(sphere.points, sphere.cells[1:])
    at_rim = np.isin(np.arange(sphere.n_points), sphere.cells[0])
    expected = np.where(at_rim, 0.2, INF)
    assert_array_equal(size_from_sources(opened, BoundarySource(0.2)), expected)
    loop = SimplexMesh(SQUARE.points, [[0, 1], [1, 2], [2, 0]])  # nodes 3 and 4 are not in it
    assert_array_equal(size_from_sources(loop, BoundarySource(0.2)), [0.2, 0.2, 0.2, INF, INF])


@pytest.mark.parametrize("dim", [2, 3])
def test_edges_that_pass_a_box_are_those_that_have_points_in_it(dim):
    rng = np.random.default_rng(81_337 + dim)
    points = rng.uniform(-1.0, 1.0, (200 * (dim + 1), dim))
    mesh = SimplexMesh(points, np.arange(len(points)).reshape(-1, dim + 1))
    lower, upper = np.array([-0.1, -0.2, -0.3])[:dim], np.array([0.2, 0.1, 0.4])[:dim]
    share = np.linspace(0.0, 1.0, 400)[:, None]
    has_points = np.zeros(mesh.n_cells, bool)
    for v in range(dim + 1):
        for w in range(v):
            a, b = points[mesh.cells[:, v], None], points[mesh.cells[:, w], None]
            on_edge = a + share * (b - a)
            has_points |= ((on_edge >= lower) & (on_edge <= upper)).all(axis=2).any(axis=1)
    found = _have_edge_in_box(mesh, lower, upper)
    assert 20 < np.count_nonzero(has_points) < 180
    assert found[has_points].all()
    # Edges that cut a corner between two of the points.
    assert np.count_nonzero(found & ~has_points) <= 2


@pytest.mark.parametrize("place", [np.zeros((1, 2)), [[0.0, 0.0]]])
def test_a_source_stays_where_it_was_made(place):
    source = PointSource(place, 0.1)
    place[0][0] = 1.0
    assert source.rows(2)[0].tolist() == [[0.0, 0.0]]
