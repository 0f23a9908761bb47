"""Names of fields and tags: read back as they are, or refused before anything is written."""

import contextlib
import string
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mesh_files import SQUARE, TWO_TRIANGLES
from numpy.testing import assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, read, read_size, write
from adaptsize.errors import InputWarning

#: Letters with a meaning in some format, and some that few programs expect.
ODD = "<>&\"'`%\\/.,;:#$(){}[]=\t\n\r\x0b\x00\x1b\x85\xa0\u2028\ud800\ufffee\u0301\U0001f600 "
NAMES = st.text(st.sampled_from(ODD + string.ascii_letters + string.digits), max_size=12)


@pytest.mark.parametrize("suffix", [".vtu", ".vtp", ".vtk", ".vtkhdf", ".xdmf", ".msh", ".ply"])
@settings(max_examples=60, deadline=None)
@given(name=NAMES, tag=NAMES)
@example(name='h" format="ascii" x="', tag="a")
def test_odd_names_in_meshes_are_read_back_or_refused(suffix, name, tag):
    fields = {name: [1.0, 2.0, 3.0, 4.0]}
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES, cell_tags=[1, 2], point_data=fields)
    with contextlib.suppress(ValueError):  # some texts are no names of tags
        mesh = replace(mesh, tag_names={(2, 1): tag})
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = Path(folder, f"mesh{suffix}")
        try:
            write(path, mesh)
        except ValueError as error:
            assert "cannot hold the name" in str(error)  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017
            assert list(Path(folder).iterdir()) == []
            return
        back = read(path)
    assert list(back.point_data) == [name]
    assert_array_equal(back.point_data[name], mesh.point_data[name])
    if suffix not in (".ply", ".xdmf"):
        assert back.tag_names == mesh.tag_names


def test_groups_that_a_mesh_cannot_hold_are_named_in_a_warning(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]
    blocks = {"vertex": [[4]], "line": [[0, 1], [1, 2]], "tetra": [[0, 1, 2, 3], [1, 2, 3, 4]]}
    tags = [np.array([9]), np.array([4, 4]), np.array([2, 2])]
    raw = meshio.Mesh(
        points,
        list(blocks.items()),
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"gauge": np.array([9, 0]), "wire": np.array([4, 1]), "soil": np.array([2, 3])},
    )
    meshio.write(tmp_path / "a.msh", raw, file_format="gmsh22", binary=False)
    text = r"1 tagged nodes dropped \(gauge\); 2 tagged segments dropped \(wire\)"
    with pytest.warns(InputWarning, match=text):
        mesh = read(tmp_path / "a.msh")
    assert mesh.tag_names == {(3, 2): "soil"}
    raw.cell_data["gmsh:physical"][:2] = [0 * tags[0], 0 * tags[1]]
    meshio.write(tmp_path / "b.msh", raw, file_format="gmsh22", binary=False)
    assert read(tmp_path / "b.msh").tag_names == {(3, 2): "soil"}  # geometry only: no warning


@settings(max_examples=60, deadline=None)
@given(name=NAMES)
def test_odd_names_on_grids_are_read_back_or_refused(name):
    grid = CartesianGrid([0.0, 0.0], 1.0, (3, 2))
    values = np.arange(1.0, 7.0).reshape(3, 2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "grid.vti")
        try:
            write(path, grid, fields={name: values})
        except ValueError as error:
            assert "cannot hold the name" in str(error)  # noqa: PT017
            assert list(Path(folder).iterdir()) == []
            return
        assert_array_equal(read_size(path, name=name).values, values)


@pytest.mark.parametrize("suffix", [".vtu", ".vtp", ".vtk", ".vtkhdf", ".xdmf", ".msh"])
@pytest.mark.parametrize("name", ["h & <b>", "a' b", "v/x", "naïve", "x", "%41"])
def test_usual_names_are_not_refused(tmp_path, suffix, name):
    if suffix == ".vtkhdf" and "/" in name:
        return  # a separator of HDF5
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    write(tmp_path / f"a{suffix}", SizeFunction(mesh, [1.0, 2.0, 3.0, 4.0]), fields={name: [5] * 4})
    assert_array_equal(read(tmp_path / f"a{suffix}").point_data[name], 5)
