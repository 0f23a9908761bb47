"""Pictures: what the pixels show, and machines that cannot draw."""

import base64
import io
import re

import numpy as np
import pytest
from meshes import structured_square
from PIL import Image

from adaptsize import SimplexMesh, SizeFunction
from adaptsize.plot import pictures, plot_mesh, plot_size, with_vtk
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


def test_plane_mesh_is_seen_from_above_with_equal_aspect(drawn_by):
    square = structured_square(16)
    mesh = SimplexMesh(square.points * (2.0, 1.0), square.cells)  # 200 x 100
    image = plot_size(mesh, 60.0 + mesh.points[:, 0] / 2, width=2 * WIDTH)
    assert image.dtype == np.uint8
    assert image.shape[1:] == (2 * WIDTH, 4)
    on_mesh = (image[..., 3] == 255)[:, : int(1.23 * WIDTH)]
    rows, columns = np.nonzero(on_mesh)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(2.0, rel=0.05)
    # Small sizes are on the left (dark), large ones on the right (light).
    light = np.nonzero(is_near(image[:, : int(1.23 * WIDTH)], LIGHT))[1]
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


def test_where_there_is_a_display_a_window_opens_and_its_last_view_is_returned(monkeypatch):
    if not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    mesh = structured_square(4)
    size = SizeFunction(mesh, 60.0 + mesh.points[:, 0] / 2)
    with pytest.raises(ValueError, match="without a display, got True"):
        plot_size(size, window=True)
    # pyvista.OFF_SCREEN is true in the tests: the window closes at once.
    monkeypatch.setattr(with_vtk, "opens_windows", lambda: True)
    image = size.plot()
    assert image.shape == (768, 1024, 4)
    left, bar = image[:, :840], image[:, 840:]
    assert is_near(left, DARK).any(axis=1).sum() > 600  # the mesh fills the window
    assert is_near(bar, DARK).any()
    assert mesh.plot(window=False, width=WIDTH).shape[1] == WIDTH


def test_edges_of_a_surface_are_drawn_along_their_whole_length():
    if not with_vtk.is_possible():
        pytest.skip("VTK cannot draw here")
    square = structured_square(4)
    mesh = SimplexMesh(np.c_[square.points, 0.4 * square.points[:, 0]], square.cells)
    scene = scene_of_mesh(mesh, np.ones(mesh.n_points), None, on_nodes=True)
    image = with_vtk.draw(scene, 400, 400).astype(int)
    low, high = scene.frame
    along = np.linspace(0.1, 0.9, 101)[:, None]
    inner = mesh.edges[~np.isin(mesh.edges, mesh.boundary().nodes).any(axis=1)]
    for start, stop in mesh.points[inner]:
        seen = (start + along * (stop - start)) @ scene.axes.T - 0.5 * (low + high)
        columns, rows = (200 + [1, -1] * seen[:, :2] * 400 / (1.04 * (high - low)[:2].max())).T
        near = [image[rows.astype(int) + k, columns.astype(int)].sum(axis=1) for k in (-1, 0, 1)]
        face = np.median(image[image[..., 3] == 255].sum(axis=1))
        assert (np.min(near, axis=0) < face - 30).mean() > 0.95


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


def test_a_vtk_that_crashes_does_not_take_the_caller_along(monkeypatch):
    monkeypatch.setattr(with_vtk, "_PROBE", "import os, signal; os.kill(os.getpid(), 9)")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('blank')")
    assert not with_vtk._can_draw("")
    monkeypatch.setattr(with_vtk, "_PROBE", "print('drawn')")
    assert with_vtk._can_draw("")


def test_matplotlib_draws_what_is_near_over_what_is_far():
    # Two squares, one above the other, seen from above: the upper one is light.
    low = structured_square(1)
    points = np.concatenate([np.c_[low.points, np.zeros(4)], np.c_[low.points, np.full(4, 20.0)]])
    mesh = SimplexMesh(points, np.concatenate([low.cells + 4, low.cells]))
    scene = scene_of_mesh(mesh, np.repeat([1.0, 2.0], 4), None, on_nodes=True)
    image = pictures.with_matplotlib.draw(scene, WIDTH, WIDTH)
    assert is_near(image, LIGHT).sum() > 1.3 * is_near(image, DARK).sum() > 0
