"""Distances between a solid and the boundary of a mesh, also where a surface is open."""

import numpy as np
import pytest
from shapes import CORNERS, CUBE_CELLS

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import distances_from_solid

LID = (CORNERS[CUBE_CELLS][..., 2] == 1.0).all(axis=1)
OPEN = SimplexMesh(CORNERS, CUBE_CELLS[~LID])
GRID = CartesianGrid([0.0] * 3, 0.125, (9, 9, 9)).mesh


def mesh_below(height):
    """The part of a fine mesh of the unit cube with centroids below a height."""
    low = GRID.points[GRID.cells].mean(axis=1)[:, 2] < height
    return SimplexMesh(GRID.points, GRID.cells[low])


def largest(mesh, surface, allowed=0.02):
    away, opening = distances_from_solid(mesh.boundary().mesh, Solid(surface), allowed)
    return max(found.largest for found in away), opening


def test_a_lid_on_an_open_box_is_no_deviation_and_is_reported():
    distance, opening = largest(GRID, OPEN)
    assert distance == pytest.approx(0.0, abs=1e-12)
    assert opening.n_parts == 1
    assert opening.area == pytest.approx(1.0)
    assert opening.place == pytest.approx((0.5, 0.5, 1.0), abs=0.03)
    assert str(opening) == "openings are closed by 1 part with an area of 1 around (0.5, 0.5, 1)"


def test_a_fill_far_from_the_opening_is_a_deviation():
    assert largest(mesh_below(0.5), OPEN)[0] > 0.3  # half of it is lost
    above = GRID.moved(GRID.points * [1.0, 1.0, 2.0])
    assert largest(above, OPEN)[0] > 0.3


def test_a_closed_surface_has_no_opening():
    closed = SimplexMesh(CORNERS, CUBE_CELLS)
    assert largest(GRID, closed) == (pytest.approx(0.0, abs=1e-12), None)
    distance, opening = largest(mesh_below(0.5), closed)
    assert distance == pytest.approx(0.5)
    assert opening is None


def test_facets_inside_of_an_open_surface_are_not_compared():
    core = SimplexMesh(0.4 + 0.2 * CORNERS, CUBE_CELLS)
    points = np.concatenate([OPEN.points, core.points])
    both = SimplexMesh(points, np.concatenate([OPEN.cells, core.cells + OPEN.n_points]))
    assert largest(GRID, both)[0] == pytest.approx(0.0, abs=1e-12)
