"""Area, extent and curvature of the faces of a surface."""

import numpy as np
import pytest
from command_line import call
from numpy.testing import assert_allclose
from solids import box, cylinder, turned

from adaptsize import SimplexMesh, read, write
from adaptsize.geometry.face_table import summarize_faces


def test_faces_of_a_cylinder_tell_its_radius():
    radius, height, n = 2.0, 3.0, 240
    faces = summarize_faces(cylinder(n, radius, height).tag_faces())
    wall = max(faces, key=lambda face: abs(face.curvature))
    flat = [face for face in faces if face is not wall]
    assert wall.curvature == pytest.approx(1.0 / radius, rel=1e-2)
    assert wall.area == pytest.approx(2.0 * np.pi * radius * height, rel=1e-3)
    assert_allclose([face.curvature for face in flat], 0.0, atol=1e-9)
    assert_allclose([face.area for face in flat], np.pi * radius**2, rtol=1e-3)
    assert wall.high[2] - wall.low[2] == pytest.approx(height)


@pytest.mark.parametrize("scale", [0.01, 30.0])
def test_areas_and_curvatures_do_not_depend_on_the_place(scale):
    surface = cylinder(60, 1.0, 2.0).tag_faces()
    other = turned(surface)
    other = SimplexMesh(scale * other.points + 5.0, other.cells, cell_tags=surface.cell_tags)
    for one, two in zip(summarize_faces(surface), summarize_faces(other), strict=True):
        assert two.area == pytest.approx(scale**2 * one.area)
        assert two.curvature == pytest.approx(one.curvature / scale, abs=1e-9)


def test_the_hole_of_a_part_is_concave():
    inner = cylinder(60, 1.0, 2.0)
    hole = SimplexMesh(inner.points, inner.cells[:, ::-1]).tag_faces()
    assert min(face.curvature for face in summarize_faces(hole)) == pytest.approx(-1.0, rel=0.1)


def test_the_commands_list_faces_and_tag_them(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    write(tmp_path / "a.stl", box(1.0, 2.0, 3.0))
    assert call("info", tmp_path / "a.stl", "--faces") == 0
    lines = capsys.readouterr().out.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("face  "))
    areas = sorted(float(line.split()[2]) for line in lines[first + 1 :])
    assert_allclose(areas, [2, 2, 3, 3, 6, 6])
    words = ["--faces", "--hmax", "0.7", "-o", tmp_path / "b.inp"]
    assert call("remesh", tmp_path / "a.stl", *words) == 0
    back = read(tmp_path / "b.inp")
    assert set(back.tag_names.values()) == {f"face_{k}" for k in range(1, 7)}
    facets = {name: back.tagged_facets[back.facet_tags == tag]
              for (dim, tag), name in back.tag_names.items() if dim == 2}  # fmt: skip
    found = [SimplexMesh(back.points, held).measures.sum() for held in facets.values()]
    assert_allclose(sorted(found), areas)
    assert call("info", tmp_path / "b.inp", "--faces") == 2
    assert "--faces applies to a surface in space without tags" in capsys.readouterr().err
