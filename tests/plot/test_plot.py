"""Pictures: what a scene holds, what the pixels show, and machines that cannot draw."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from meshes import jittered_cube, random_sphere, structured_square

from adaptsize import SimplexMesh, SizeFunction
from adaptsize.errors import PlotError
from adaptsize.plot import pictures, plot_mesh, plot_size, with_matplotlib, with_vtk
from adaptsize.plot.scene import make_scene

pytest.importorskip("pyvista")

YELLOW, PURPLE = (253, 231, 37), (68, 1, 84)  # the ends of viridis
WIDTH = 240


def scene_of(mesh, values, clip="auto"):
    return make_scene(mesh, values, label="h", clip=clip, on_nodes=True)


def is_near(image, color, tolerance=40):
    return (np.abs(image.astype(int) - color) < tolerance).all(axis=2)


@pytest.fixture(params=["vtk", "matplotlib"])
def drawn_by(request, monkeypatch):
    possible = request.param == "vtk"
    if possible and not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    monkeypatch.setattr(with_vtk, "is_possible", lambda: possible)
    return request.param


# --- scenes -----------------------------------------------------------------------


def test_axes_are_orthonormal_and_right_handed():
    axes = scene_of(random_sphere(50, 731), np.ones(50)).axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), axes[2], atol=1e-14)
    assert axes[1, 2] > 0.5  # z points up


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


def test_edges_are_drawn_only_when_they_can_be_distinguished():
    assert scene_of(structured_square(20), np.ones(21**2)).shows_edges
    assert not scene_of(structured_square(500), np.ones(501**2)).shows_edges


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


def test_values_of_cells_go_with_their_cells():
    mesh = jittered_cube(5, 53)
    of_cells = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    scene = make_scene(mesh, of_cells, label="", clip="y", on_nodes=False)
    # The owner of a face has its middle within one cell, 50 long at most, of the face.
    assert np.abs(scene.values - scene.points[scene.cells].mean(axis=1)[:, 0]).max() < 25.0
    assert len(scene.values) == len(scene.cells)


def test_auto_clip_cuts_tetrahedra_only():
    cube, sphere = jittered_cube(4, 54), random_sphere(40, 55)
    assert scene_of(cube, np.ones(64)).points[:, 0].max() < 40.0
    assert len(scene_of(sphere, np.ones(40)).cells) == sphere.n_cells


def test_cells_without_a_finite_value_show_none():
    mesh = structured_square(3)
    values = np.full(16, np.inf)
    values[0] = 2.0
    scene = scene_of(mesh, values)
    has_corner = (mesh.cells == 0).any(axis=1)
    np.testing.assert_array_equal(np.isfinite(scene.values), has_corner)
    assert scene.limits == (2.0, 2.0)


# --- pictures ---------------------------------------------------------------------


def test_plane_mesh_is_seen_from_above_with_equal_aspect(drawn_by):
    square = structured_square(16)
    mesh = SimplexMesh(square.points * (2.0, 1.0), square.cells)  # 200 x 100
    image = plot_size(mesh, 60.0 + mesh.points[:, 0] / 2, width=2 * WIDTH)
    assert image.dtype == np.uint8
    assert image.shape[1:] == (2 * WIDTH, 3)
    on_mesh = (image.astype(int).sum(axis=2) < 700)[:, : int(1.55 * WIDTH)]
    rows, columns = np.nonzero(on_mesh)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(2.0, rel=0.05)
    # Small sizes are on the left (dark), large ones on the right (yellow).
    left, right = np.nonzero(is_near(image[:, : int(1.55 * WIDTH)], YELLOW))[1], columns
    assert left.mean() > right.mean() + 0.2 * np.ptp(columns)


def test_picture_of_tetrahedra_shows_both_ends_of_the_colours(drawn_by):
    mesh = jittered_cube(5, 56)
    image = plot_size(mesh, 60.0 + mesh.points[:, 2], width=WIDTH)
    mesh_part = image[:, : int(0.8 * WIDTH)]
    drawn = mesh_part.min(axis=2) < 250
    assert 0.2 < drawn.mean() < 0.9
    hue_high = drawn & (mesh_part[:, :, 0].astype(int) > mesh_part[:, :, 2].astype(int) + 30)
    hue_low = drawn & (mesh_part[:, :, 2].astype(int) > mesh_part[:, :, 0].astype(int) + 20)
    # z grows upwards in the picture, so yellow is above blue.
    assert np.nonzero(hue_high)[0].mean() < np.nonzero(hue_low)[0].mean()


@pytest.mark.parametrize("color", ["quality", "region", "weight"])
def test_mesh_is_coloured_by_quality_region_or_field(drawn_by, color):
    mesh = structured_square(4)
    tags = (mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0).astype(int) + 7
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags, cell_data={"weight": tags * 1.5})
    image = plot_mesh(mesh, color=color, width=WIDTH)
    row = image[image.shape[0] // 2 - 4, : int(0.75 * WIDTH)].reshape(-1, 3).astype(int)
    left, right = np.median(row[20 : WIDTH // 4], axis=0), np.median(row[-WIDTH // 4 :], axis=0)
    differs = np.abs(left - right).max() > 40
    assert differs == (color != "quality")  # all triangles have the same shape


def test_regions_are_labelled_by_their_names():
    mesh = structured_square(2)
    tags = np.arange(8) % 3 + 5
    names = {(2, 5): "steel", (2, 7): "air", (1, 6): "inlet"}  # of which (1, 6) names facets
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags, tag_names=names)
    scene = make_scene(mesh, tags, label="region", clip=None, on_nodes=False, classes=True)
    assert scene.class_labels == ["steel", "6", "air"]
    assert scene.shows_edges
    quality = make_scene(mesh, tags, label="quality", clip=None, on_nodes=False)
    assert quality.class_names == {}


def test_segments_can_be_drawn():
    if not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    outline = structured_square(4).boundary().mesh
    image = plot_size(outline, np.ones(outline.n_points), width=WIDTH)
    assert (image.min(axis=2) < 200).mean() > 0.002


def test_size_function_and_field_h_give_the_same_picture(drawn_by, tmp_path):
    mesh = structured_square(5)
    h = 1.0 + np.arange(36.0)
    from_array = plot_size(mesh, h, width=float(WIDTH))
    np.testing.assert_array_equal(plot_size(SizeFunction(mesh, h), width=WIDTH), from_array)
    with_field = mesh.with_data(point_data={"h": h})
    path = tmp_path / "h.png"
    np.testing.assert_array_equal(plot_size(with_field, path=path, width=WIDTH), from_array)

    from PIL import Image

    with Image.open(path) as written:
        np.testing.assert_array_equal(np.asarray(written), from_array)
    assert [p.name for p in tmp_path.iterdir()] == ["h.png"]


@pytest.mark.parametrize("value", [3.0, np.inf])
def test_constant_or_infinite_sizes_are_drawn(drawn_by, value):
    image = plot_size(structured_square(3), np.full(16, value), width=WIDTH)
    assert image.std() > 1.0


# --- refusals ---------------------------------------------------------------------


def test_bad_arguments_are_named():
    mesh = structured_square(2)
    with pytest.raises(ValueError, match="no nodal field 'h'"):
        plot_size(mesh)
    with pytest.raises(ValueError, match=r"size must have shape \(9,\)"):
        plot_size(mesh, np.ones(4))
    with pytest.raises(ValueError, match=r"path must end in \.png"):
        plot_size(mesh, np.ones(9), path="picture.doc")
    with pytest.raises(ValueError, match="clip must be one of"):
        plot_size(mesh, np.ones(9), clip="z")
    with pytest.raises(ValueError, match="width must be 64 to 10000"):
        plot_size(mesh, np.ones(9), width=3)
    with pytest.raises(ValueError, match=r"whole pixels, got 99\.5"):
        plot_size(mesh, np.ones(9), width=99.5)
    with pytest.raises(ValueError, match="color must be one of 'quality', 'region'"):
        plot_mesh(mesh, color="colour")


def test_missing_pyvista_is_an_import_error_with_the_pip_line(monkeypatch):
    monkeypatch.setattr(pictures, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r'pip install "adaptsize\[plot\]"'):
        plot_size(structured_square(2), np.ones(9))


def test_no_way_to_draw_is_a_plot_error(monkeypatch):
    monkeypatch.setattr(with_vtk, "is_possible", lambda: False)
    monkeypatch.setattr(pictures, "find_spec", lambda name: None if name == "matplotlib" else name)
    with pytest.raises(PlotError, match="neither OpenGL nor EGL nor OSMesa"):
        plot_size(structured_square(2), np.ones(9))


def test_a_vtk_that_crashes_does_not_take_the_caller_along(monkeypatch):
    monkeypatch.setattr(with_vtk, "_PROBE", "import os, signal; os.kill(os.getpid(), 9)")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('blank')")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('drawn')")
    assert with_vtk._can_draw("")


def test_importing_the_plot_module_imports_no_drawing_package():
    code = "import adaptsize.plot, sys; print({'pyvista', 'matplotlib', 'vtk'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_nothing_is_printed_without_a_display(tmp_path):
    if not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    code = (
        "from adaptsize import SimplexMesh\nfrom adaptsize.plot import plot_size\n"
        "mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])\n"
        f"plot_size(mesh, [1, 2, 3], path={str(tmp_path / 'a.png')!r}, width=100)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == run.stderr == ""
    assert Path(tmp_path / "a.png").stat().st_size > 100


def test_drawing_leaves_the_environment_alone(monkeypatch):
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    import os

    plot_size(structured_square(2), np.ones(9), width=64)
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ


def test_matplotlib_draws_what_is_near_over_what_is_far():
    # Two squares, one above the other, seen from above: the upper one is yellow.
    low = structured_square(1)
    points = np.concatenate([np.c_[low.points, np.zeros(4)], np.c_[low.points, np.full(4, 20.0)]])
    mesh = SimplexMesh(points, np.concatenate([low.cells + 4, low.cells]))
    scene = make_scene(mesh, np.repeat([1.0, 2.0], 4), label="h", clip=None, on_nodes=True)
    image = with_matplotlib.draw(scene, WIDTH, WIDTH)
    red, green, blue = np.moveaxis(image[:, : int(0.8 * WIDTH)].astype(int), 2, 0)
    yellow, purple = red > blue + 60, blue > green + 30
    assert yellow.sum() > 1.3 * purple.sum() > 0


# --- one scale for several pictures -----------------------------------------------


def test_pictures_with_the_same_limits_have_the_same_colours(drawn_by):
    mesh = structured_square(2)
    low = plot_size(mesh, np.full(9, 1.0), limits=(1.0, 5.0), width=WIDTH)
    high = plot_size(mesh, np.full(9, 5.0), limits=(1.0, 5.0), width=WIDTH)
    assert is_near(low, PURPLE).mean() > 0.4
    assert is_near(high, YELLOW).mean() > 0.4


def test_equal_sizes_have_equal_colours_on_all_sides(drawn_by):
    solid = jittered_cube(3, 20060111)
    picture = plot_size(solid, np.full(27, 5.0), limits=(1.0, 5.0), clip=None, width=WIDTH)
    mesh = picture[:, : int(0.75 * WIDTH)]
    shown = ~is_near(mesh, (255, 255, 255))
    assert (is_near(mesh, YELLOW) & shown).sum() > 0.7 * shown.sum()


@pytest.mark.parametrize("limits", [(2.0, 1.0), (1.0, np.inf), (1.0, 1.0), (1.0,), "ab"])
def test_limits_that_are_no_range_are_refused(limits):
    with pytest.raises(ValueError, match="limits"):
        plot_size(structured_square(2), np.ones(9), limits=limits, width=WIDTH)
