"""The medial axis on octrees and meshes, on shapes that are known."""

import numpy as np
import planar_shapes as planar
import pytest
from curved_shapes import irregular_torus
from meshes import structured_square
from octrees_around import TURN, around, covered, moved, to
from solids import box, outline

from adaptsize import (
    SimplexMesh,
    medial_axis,
    size_from_feature,
)

# Where points are


@pytest.mark.parametrize("step", [0.2, 0.05])
def test_axis_of_a_rectangle_is_exact_however_large_the_leaves_are(step):
    shape = planar.turned(planar.rectangle(2.0, 1.0), 20.0)
    angle = np.radians(20.0)
    back = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])
    tree = around(shape, step)
    for boundary in (shape, outline(corners @ back.T)):
        found = medial_axis(tree, boundary)
        x, y = np.abs(found.points @ back).T
        # Between the long sides to rounding (differences of functions lose half of it), at
        # the ends of the axis, at 0.5, within 1/256 of an edge.
        assert y.max() < 0.01 * step + 2e-3
        assert np.median(y) < 1e-9
        # The end is where the fronts of a corner meet a third one.
        assert 0.5 - 2e-2 < x.max() < 0.5 + 2e-3
        np.testing.assert_allclose(found.radii, 0.5 - y, atol=1e-7)
        middle = y < 1e-7
        np.testing.assert_allclose(np.abs(found.normals[middle] @ back[:, 1]), 1.0, atol=1e-6)
        np.testing.assert_allclose(found.angles[middle], 180.0, atol=1e-3)
        # Leaves on the axis are as large as its distance from the boundary lets them be.
        axis = np.column_stack([np.linspace(-0.45, 0.45, 100), np.zeros(100)]) @ back.T
        assert covered(axis, found.points, 0.5)


def test_between_circles_it_is_of_second_order_in_a_part_of_an_edge():
    shape = planar.annulus(0.4, 1.0)
    for step in (0.2, 0.05):
        found = medial_axis(around(shape, step), shape)
        # The last stretch is 1/256 of an edge of up to 0.5, squared, over twice the radius.
        assert np.abs(np.linalg.norm(found.points, axis=1) - 0.7).max() < (0.5 / 256) ** 2
        np.testing.assert_allclose(found.radii, 0.3, atol=1e-5)
        angle = np.linspace(0.0, 2.0 * np.pi, 300)
        axis = 0.7 * np.column_stack([np.cos(angle), np.sin(angle)])
        assert covered(axis, found.points, 0.2)


def test_the_centre_of_a_disc_is_found_off_the_edges():
    shape = planar.disc(0.9)
    tree = around(shape, 0.1)
    found = medial_axis(tree, shape)
    assert len(found.points) >= 2
    np.testing.assert_allclose(found.points, 0.0, atol=1e-8)
    assert np.linalg.norm(tree.points, axis=1).min() > 1e-3  # no node is there


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_axis_of_a_box_is_the_middle_sheet(turn):
    boundary = moved(box(1.0, 0.8, 0.5), turn, (-0.5, -0.4, -0.25))
    found = medial_axis(around(to(boundary), 0.1, 3, 0.8), boundary)
    x, y, z = np.abs(found.points @ turn).T
    assert len(x) > 40
    assert np.median(z) < 1e-12
    assert z.max() < 1e-2  # next to edges of the sheet within a 256th of an edge
    assert x.max() < 0.25 + 1e-2
    assert y.max() < 0.15 + 1e-2
    assert found.radii.min() > 0.24


# Where none are


def test_rough_facets_have_no_points_near_them():
    torus, _ = irregular_torus(20, 825)
    noise = np.random.default_rng(20061121).normal(size=torus.points.shape)
    edge = float(np.median(torus.edge_lengths))
    noise *= 0.02 * edge / np.linalg.norm(noise, axis=1)[:, None]
    rough = SimplexMesh(torus.points + noise, torus.cells)
    found = medial_axis(around(to(rough), 0.15, 3, 1.5), rough)
    assert len(found.points) > 200
    assert found.radii.min() > 0.5 * 0.4


@pytest.mark.parametrize("angle", [20.0, 40.0, 90.0, 140.0])
def test_walls_form_a_corner_from_the_corner_angle_on(angle):
    half = np.radians(0.5 * angle)
    corners = [(-1.0, 0.0), (1.0, -2.0 * np.tan(half)), (1.0, 2.0 * np.tan(half))]
    tree = around(planar.polygon(corners), 0.1, half=max(1.3, 2.2 * np.tan(half)))
    for corner_angle in (30.0, 60.0):
        found = medial_axis(tree, outline(corners), corner_angle=corner_angle)
        at_wedge = np.abs(found.points[:, 1]) < 1e-9
        assert (at_wedge.sum() > 5) == (angle < corner_angle)


def test_corners_are_reported_where_they_are():
    corners = np.array([[-0.8, -0.4], [0.8, -0.4], [0.8, 0.4], [-0.8, 0.4]])
    boundary = outline(corners)
    found = medial_axis(around(to(boundary), 0.1), boundary).corners
    np.testing.assert_allclose(np.abs(found), [[0.8, 0.4]] * len(found), atol=1e-9)
    assert len({tuple(np.sign(c)) for c in found}) == 4


# Meshes, other trees, options


def test_meshes_of_the_part_itself_have_a_medial_axis():
    square = structured_square(8, half_width=1.0)
    strip = SimplexMesh(square.points * [3.0, 0.5], square.cells)
    found = medial_axis(strip)
    assert len(found.points) > 5
    np.testing.assert_allclose(found.points[:, 1], 0.0, atol=0.01)
    h0 = size_from_feature(strip, method="medial-axis", elements_across=4.0)
    middle = np.abs(strip.points[:, 0]) < 2.0
    np.testing.assert_allclose(h0[middle], 0.25, rtol=0.02)
    # One layer of cells, all nodes on the boundary.
    thin = SimplexMesh([[0, 0], [4, 0], [4, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_allclose(medial_axis(thin).points[:, 1], 0.5, atol=1e-12)
