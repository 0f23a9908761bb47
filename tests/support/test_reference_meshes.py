"""The meshes of domains that are not convex fill them exactly."""

import domains
import numpy as np
import pytest
from geodesics import (
    area,
    contains,
    perimeter,
)
from numpy.testing import assert_allclose


@pytest.mark.parametrize(
    "make",
    [
        domains.slit_square,
        lambda n: domains.slit_square(n, width=0.5),
        domains.star_holes,
        domains.maze,
        domains.round_holes,
        domains.disc,
    ],
)
def test_the_mesh_fills_the_polygon_exactly(make):
    n = 700
    mesh, rings = make(n)
    assert 0.85 * n < mesh.n_points < 1.15 * n
    check_boundary(mesh, area(rings), perimeter(rings))
    corners = np.concatenate(rings)
    nearest = np.abs(mesh.points[:, None] - corners).max(axis=2).min(axis=0)
    assert (nearest == 0.0).all()
    assert contains(rings, mesh.points[mesh.cells].mean(axis=1)).all()
    # No cell is bad enough to be a riddle of its own, but many are obtuse.
    assert mesh.measures.min() > 1e-4 * mesh.measures.mean()


def test_the_tetrahedra_fill_the_box_around_the_wall_exactly():
    mesh, rings = domains.wall_box(2000)
    assert 1700 < mesh.n_points < 2500
    check_boundary(mesh, 100.0 * area(rings), 100.0 * perimeter(rings) + 2.0 * area(rings))
    corners = [[x, y, z] for x, y in rings[0] for z in (-50.0, 50.0)]
    assert all((mesh.points == corner).all(axis=1).any() for corner in corners)
    assert contains(rings, mesh.points[mesh.cells].mean(axis=1)[:, :2]).all()


def test_the_tetrahedra_fill_the_box_around_the_window_exactly():
    mesh, (width, lower, upper) = domains.window_box(2000)
    assert (width, lower, upper) == (2.0, (-20.0, -8.0), (10.0, 16.0))
    high, deep = np.subtract(upper, lower)
    wall = 100.0**2 - high * deep
    sides = 6.0 * 100.0**2 - 4.0 * 100.0 * width
    check_boundary(mesh, 100.0**3 - width * wall, sides + 2.0 * wall + 2.0 * width * (high + deep))
    x, y, z = mesh.points[mesh.cells].mean(axis=1).T
    open_here = (y > lower[0]) & (y < upper[0]) & (z > lower[1]) & (z < upper[1])
    assert ((np.abs(x) > 1.0) | open_here).all()
    corners = [[x, y, z] for x in (-1, 1) for y in (-20, 10) for z in (-8, 16)]
    assert all((mesh.points == corner).all(axis=1).any() for corner in corners)


def check_boundary(mesh, measure, boundary_measure):
    # A cell across the boundary would change the one sum, a crack inside the other.
    assert_allclose(mesh.measures.sum(), measure, rtol=1e-12)
    assert_allclose(mesh.boundary().mesh.measures.sum(), boundary_measure, rtol=1e-12)
    assert mesh.facet_cell_counts.max() == 2
    assert len(np.unique(mesh.cells)) == mesh.n_points
