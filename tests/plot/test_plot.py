"""Pictures: what the pixels show, and machines that cannot draw."""

import base64
import io
import re
import subprocess
import sys

import numpy as np
import pytest
from meshes import jittered_cube, random_square, structured_square
from PIL import Image
from shapes import two_region_rectangle
from upper_bounds import limit_bounds

import adaptsize as ads
from adaptsize import CartesianGrid, MetricFunction, SimplexMesh, SizeFunction
from adaptsize.plot import pictures, plot_causes, plot_mesh, plot_metric, plot_size, with_vtk
from adaptsize.plot.scene import scene_of_mesh

pytest.importorskip("pyvista")

LIGHT, DARK = (239, 242, 235), (86, 24, 104)  # the ends of the colours of sizes
WIDTH = 240


def is_near(image, color, tolerance=40):
    near = (np.abs(image[..., :3].astype(int) - color) < tolerance).all(axis=2)
    return near & (image[..., 3] > 128)


@pytest.fixture(params=["vtk", "matplotlib"])
def drawn_by(request, monkeypatch):
    possible = request.param == "vtk"
    if possible and not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    monkeypatch.setattr(with_vtk, "is_possible", lambda: possible)
    return request.param


def test_a_module_in_the_working_folder_is_not_run(tmp_path):
    stranger = "open('executed', 'w').close()\n"
    (tmp_path / "vtkmodules.py").write_text(stranger)
    code = "from adaptsize.plot import with_vtk; print(with_vtk._can_draw('vtkNoSuchWindow'))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.remove('')\n{code}"],
        cwd=tmp_path,
        capture_output=True,
        check=True,
        text=True,
    )
    assert done.stdout in ("True\n", "False\n")
    assert not (tmp_path / "executed").exists()


def test_plane_mesh_is_seen_from_above_with_equal_aspect(drawn_by):
    square = structured_square(16)
    mesh = SimplexMesh(square.points * (2.0, 1.0), square.cells)  # 200 x 100
    image = plot_size(mesh, 60.0 + mesh.points[:, 0] / 2, width=2 * WIDTH)
    assert image.dtype == np.uint8
    assert image.shape[1:] == (2 * WIDTH, 4)
    on_mesh = (image[..., 3] == 255)[:, : int(1.46 * WIDTH)]
    rows, columns = np.nonzero(on_mesh)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(2.0, rel=0.05)
    # Small sizes are on the left (dark), large ones on the right (light).
    light = np.nonzero(is_near(image[:, : int(1.46 * WIDTH)], LIGHT))[1]
    assert light.mean() > columns.mean() + 0.2 * np.ptp(columns)


def test_notebooks_show_a_picture_and_a_table(drawn_by):
    mesh = structured_square(4)
    tags = np.repeat([1, 2], mesh.n_cells // 2)
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags, tag_names={(2, 1): "a<b"})
    for shown in (mesh, SizeFunction(mesh, np.ones(mesh.n_points))):
        text = shown._repr_html_()
        data = re.search(r"src='data:image/png;base64,([^']+)'", text)[1]
        assert Image.open(io.BytesIO(base64.b64decode(data))).width == 480
        assert "<td style='text-align:left'>a&lt;b, 2</td>" in text
    assert "32 triangles" in text
    assert "1 to 1" in text
    # Several regions have their colours; one shows the quality.
    assert np.array_equal(mesh.plot(width=WIDTH), plot_mesh(mesh, color="region", width=WIDTH))


def test_meshes_and_sizes_draw_themselves(tmp_path, drawn_by):
    mesh = structured_square(4)
    size = SizeFunction(mesh, 0.1 + np.arange(mesh.n_points))
    assert np.array_equal(mesh.plot(width=WIDTH), plot_mesh(mesh, width=WIDTH))
    size.plot(width=WIDTH, path=tmp_path / "a.png")
    shown = np.asarray(Image.open(tmp_path / "a.png"))
    assert np.array_equal(shown, plot_size(size, width=WIDTH))


@pytest.mark.parametrize("color", ["quality", "region", "weight"])
def test_mesh_is_coloured_by_quality_region_or_field(drawn_by, color):
    mesh = structured_square(4)
    tags = (mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0).astype(int) + 7
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags, cell_data={"weight": tags * 1.5})
    image = plot_mesh(mesh, color=color, width=WIDTH)
    row = image[image.shape[0] // 2 - 4, : int(0.65 * WIDTH), :3].astype(int)
    left, right = np.median(row[20 : WIDTH // 4], axis=0), np.median(row[-WIDTH // 4 :], axis=0)
    differs = np.abs(left - right).max() > 40
    assert differs == (color != "quality")  # all triangles have the same shape


def test_size_function_and_field_h_give_the_same_picture(drawn_by, tmp_path):
    mesh = structured_square(5)
    h = 1.0 + np.arange(36.0)
    from_array = plot_size(mesh, h, width=float(WIDTH))
    np.testing.assert_array_equal(plot_size(SizeFunction(mesh, h), width=WIDTH), from_array)
    with_field = mesh.with_data(point_data={"h": h})
    path = tmp_path / "h.png"
    np.testing.assert_array_equal(plot_size(with_field, path=path, width=WIDTH), from_array)
    with Image.open(path) as written:
        np.testing.assert_array_equal(np.asarray(written), from_array)
    assert [p.name for p in tmp_path.iterdir()] == ["h.png"]


def test_bad_arguments_are_named():
    mesh = structured_square(2)
    with pytest.raises(ValueError, match="no nodal field 'h'"):
        plot_size(mesh)
    with pytest.raises(ValueError, match=r"path must end in \.png"):
        plot_size(mesh, np.ones(9), path="picture.doc")


def test_a_vtk_that_crashes_does_not_take_the_caller_along(monkeypatch):
    monkeypatch.setattr(with_vtk, "_PROBE", "import os, signal; os.kill(os.getpid(), 9)")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('blank')")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('drawn')")
    assert with_vtk._can_draw("")


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
    assert (tmp_path / "a.png").stat().st_size > 100


def test_matplotlib_draws_what_is_near_over_what_is_far():
    # Two squares, one above the other, seen from above: the upper one is light.
    low = structured_square(1)
    points = np.concatenate([np.c_[low.points, np.zeros(4)], np.c_[low.points, np.full(4, 20.0)]])
    mesh = SimplexMesh(points, np.concatenate([low.cells + 4, low.cells]))
    scene = scene_of_mesh(mesh, np.repeat([1.0, 2.0], 4), None, on_nodes=True)
    image = pictures.with_matplotlib.draw(scene, WIDTH, WIDTH)
    assert is_near(image, LIGHT).sum() > 1.3 * is_near(image, DARK).sum() > 0


def test_pictures_with_the_same_limits_have_the_same_colours(drawn_by):
    mesh = structured_square(2)
    low = plot_size(mesh, np.full(9, 1.0), limits=(1.0, 5.0), width=WIDTH)
    high = plot_size(mesh, np.full(9, 5.0), limits=(1.0, 5.0), width=WIDTH)
    assert is_near(low, DARK).mean() > 0.4
    assert is_near(high, LIGHT).mean() > 0.4


def test_equal_sizes_have_equal_colours_on_all_sides(drawn_by):
    solid = jittered_cube(3, 20060111)
    picture = plot_size(solid, np.full(27, 5.0), limits=(1.0, 5.0), clip=None, width=WIDTH)
    mesh = picture[:, : int(0.65 * WIDTH)]
    shown = mesh[..., 3] > 128
    assert (is_near(mesh, LIGHT, 50)).sum() > 0.7 * shown.sum()


@pytest.mark.parametrize("limits", [(2.0, 1.0), (1.0, np.inf), (1.0,)])
def test_limits_that_are_no_range_are_refused(limits):
    with pytest.raises(ValueError, match="limits"):
        plot_size(structured_square(2), np.ones(9), limits=limits, width=WIDTH)


@pytest.mark.parametrize("by_vtk", [True, False])
def test_boxes_are_drawn(monkeypatch, by_vtk):
    if by_vtk and not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    monkeypatch.setattr(with_vtk, "is_possible", lambda: by_vtk)
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    picture = plot_size(grid, lambda x: 1.0 + x[:, 0] ** 2, width=200)
    row = picture[len(picture) // 2 + 4, :130].astype(int)  # left of the bar
    shown = row[row[:, 3] > 128, :3].sum(axis=1)
    assert len(shown) > 80
    assert np.median(shown[:20]) + 50 < np.median(shown[-20:])  # from dark to light


def colours_of(image):
    """The frequent colours that are not grey."""
    opaque = image[image[..., 3] == 255][:, :3]
    pixels, counts = np.unique(opaque, axis=0, return_counts=True)
    coloured = np.ptp(pixels.astype(int), axis=1) > 40
    return pixels[coloured & (counts > 0.005 * image.shape[0] * image.shape[1])]


def test_each_cause_of_a_mesh_has_a_colour(tmp_path):
    mesh = random_square(300, seed=77)
    x = mesh.points[:, 0]
    bounds = {
        "left": np.where(x < -0.9, 0.05, np.inf),
        "right": np.where(x > 0.9, 0.05, np.inf),
    }
    _, report = limit_bounds(mesh, bounds, 0.5, hmin=0.01, hmax=0.3)
    image = plot_causes(report, path=tmp_path / "causes.png", width=320)
    assert image.shape[1:] == (320, 4)
    assert len(colours_of(image)) >= 3
    assert (tmp_path / "causes.png").exists()


def test_what_is_outside_a_grid_is_left_out():
    grid = CartesianGrid([-2.0, -2.0], 0.1, (41, 41))
    report = ads.size_function(
        lambda x: np.linalg.norm(x, axis=1) - 1.0, background=grid, hmax=9.0
    ).report
    image = plot_causes(report, width=320)
    # Drawn is the disc, which fills its box but for the corners.
    rows = image[:, : int(0.6 * 320)]
    coloured = (np.ptp(rows[..., :3].astype(int), axis=2) > 40) & (rows[..., 3] > 128)
    high, wide = (np.flatnonzero(coloured.any(axis=d)) for d in (1, 0))
    box = (np.ptp(high) + 1) * (np.ptp(wide) + 1)
    assert 0.6 < coloured.sum() / box < 0.95


def test_a_picture_is_drawn_also_without_a_bound_along_a_direction(tmp_path):
    mesh = two_region_rectangle(6)
    free = ads.Metric(np.tile([0.1, np.inf], (mesh.n_points, 1)), [np.eye(2)] * mesh.n_points)
    image = plot_metric(MetricFunction(mesh, free), path=tmp_path / "metric.png", width=200)
    assert image.shape[1] == 200
    assert image.std() > 5.0
    assert (tmp_path / "metric.png").exists()


def test_what_is_drawn_is_checked():
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    with pytest.raises(ValueError, match="size must be given: grids and octrees carry no fields"):
        plot_size(grid)
    with pytest.raises(ValueError, match=r"size must have shape \(3, 2\), got \(6,\)"):
        plot_size(grid, np.ones(6))
    with pytest.raises(ValueError, match="clip must be one of 'auto', 'x', 'y', got 'z'"):
        plot_size(SizeFunction(grid, np.ones((3, 2))), clip="z")
