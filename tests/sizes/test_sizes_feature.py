"""Sizes from the feature size: every background, thin places of parts, elements counted."""

from functools import cache

import numpy as np
import pytest
from meshes import jittered_cube, structured_square
from shapes import joined, moved
from solids import circle, outline

from adaptsize import (
    CartesianGrid,
    Octree,
    SimplexMesh,
    limit_gradient,
    refine_at_boundary,
    size_from_feature,
    size_function,
)
from adaptsize.sizes.feature import width_in_regions

RTOL = 0.011  # of the spheres


def slab(mesh, thickness):
    """A square or cube of half width 50 squeezed along its last axis."""
    squeeze = np.ones(mesh.dim)
    squeeze[-1] = thickness / 100.0
    return SimplexMesh(mesh.points * squeeze, mesh.cells)


# --- one answer on every background ------------------------------------------------


@cache
def backgrounds():
    plane, volume = slab(structured_square(8), 10.0), slab(jittered_cube(5, 841), 10.0)
    rectangle = outline([[-50, -5], [50, -5], [50, 5], [-50, 5]])
    solid = volume.boundary().mesh
    tree = Octree.build([-60, -20], [60, 20], refine_at_boundary(
        lambda x: rectangle.locator.nearest(x)[2], 4.0), max_level=5)  # fmt: skip
    return {
        "triangles": (plane, None),
        "tetrahedra": (volume, None),
        "segments": (rectangle, None),
        "surface": (solid, None),
        "grid": (CartesianGrid([-60, -20], 4.0, (31, 11)), rectangle),
        "coarse grid": (CartesianGrid([-60, -24], 16.0, (9, 4)), rectangle),
        "3-D grid": (CartesianGrid([-60, -60, -12], 8.0, (16, 16, 4)), solid),
        "quadtree": (tree, rectangle),
        "triangles in another": (plane, rectangle),
    }


@pytest.mark.parametrize(
    "name",
    ["triangles", "tetrahedra", "segments", "surface", "grid", "coarse grid", "3-D grid",
     "quadtree", "triangles in another"],
)  # fmt: skip
def test_a_slab_has_its_thickness_at_every_node_closest_to_its_wide_faces(name):
    background, boundary = backgrounds()[name]
    h0 = size_from_feature(background, boundary, elements_across=4.0)
    assert h0.shape == background.nodal_shape
    half = np.full(background.dim, 50.0)
    half[-1] = 5.0
    depth = half - np.abs(background.points)
    inside = (depth >= -1e-9).all(axis=1)
    wide = inside & (depth[:, -1:] <= depth[:, :-1] + 1e-9).all(axis=1)
    np.testing.assert_allclose(h0.ravel()[wide], 2.5, rtol=RTOL)
    assert (h0.ravel()[inside & ~wide] >= 2.5 * (1.0 - RTOL)).all()  # of the rim: as long as it is
    if boundary is not None and name != "triangles in another":
        far = (np.abs(background.points) > half + 25.0).any(axis=1)
        assert np.isinf(h0.ravel()[far]).all()


def test_a_grid_coarser_than_the_plate_sees_it():
    grid = CartesianGrid([-60, -24], 16.0, (9, 4))  # no node lies in the plate
    plate = outline([[-50, -1], [50, -1], [50, 1], [-50, 1]])
    h0 = size_from_feature(grid, plate, elements_across=2.0)
    assert np.isfinite(h0).sum() >= 2 * 6
    np.testing.assert_allclose(h0[np.isfinite(h0)], 1.0, rtol=RTOL)


def test_distances_on_a_grid_give_the_medial_axis():
    grid = CartesianGrid.around([[-2.2, -2.2], [2.2, 2.2]], 0.04)
    radius = np.linalg.norm(grid.points, axis=1).reshape(grid.shape)
    phi = np.abs(radius - 1.5) - 0.5
    by_axis = size_from_feature(grid, phi, elements_across=4.0)
    by_spheres = size_from_feature(grid, outline(circle(200, 2.0), circle(200, 1.0)[::-1]))
    inside = phi < -0.01
    assert np.isinf(by_axis[phi > 0.0]).all()
    # Exact 0.25; medial points are found to a quarter of the spacing.
    assert np.abs(by_axis[inside] - 0.25).max() < 0.25 * 0.04
    np.testing.assert_allclose(by_spheres[inside], 0.25, rtol=0.015)


def test_the_two_sides_of_a_slit_do_not_see_each_other():
    # Two squares that share no node along the line where they meet.
    left = structured_square(4, half_width=1.0)
    mesh = joined(left, moved(left, [2.0, 0.0]))
    np.testing.assert_allclose(size_from_feature(mesh, elements_across=2.0), 1.0, rtol=RTOL)


def tagged_by_place(mesh, tag):
    """Return a mesh with the tag of the middle of each cell."""
    middles = mesh.points[mesh.cells].mean(axis=1)
    return SimplexMesh(mesh.points, mesh.cells, cell_tags=tag(middles).astype(np.int32))


def test_each_region_has_its_own_width():
    square = structured_square(16, half_width=1.0)
    mesh = tagged_by_place(square, lambda x: 1 + (np.abs(x[:, 1]) < 0.25))
    width = width_in_regions(mesh, 40.0, lambda *_: None)
    y = mesh.points[:, 1]
    far = np.abs(mesh.points[:, 0]) < 0.6  # from the ends, which are not narrow
    np.testing.assert_allclose(width[far & (np.abs(y) <= 0.25)], 0.5, rtol=1e-12)
    np.testing.assert_allclose(width[far & (np.abs(y) > 0.26)], 0.75, rtol=1e-12)
    assert np.isinf(width_in_regions(square, 40.0, lambda *_: None)).all()
    size = size_function(mesh, elements_across=4.0, g=1.0, hmax=0.4)
    np.testing.assert_allclose(size.values[far & (y == 0.0)], 0.125, rtol=1e-12)


# --- limited, and counted ------------------------------------------------------------


def test_limited_sizes_put_the_elements_across_a_gap_that_varies():
    mesh = slab(structured_square(40), 10.0)
    x, y = mesh.points.T
    width = 10.0 + 0.05 * np.abs(x) ** 1.5  # 10 in the middle to 27.7 at the ends
    mesh = SimplexMesh(np.column_stack([x, y * width / 10.0]), mesh.cells)
    h0 = size_from_feature(mesh, elements_across=4.0)
    h = limit_gradient(mesh, h0, 0.25, method="fast-marching")
    across = (1.0 / h).reshape(41, 41)
    # The integral of 1 / h along each column of nodes; a column is as long as it is wide.
    count = (0.5 * (across[:, 1:] + across[:, :-1])).mean(axis=1) * width.reshape(41, 41)[:, 0]
    x = mesh.points.reshape(41, 41, 2)[:, 0, 0]
    away = np.abs(x) < 50.0 - 0.5 * width.reshape(41, 41)[:, 0]
    # Rays leave the walls along normals, which are up to 15 degrees off the columns there.
    assert (count[away] > 4.0 * 0.94).all()
    # At the rim, which is not narrow across itself, sizes grow from its corners.
    assert (count > 2.0 / 0.25 * np.log(1.0 + 4.0 * 0.25 / 2.0) * 0.99).all()
    # No more than by the facets' slope: spheres at the flanks are smaller than the column.
    assert (count < 4.0 * 1.35).all()


# --- arguments -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((CartesianGrid([0, 0], 1.0, (3, 3)),), {}, "boundary must be given"),
        ((structured_square(2).boundary().mesh, structured_square(2)), {}, "consist of segments"),
        ((structured_square(2), np.zeros(9)), {}, "or distances on a CartesianGrid"),
        ((SimplexMesh([[0.0], [1.0]], [[0, 1]]),), {}, "background must be a volume"),
        ((structured_square(2),), {"tolerance": 0.1}, "tolerance is for a SimplexMesh as boundary"),
        (
            (CartesianGrid([0, 0], 1.0, (3, 3)), np.ones((3, 3))),
            {"crease_angle": 30.0},
            "crease_angle has no effect on distances, got 30",
        ),
    ],
)
def test_bad_arguments_are_named(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        size_from_feature(*arguments, **options)


def test_inactive_nodes_are_asked_nothing():
    grid = CartesianGrid([-60, -20], 4.0, (31, 11))
    active = np.zeros(grid.shape, bool)
    active[:, :5] = True
    plate = outline([[-50, -5], [50, -5], [50, 5], [-50, 5]])
    h0 = size_from_feature(grid.with_active(active), plate)
    assert np.isinf(h0[:, 5:]).all()
    assert np.isfinite(h0[:, 4]).any()
