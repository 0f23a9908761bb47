"""Corners between the walls of a shape, where its medial axis touches them."""

import numpy as np
import planar_shapes as planar
import pytest

from adaptsize import medial_axis


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
