"""Sizes in the files that mesh generators read."""

import os

import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES, tagged_mesh
from meshes import random_sphere
from numpy.testing import assert_array_equal

from adaptsize import SimplexMesh, SizeFunction, write


@pytest.mark.parametrize("dim", [2, 3])
def test_a_medit_solution_has_one_scalar_per_node(tmp_path, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / "size.sol", mesh)
    words = (tmp_path / "size.sol").read_text().split()
    head = ["MeshVersionFormatted", "2", "Dimension", str(dim), "SolAtVertices"]
    assert words[:8] == [*head, str(mesh.n_points), "1", "1"]
    assert words[-1] == "End"
    assert_array_equal(np.array(words[8:-1], float), mesh.point_data["h"])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_jigsaw_file_has_points_cells_and_values(tmp_path, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / "size.jig.msh", mesh)
    lines = (tmp_path / "size.jig.msh").read_text().splitlines()
    n, m = mesh.n_points, mesh.n_cells
    assert lines[:3] == ["MSHID=3;euclidean-mesh", f"NDIMS={dim}", f"POINT={n}"]
    points = np.array([line.split(";") for line in lines[3 : 3 + n]], float)
    assert_array_equal(points, np.pad(mesh.points, ((0, 0), (0, 1))))
    assert lines[3 + n] == f"TRIA{dim + 1}={m}"
    cells = np.array([line.split(";") for line in lines[4 + n : 4 + n + m]], int)
    assert_array_equal(cells, np.column_stack([mesh.cells, mesh.cell_tags]))
    assert lines[4 + n + m] == f"VALUE={n};1"
    assert_array_equal(np.array(lines[5 + n + m :], float), mesh.point_data["h"])
    write(tmp_path / "size.msh", mesh, file_format="jigsaw")
    assert (tmp_path / "size.msh").read_text().splitlines() == lines


@pytest.mark.parametrize("name", ["size.pos", "size.sol", "size.jig.msh"])
def test_sizes_that_generators_do_not_know_are_refused(tmp_path, name):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match=r"h must be finite .*clip.*h\[2\] = inf"):
        write(tmp_path / name, SizeFunction(mesh, [1, 1, np.inf, 1]))
    with pytest.raises(ValueError, match=r"must be positive .*h\[1\] = 0"):
        write(tmp_path / name, mesh, fields={"h": [1, 0, 1, 1]})
    with pytest.raises(ValueError, match="nodal sizes as the field 'h'"):
        write(tmp_path / name, mesh)
    with pytest.raises(ValueError, match="sizes only, as the field 'h', got size"):
        write(tmp_path / name, mesh, fields={"h": [1, 1, 1, 1], "size": [1, 1, 1, 1]})
    assert os.listdir(tmp_path) == []


def test_jigsaw_does_not_take_surfaces_in_space(tmp_path):
    mesh = random_sphere(10, 7318)
    with pytest.raises(ValueError, match="holds triangles in the plane or tetrahedra, got"):
        write(tmp_path / "size.jig.msh", SizeFunction(mesh, np.ones(10)))
