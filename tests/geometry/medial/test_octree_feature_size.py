"""The feature size on octrees, on shapes that are known."""

import numpy as np
import planar_shapes as planar
import pytest
from octrees_around import TURN, around, moved, to
from solids import box, circle, outline, wedge_plate

from adaptsize import (
    Octree,
    SimplexMesh,
    feature_size,
    medial_axis,
    refine_at_boundary,
    signed_distance,
    size_from_feature,
)
from adaptsize.geometry.medial.on_meshes import edge_lengths


def inside_and(tree, boundary):
    return signed_distance(tree, boundary) <= 0.0


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
@pytest.mark.parametrize("thickness", [0.02, 0.05, 0.11])
def test_a_plate_thinner_than_the_leaves_is_seen(turn, thickness):
    boundary = moved(box(1.6, 1.2, thickness), turn, (-0.8, -0.6, -0.5 * thickness))
    tree = around(to(boundary), 0.1, 3)
    size = feature_size(tree, boundary)
    x, y, z = np.abs(tree.points @ turn).T
    # Next to the plate: corners of leaves that it passes.
    step = float(tree.leaf_sizes.min())
    beside = (x < 0.6) & (y < 0.4) & (z < 0.5 * thickness + 0.5 * step)
    assert beside.sum() > 50
    np.testing.assert_allclose(size[beside], 0.5 * thickness, rtol=0.02)


def test_nodes_and_middles_of_edges_may_be_on_the_boundary():
    strip = outline([(-1.0, 1.0), (5.0, 1.0), (5.0, 1.5), (-1.0, 1.5)])
    for level in range(4):  # leaves of 2, with the wall half way between nodes, to .25
        tree = Octree([-2.0, -2.0], [6.0, 6.0], (4, 4), [level] * (16 * 4**level))
        size = feature_size(tree, strip, crease_angle=180.0)
        x, y = tree.points.T
        across = (x >= 0.0) & (x <= 4.0) & (y > 1.0 - 2.0**-level) & (y < 1.5 + 2.0**-level)
        assert across.any()
        np.testing.assert_allclose(size[across], 0.25, rtol=1e-9)


def test_plates_on_both_sides_of_a_gap_do_not_see_each_other():
    # Widths of .1 and .8, less than two leaves apart, so that nodes in the gap belong to leaves of
    # both; straight across the gap the thin one is near.
    thin, thick = box(1.6, 1.6, 0.1), box(1.6, 1.6, 0.8)
    parts = [thin.points + np.array([0.0, 0.0, -0.17]), thick.points]
    both = SimplexMesh(np.concatenate(parts), np.concatenate([thin.cells, thick.cells + 8]))
    boundary = moved(both, TURN, (-0.8, -0.8, -0.4))
    tree = around(to(boundary), 0.08, 3)
    size = feature_size(tree, boundary)
    x, y, z = (tree.points @ TURN).T
    middle = (np.abs(x) < 0.4) & (np.abs(y) < 0.4)
    in_thick = middle & (np.abs(z) <= 0.4)
    in_thin = middle & (z > -0.57) & (z < -0.47)
    assert in_thin.sum() > 20
    np.testing.assert_allclose(size[in_thin], 0.05, rtol=0.02)
    assert size[in_thick].min() > 0.9 * 0.4


def test_a_gap_narrower_than_the_leaves_is_no_part_of_the_domain():
    # Edges lead across it from inside to inside, and the boundary is inward from both of its ends.
    left = np.array([(-1.02, -0.3), (-0.02, -0.3), (-0.02, 0.3), (-1.02, 0.3)])
    boundary = outline(left, left + np.array([1.04, 0.0]))
    tree = around(to(boundary), 0.2)
    found = medial_axis(tree, boundary)
    assert len(found.points) > 4
    np.testing.assert_allclose(found.points[:, 1], 0.0, atol=0.01)
    assert np.abs(found.points[:, 0]).min() > 0.31


def test_edges_that_leave_the_domain_on_their_way_find_no_axis_where_they_do():
    # Two walls of .1 a gap of .1 apart, and nodes near their outer sides: at .02 and .28.
    wall = np.array([(0.0, -2.0), (0.1, -2.0), (0.1, 2.0), (0.0, 2.0)])
    boundary = outline(wall, wall + np.array([0.2, 0.0]))
    tree = Octree([-0.5, -0.52], [0.54, 0.52], (4, 4), [0] * 16)
    x = medial_axis(tree, boundary).points[:, 0]
    assert len(x) > 0
    np.testing.assert_allclose(np.abs(x - 0.15), 0.1, atol=1e-9)


def test_reentrant_edges_that_meet_form_a_corner_as_well():
    # A rib on a plate: below the corners of its foot two reentrant edges are equally near.
    square = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)])
    foot = 0.3 + 0.4 * square
    points = [np.column_stack([ring, np.full(4, z)])
              for ring, z in ((square, 0.0), (square, 0.4), (foot, 0.4), (foot, 0.9))]  # fmt: skip
    rings = [[a + i, a + (i + 1) % 4, b + (i + 1) % 4, b + i]
             for a, b in ((0, 4), (4, 8), (8, 12)) for i in range(4)]  # fmt: skip
    quads = np.array([*rings, [3, 2, 1, 0], [12, 13, 14, 15]])
    cells = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    boundary = moved(SimplexMesh(np.concatenate(points), cells), TURN, (-0.5, -0.5, -0.4))
    tree = around(to(boundary), 0.05, 3, 0.8)
    size = feature_size(tree, boundary)
    assert size.min() > 0.19
    assert size[inside_and(tree, boundary)].max() < 0.8


def test_it_follows_a_width_that_varies():
    # Floor and roof that differ by an angle w: the sum of the distances from the nearer one and
    # from the plane half way between them.
    plate = wedge_plate(10.0, 6.0, 0.2, 2.0)
    tree = Octree.build(
        [-0.31, -0.27, -0.33], [10.4, 6.3, 2.6], refine_at_boundary(to(plate), 0.35), max_level=9
    )
    size = feature_size(tree, plate)
    x, y, z = tree.points.T
    inside = (z > 0.0) & (z < 0.2 + 0.18 * x) & (x > 2.0) & (x < 8.0) & (y > 1.5) & (y < 4.5)
    angle = np.arctan(0.18)
    roof = (0.2 + 0.18 * x - z) * np.cos(angle)
    half = np.abs((z - np.tan(0.5 * angle) * (x + 0.2 / 0.18)) * np.cos(0.5 * angle))
    exact = np.minimum(z, roof) + half
    assert inside.sum() > 300
    np.testing.assert_allclose(size[inside], exact[inside], rtol=0.1)


def test_in_a_cube_its_centre_counts_wherever_the_nodes_are():
    boundary = moved(box(1.0, 1.0, 1.0), TURN, -0.5)
    tree = around(to(boundary), 0.1, 3, 0.9)
    size = feature_size(tree, boundary)
    inside = inside_and(tree, boundary)
    exact = 0.5 - np.abs(tree.points @ TURN).max(axis=1) + np.linalg.norm(tree.points, axis=1)
    assert np.isfinite(size[inside]).all()
    np.testing.assert_allclose(size[inside], exact[inside], rtol=0.06)


def test_it_is_near_that_of_grids_and_near_spheres():
    shape = planar.annulus(0.5, 1.0)
    boundary = outline(circle(200), circle(200, 0.5)[::-1])
    tree = around(shape, 0.05)
    inside = inside_and(tree, boundary)
    on_tree = feature_size(tree, boundary)[inside]
    grid, phi = planar.sampled(shape, 0.05)
    np.testing.assert_allclose(on_tree, 0.25, rtol=0.07)
    np.testing.assert_allclose(feature_size(grid, phi)[phi < 0.0], 0.25, rtol=0.05)
    spheres = 2.0 * size_from_feature(tree, boundary)[inside]
    np.testing.assert_allclose(on_tree, spheres, rtol=0.07)


def test_it_is_at_most_an_edge_between_corners():
    boundary = outline(circle(8))  # edges of .765, a circle of .924 in it
    tree = around(to(boundary), 0.1)
    inside = inside_and(tree, boundary)
    edge = 2.0 * np.sin(np.pi / 8.0)
    with_edges = feature_size(tree, boundary)
    phi = np.abs(signed_distance(tree, boundary))
    assert np.all(with_edges[inside] <= edge + phi[inside] + 1e-12)
    on_it = inside & (phi < 0.02)
    np.testing.assert_allclose(with_edges[on_it], edge, atol=0.02)
    assert feature_size(tree, boundary, crease_angle=180.0)[inside].min() > 0.9
    # Corners of 45 degrees only from a crease angle below that.
    assert feature_size(tree, boundary, crease_angle=50.0)[inside].min() > 0.9


def test_edges_go_from_corner_to_corner():
    # A square with one side of three segments, and a circle without corners.
    corners = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 3), (0, 3)]
    line = outline(corners, 0.5 * circle(40)[::-1] + [1.5, 1.5])
    np.testing.assert_allclose(edge_lengths(line, 40.0)[:6], 3.0)
    assert np.isinf(edge_lengths(line, 40.0)[6:]).all()
    # An open line ends in corners.
    np.testing.assert_allclose(edge_lengths(SimplexMesh([[0, 0], [1, 0], [2, 0]],
                                                        [[0, 1], [1, 2]]), 40.0), 2.0)  # fmt: skip
