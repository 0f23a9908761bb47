"""Pictures of grids and octrees: what their scenes hold, and that they can be drawn."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, SizeFunction
from adaptsize.background import Octree
from adaptsize.plot import boxes, plot_size, with_vtk
from adaptsize.plot.boxes import scene_of_grid, scene_of_octree

pytest.importorskip("pyvista")


def scene_of(background, values=None, clip="auto"):
    values = np.ones(background.nodal_shape) if values is None else values
    make = scene_of_grid if isinstance(background, CartesianGrid) else scene_of_octree
    return make(background, values, label="h", clip=clip)


def area_of(scene):
    a, b, c, d = np.moveaxis(scene.points[scene.cells], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).sum()


def test_a_plane_grid_is_its_boxes():
    grid = CartesianGrid([1.0, 2.0], [0.5, 1.0], (4, 3))
    values = grid.sample(lambda x: x[:, 0] + 10.0 * x[:, 1])
    scene = scene_of(grid, values)
    assert scene.cells.shape == (6, 4)
    assert scene.flat
    assert scene.on_nodes
    assert area_of(scene) == pytest.approx(3.0)
    np.testing.assert_allclose(scene.values, scene.points @ [1.0, 10.0, 0.0])


def test_a_grid_in_space_shows_its_outer_faces():
    grid = CartesianGrid([0.0, 0.0, 1.0], [1.0, 2.0, 0.5], (3, 4, 5))
    values = grid.sample(lambda x: x @ [1.0, 10.0, 100.0])
    scene = scene_of(grid, values, clip=None)
    assert scene.cells.shape == (2 * (6 + 8 + 12), 4)
    assert area_of(scene) == pytest.approx(2.0 * (2 * 6 + 2 * 2 + 6 * 2))
    np.testing.assert_allclose(scene.values, scene.points @ [1.0, 10.0, 100.0])
    assert not scene.flat
    assert "mesh" not in vars(grid)


def test_a_grid_in_space_is_cut_in_the_middle():
    scene = scene_of(CartesianGrid([0.0, 0.0, 0.0], 1.0, (3, 5, 9)))  # not across the longest
    low, high = scene.points.min(axis=0), scene.points.max(axis=0)
    np.testing.assert_array_equal([low, high], [[0, 2, 0], [2, 4, 8]])  # the eye is at low y
    low = scene_of(CartesianGrid([0.0, 0.0, 0.0], 1.0, (3, 5, 9)), clip="z").points
    assert low[:, 2].max() == 4.0


def test_only_boxes_of_active_nodes_are_shown():
    active = np.ones((4, 4), bool)
    active[0, 0] = False
    assert len(scene_of(CartesianGrid([0, 0], 1.0, (4, 4), active=active)).cells) == 8
    ball = CartesianGrid([-1.0, -1.0, -1.0], 0.1, (21, 21, 21))
    inside = ball.sample(lambda x: np.linalg.norm(x, axis=1)) < 0.8
    scene = scene_of(ball.with_active(inside), clip="x")
    assert np.linalg.norm(scene.points, axis=1).max() < 0.8
    assert scene.points[:, 0].max() == pytest.approx(0.0)
    alone = np.zeros((4, 4), bool)
    alone[1, 1] = True
    with pytest.raises(ValueError, match="active must leave at least one box"):
        scene_of(CartesianGrid([0, 0], 1.0, (4, 4), active=alone))


def test_boxes_with_free_nodes_show_the_others_or_nothing():
    values = [[1.0, np.inf], [3.0, np.inf], [np.inf, np.inf]]
    scene = scene_of(CartesianGrid([0, 0], 1.0, (3, 2)), np.array(values))
    assert not scene.on_nodes
    np.testing.assert_array_equal(scene.values, [2.0, 3.0])


def test_fine_grids_are_drawn_by_some_of_their_nodes(monkeypatch):
    monkeypatch.setattr(boxes, "_MOST_NODES", {2: 5, 3: 3})
    grid = CartesianGrid([0, 0], 1.0, (101, 4))
    scene = scene_of(grid, grid.sample(lambda x: 1.0 + x[:, 0]))
    assert len(scene.cells) == 12
    assert area_of(scene) == pytest.approx(300.0)
    np.testing.assert_array_equal(np.unique(scene.values), [1.0, 26.0, 51.0, 76.0, 101.0])


def test_an_octree_shows_its_leaves():
    tree = Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 2, 2, 2, 2])
    scene = scene_of(tree, 1.0 + tree.points[:, 0])
    assert len(scene.cells) == 7
    assert area_of(scene) == pytest.approx(1.0)
    np.testing.assert_allclose(scene.values, 1.0 + scene.points[:, 0])


def test_an_octree_in_space_shows_outer_faces_and_is_cut():
    tree = Octree([0, 0, 0], [2, 1, 1], (2, 1, 1), [0, *[1] * 8])
    scene = scene_of(tree, clip=None)
    # One face of the large leaf, four of small ones between them are hidden but not equal.
    assert len(scene.cells) == 6 + 6 * 4
    assert area_of(scene) == pytest.approx(10.0 + 2.0)
    assert scene_of(tree, clip="x").points[:, 0].max() == 1.0


@pytest.mark.parametrize("by_vtk", [True, False])
def test_boxes_are_drawn(monkeypatch, by_vtk):
    if by_vtk and not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    monkeypatch.setattr(with_vtk, "is_possible", lambda: by_vtk)
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    picture = plot_size(grid, lambda x: 1.0 + x[:, 0] ** 2, width=200)
    row = picture[len(picture) // 2 + 4, :160].astype(int).sum(axis=1)  # left of the bar
    shown = row[row < 700]
    assert len(shown) > 130
    assert np.median(shown[:20]) + 50 < np.median(shown[-20:])  # from purple to yellow


def test_what_is_drawn_is_checked():
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    with pytest.raises(ValueError, match="size must be given: grids and octrees carry no fields"):
        plot_size(grid)
    with pytest.raises(ValueError, match=r"size must have shape \(3, 2\), got \(6,\)"):
        plot_size(grid, np.ones(6))
    with pytest.raises(ValueError, match="clip must be one of 'auto', 'x', 'y', got 'z'"):
        plot_size(SizeFunction(grid, np.ones((3, 2))), clip="z")
    with pytest.raises(ValueError, match="mesh must be a mesh, grid or octree"):
        plot_size("part.stl", [1.0])
