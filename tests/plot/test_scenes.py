"""What pictures show: visible faces, their values, colours and ticks, before anything is drawn."""

import numpy as np
import pytest
from meshes import jittered_cube, structured_square
from shapes import block, two_region_rectangle

from adaptsize import CartesianGrid, Metric, SimplexMesh
from adaptsize.background import Octree
from adaptsize.plot.scene import scene_of_grid, scene_of_mesh, scene_of_metric, scene_of_octree


def scene_of(background, values=None, clip="auto"):
    values = np.ones(background.nodal_shape) if values is None else values
    if isinstance(background, SimplexMesh):
        return scene_of_mesh(background, values, clip, on_nodes=True)
    make = scene_of_grid if isinstance(background, CartesianGrid) else scene_of_octree
    return make(background, values, clip)


def test_colours_are_logarithmic_beyond_a_factor_of_ten():
    mesh = structured_square(2)
    assert scene_of(mesh, np.linspace(1.0, 10.5, 9)).is_logarithmic
    assert not scene_of(mesh, np.linspace(1.0, 9.5, 9)).is_logarithmic
    assert not scene_of(mesh, np.linspace(0.0, 9.5, 9)).is_logarithmic  # no logarithm of zero


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.0122, 0.223, [0.02, 0.05, 0.1, 0.2]),
        (1e-4, 1.0, [1e-4, 1e-3, 1e-2, 0.1, 1.0]),
        (60.0, 178.0, [75.0, 100.0, 125.0, 150.0, 175.0]),
        (-0.5, 0.5, [-0.5, -0.25, 0.0, 0.25, 0.5]),
        (6.0, 6.0, [6.0]),
    ],
)
def test_numbers_at_the_colour_bar_are_round(low, high, ticks):
    scene = scene_of(structured_square(2), np.linspace(low, high, 9))
    np.testing.assert_allclose(scene.ticks, ticks, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("decades", [1.1, 3.7, 12.0, 200.0])
def test_colour_bar_has_two_to_seven_numbers_within_its_ends(decades):
    low = 0.313
    scene = scene_of(structured_square(2), np.geomspace(low, low * 10.0**decades, 9))
    assert 2 <= len(scene.ticks) <= 7
    assert scene.limits[0] <= scene.ticks[0] <= scene.ticks[-1] <= scene.limits[1]


@pytest.mark.parametrize("clip", ["x", "y", "z"])
def test_clip_keeps_whole_cells_of_the_half_away_from_the_eye(clip):
    mesh = jittered_cube(6, 52)
    axis = "xyz".index(clip)
    scene = scene_of(mesh, mesh.points[:, axis], clip=clip)
    whole = scene_of(mesh, mesh.points[:, axis], clip=None)
    towards_eye = scene.axes[2, axis]
    # No cell of this mesh is longer than two of its grid spacings, 20 each.
    reach = (scene.points[:, axis] * np.sign(towards_eye)).max()
    assert 0.0 < reach < 40.0
    assert (whole.points[:, axis] * np.sign(towards_eye)).max() == pytest.approx(50.0)
    np.testing.assert_array_equal(scene.values, scene.points[:, axis])  # values go with nodes


def area_of(scene):
    a, b, c, d = np.moveaxis(scene.points[scene.cells], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).sum()


def test_a_grid_in_space_shows_its_outer_faces():
    grid = CartesianGrid([0.0, 0.0, 1.0], [1.0, 2.0, 0.5], (3, 4, 5))
    values = grid.sample(lambda x: x @ [1.0, 10.0, 100.0])
    scene = scene_of(grid, values, clip=None)
    assert scene.cells.shape == (2 * (6 + 8 + 12), 4)
    assert area_of(scene) == pytest.approx(2.0 * (2 * 6 + 2 * 2 + 6 * 2))
    np.testing.assert_allclose(scene.values, scene.points @ [1.0, 10.0, 100.0])
    assert not scene.flat
    assert "mesh" not in vars(grid)


def test_an_octree_in_space_shows_outer_faces_and_is_cut():
    tree = Octree([0, 0, 0], [2, 1, 1], (2, 1, 1), [0, *[1] * 8])
    scene = scene_of(tree, clip=None)
    # One face of the large leaf, four of small ones between them are hidden but not equal.
    assert len(scene.cells) == 6 + 6 * 4
    assert area_of(scene) == pytest.approx(10.0 + 2.0)
    assert scene_of(tree, clip="x").points[:, 0].max() == 1.0


@pytest.mark.parametrize(("mesh", "n_corners"), [(two_region_rectangle(8), 40), (block(6), 126)])
def test_glyphs_have_the_proportions_and_directions_of_the_sizes(mesh, n_corners):
    turn = np.linalg.qr(np.random.default_rng(88).standard_normal((mesh.dim, mesh.dim)))[0]
    sizes = np.array([0.1, 0.4, 0.7])[: mesh.dim]
    metric = Metric(np.tile(sizes, (mesh.n_points, 1)), np.tile(turn, (mesh.n_points, 1, 1)))
    scene = scene_of_metric(mesh, metric, 30, "auto")
    corners = scene.points.reshape(-1, n_corners, 3)[..., : mesh.dim]
    middle = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    along = np.abs((corners - middle[:, None]) @ turn).max(axis=1)
    # 14 columns do not meet every axis of an ellipsoid.
    assert along / along[:, -1:] == pytest.approx(
        np.tile(sizes / sizes[-1], (len(along), 1)), rel=0.04
    )
    assert np.allclose(scene.values, 0.1)
    assert 15 <= len(corners) <= 60
