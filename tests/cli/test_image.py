"""``adaptsize image`` and ``adaptsize size`` of images: files in, files out, what is said."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from PIL import Image as Pillow

from adaptsize import read, read_size

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def mask(tmp_path):
    """A disc of radius 20 pixels, label 5, and a bar, label 9."""
    y, x = np.mgrid[0:60, 0:100]
    rows = np.where(np.hypot(x - 30, y - 30) < 20, 5, 0) + np.where((x > 60) & (x < 80), 9, 0)
    rows[[0, 1, 2, -3, -2, -1]] = 0
    Pillow.fromarray(rows.astype(np.uint8)).save(tmp_path / "mask.png")
    return tmp_path / "mask.png"


def test_image_writes_a_mesh_with_sizes_and_regions(mask, tmp_path, capsys):
    output = tmp_path / "mesh.vtu"
    assert call("image", mask, "-o", output, "--spacing", "0.5", "--elements-across", "5") == 0
    mesh = read(output)
    assert capsys.readouterr().err == ""
    assert sorted(set(mesh.cell_tags)) == [5, 9]
    assert mesh.measures[mesh.cell_tags == 5].sum() == pytest.approx(np.pi * 100.0, rel=0.02)
    assert mesh.point_data["h"].min() > 0.0


def test_a_region_whose_area_has_changed_is_named(tmp_path, capsys):
    y, x = np.mgrid[0:100, 0:100]
    rows = (np.hypot(x - 50, y - 50) < 42).astype(np.uint8)
    rows[np.hypot(x - 40, y - 50) < 8] = 2
    rows[30:90, 70:72] = 3  # a line of two pixels
    Pillow.fromarray(rows).save(tmp_path / "mask.png")
    assert call("image", tmp_path / "mask.png", "-o", tmp_path / "mesh.vtu", "--hmax", "6") == 0
    said = capsys.readouterr()
    assert "warning: the area of these regions has changed: 1 (+2.2%), 3 (-100.0%)" in said.err
    assert re.search(r"region 2 +area 19\d.*, changed by [+-]0\.[0-4]\d%", said.out)


@pytest.mark.parametrize("words", [["--size-of", "9=1"], ["--source", "region:9=1"]])
def test_sizes_by_label_arrive(mask, tmp_path, capsys, words):
    assert call("image", mask, "-o", tmp_path / "mesh.vtu", *words) == 0
    assert capsys.readouterr().err == ""
    mesh = read(tmp_path / "mesh.vtu")
    h = mesh.point_data["h"]
    assert h[np.unique(mesh.cells[mesh.cell_tags == 9])].max() < 1.3
    assert h[np.unique(mesh.cells[mesh.cell_tags == 5])].min() > 1.9
    assert call("size", mask, "-o", tmp_path / "size.vti", *words) == 0
    assert read_size(tmp_path / "size.vti")([[70.0, 30.0]]) == pytest.approx(1.0)


def test_size_of_an_image_says_what_controls_what(mask, tmp_path, capsys):
    output = tmp_path / "size.vti"
    assert call("size", mask, "-o", output, "--spacing", "0.5,0.5") == 0
    printed = capsys.readouterr().out
    assert "curvature " in printed
    assert "% of the area" in printed
    assert "field cause: 0 curvature, 1 width, 6 hmin, 7 hmax" in printed
    assert read_size(output).background.spacing.tolist() == [0.5, 0.5]
    with pytest.raises(ValueError, match=r"cause: .*must be positive"):
        read_size(output, name="cause")  # -1 outside


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--spacing", "a"], "--spacing must be one number or several such as 1,1,2.5, got 'a'"),
        (["--label", "4"], "--label must be one of 0, 5, 9, got 4"),
        (["--size-of", "4=1"], "--size-of must be labels of the image, 5, 9; got '4'"),
        (["--source", "region:4=1"], "tags must be labels of the image, 5, 9; got '4'"),
        (["--threshold", "200"], "must have a pixel above 200, got none"),
        (["--spacing", "0"], "--spacing must be from 1e-60 to 1e+60"),
    ],
)
def test_bad_options_are_one_line_and_leave_no_file(mask, tmp_path, refused, words, expected):
    code = 1 if "above 200" in expected else 2
    assert expected in refused("image", mask, "-o", tmp_path / "mesh.vtu", *words, code=code)
    assert not (tmp_path / "mesh.vtu").exists()


def test_options_for_the_other_kind_of_file_are_refused(mask, tmp_path, refused):
    err = refused("size", mask, "-o", tmp_path / "a.vti", "--field", "h0")
    assert "--field applies to meshes, got it with" in err
    err = refused("size", DATA / "lshape.vtu", "-o", tmp_path / "a.vtu", "--label", "3")
    assert "--label applies to images, got it with" in err
