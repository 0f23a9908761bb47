"""Corners between the walls of a shape, where its medial axis touches them."""

import numpy as np
import planar_shapes as planar
import pytest

from adaptsize import CartesianGrid, medial_axis


def test_where_pieces_do_not_meet_they_form_no_corner():
    # Two walls at right angles with a slit of a spacing at their corner are unlike a corner only
    # in the numbers of their pieces.
    grid = CartesianGrid([0.0, 0.0], 0.05, (41, 41))
    x, y = grid.points.T
    phi = -np.minimum(x, y).reshape(grid.shape)
    nearest = (x > y).astype(int).reshape(grid.shape)
    assert len(medial_axis(grid, phi, patches=nearest).points) == 0
    # A third piece along the boundary next to the corner keeps the two apart.
    nearest[np.abs(phi) <= 0.1] = 2
    found = medial_axis(grid, phi, patches=nearest)
    assert len(found.points) > 20
    np.testing.assert_allclose(found.points[:, 0], found.points[:, 1], atol=1e-12)


def test_pieces_that_meet_may_be_rounded_off_by_more():
    # A corner of radius 0.3, seen from a distance of up to 1.
    grid, phi = planar.sampled(
        lambda x: np.where(
            (x < 0.3).all(axis=1),
            np.linalg.norm(x - 0.3, axis=1) - 0.3,
            -np.minimum(x[:, 0], x[:, 1]),
        ),
        0.05,
        half=1.0,
        shift=(0.31, 0.77),
    )
    away = grid.points.reshape(*grid.shape, 2)
    nearest = (away[..., 0] > away[..., 1]).astype(int)
    blind = medial_axis(grid, phi).points.max()
    informed = medial_axis(grid, phi, patches=nearest).points.max()
    one = medial_axis(grid, phi, patches=np.zeros(grid.shape, int)).points.max()
    # A corner if its radius is up to a share of the distance, and half a spacing at the apex,
    # which is 0.41 radii off the rounding.
    slack = 0.5 * 0.05 / (np.sqrt(2.0) - 1.0)
    assert blind == pytest.approx((0.3 - slack) / 0.25, abs=0.05)
    assert informed == pytest.approx((0.3 - slack) / 0.5, abs=0.05)
    assert one == blind


@pytest.mark.parametrize("angle", [20.0, 40.0, 90.0, 140.0])
def test_walls_form_a_corner_from_the_corner_angle_on(angle):
    half = np.radians(0.5 * angle)
    wedge = planar.polygon([(-1.0, 0.0), (1.0, -2.0 * np.tan(half)), (1.0, 2.0 * np.tan(half))])
    grid, phi = planar.sampled(wedge, 0.02, shift=(0.31, 0.77), half=1.1)
    for corner_angle in (30.0, 60.0):
        found = medial_axis(grid, phi, corner_angle=corner_angle)
        # Equally far from both sides, and closer to them than to the third.
        at_wedge = found.points[np.abs(found.points[:, 1]) < 1e-9]
        assert (len(at_wedge) > 20) == (angle < corner_angle)


def test_corners_are_reported_where_they_are():
    shape = planar.turned(planar.rectangle(1.6, 0.8), 20.0)
    grid, phi = planar.sampled(shape, 0.02)
    corners = medial_axis(grid, phi).corners
    angle = np.radians(20.0)
    back = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(np.abs(corners @ back), [[0.8, 0.4]] * len(corners), atol=0.002)
    assert len({tuple(np.sign(c)) for c in corners @ back}) == 4
    assert len(medial_axis(*planar.sampled(planar.wavy_disc(0.9, 0.005, 24), 0.02)).corners) == 0
