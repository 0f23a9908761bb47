"""Sizes on grids and octrees in files."""

import base64
import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, read, read_size, write
from adaptsize.background import Octree
from adaptsize.errors import MeshFileError

SHAPES = [(5,), (4, 3), (4, 3, 5)]
# A grid of 3 x 2 nodes whose field, with x fastest as VTK has it, is 1 2 3 4 5 6.
FIELD = [[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]


def random_size(shape, seed, *, masked=False):
    rng = np.random.default_rng(seed)
    active = rng.random(shape) < 0.7 if masked else None
    dim = len(shape)
    grid = CartesianGrid(rng.normal(size=dim), rng.uniform(0.1, 2.0, dim), shape, active=active)
    values = rng.uniform(0.1, 1.0, shape)
    values.flat[1] = np.inf
    return SizeFunction(grid, values)


def image(array, *, head="", image_head='Origin="0 0 0" Spacing="1 1 1"', extent="0 2 0 1 0 0",
          appended="", name="h"):  # fmt: skip
    """Text of a .vti file, written after the description of the format by VTK."""
    return (
        f'<VTKFile type="ImageData" {head}><ImageData WholeExtent="{extent}" {image_head}>'
        f'<Piece Extent="{extent}"><PointData><DataArray type="Float64" Name="{name}" {array}'
        f"</PointData></Piece></ImageData>{appended}</VTKFile>"
    )


ASCII = image('format="ascii">1 2 3 4 5 6</DataArray>')


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_size_function_comes_back_to_the_last_bit(tmp_path, shape, masked):
    size = random_size(shape, 211, masked=masked)
    write(tmp_path / "a.vti", size)
    again = read_size(tmp_path / "a.vti")
    assert_array_equal(again.values, size.values)
    assert_array_equal(again.background.origin, size.background.origin)
    assert_array_equal(again.background.spacing, size.background.spacing)
    if masked:
        assert_array_equal(again.background.active, size.background.active)
    else:
        assert again.background.active is None


def test_other_fields_go_along(tmp_path):
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    file = tmp_path / "a.vti"
    whole = np.arange(6).reshape(3, 2) + 1
    write(file, SizeFunction(grid, FIELD), fields={"a<b & 'c'": whole, "on": whole > 3})
    assert_array_equal(read_size(file).values, FIELD)
    assert_array_equal(read_size(file, name="a<b & 'c'").values, whole)
    with pytest.raises(MeshFileError, match=r"no nodal field 'g' \(found: h, a<b & 'c', on\)"):
        read_size(file, name="g")
    with pytest.raises(MeshFileError, match=r"a.vti: on: values must be positive"):
        read_size(file, name="on")
    write(file, grid)
    with pytest.raises(MeshFileError, match=r"no nodal field 'h' \(found: none\)"):
        read_size(file)


ORDER = 'byte_order="LittleEndian" header_type="UInt32"'
NUMBERS = np.arange(1.0, 7.0).astype("<f8").tobytes()
INLINE = base64.b64encode(struct.pack("<I", len(NUMBERS)) + NUMBERS).decode()


def test_text_in_image_data_is_read(tmp_path):
    (tmp_path / "a.vti").write_text(ASCII)
    size = read_size(tmp_path / "a.vti")
    assert_array_equal(size.values, FIELD)
    assert repr(size.background) == "CartesianGrid(3 x 2 nodes, (0, 0) to (2, 1))"


def test_vtk_sees_the_same_nodes_and_values(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    for shape in SHAPES:
        size = random_size(shape, 223, masked=True)
        write(tmp_path / "a.vti", size)
        found = pyvista.read(tmp_path / "a.vti")
        dim = len(shape)
        order = np.arange(size.values.size).reshape(shape).ravel(order="F")
        np.testing.assert_allclose(found.points[:, :dim], size.background.points[order], rtol=1e-12)
        assert_array_equal(found["h"], size.values.ravel()[order])
        hidden = ~size.background.active.ravel()[order]
        assert_array_equal(found["vtkGhostType"], 2 * hidden)
        found.save(tmp_path / "b.vti")
        assert_array_equal(read_size(tmp_path / "b.vti").values, size.values)


BAD = {
    "is no XML": "no XML",
    "ends early": image(f'format="binary">\n {INLINE}\n</DataArray>', head=ORDER)[:300],
    "ends inside its numbers": image('format="appended" offset="0"/>', head=ORDER,
                                     appended='<AppendedData encoding="raw">_\x30\x00\x00\x00abc'),
    "too few numbers": image('format="ascii">1 2 3 4 5</DataArray>'),
    "no such nodes": image('format="ascii">1 2</DataArray>', extent="0 1 0 0 0 0"
                           , image_head='Origin="0 0 3"'),
    "not along the axes": image('format="ascii">1 2 3 4 5 6</DataArray>',
                                image_head='Direction="0 1 0 -1 0 0 0 0 1"'),
    "no pieces": "<VTKFile/>",
    "no extent": ASCII.replace('<Piece Extent="0 2 0 1 0 0">', "<Piece>"),
    "NaN": image('format="ascii">1 2 3 nan 5 6</DataArray>'),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_damaged_and_foreign_files_are_one_error_that_names_them(tmp_path, case):
    (tmp_path / "a.vti").write_text(BAD[case])
    with pytest.raises(MeshFileError, match=r"a\.vti: "):
        read_size(tmp_path / "a.vti")


def test_grids_and_octrees_go_to_mesh_formats_as_their_meshes(tmp_path):
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    tree = Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 2, 2, 2, 2])
    for background in (grid, tree):
        size = SizeFunction(
            background, 0.1 + np.arange(background.n_points).reshape(background.nodal_shape)
        )
        write(tmp_path / "a.vtu", size)
        mesh = read(tmp_path / "a.vtu")
        assert_array_equal(mesh.cells, background.mesh.cells)
        assert_array_equal(mesh.points, background.points)
        assert_array_equal(mesh.point_data["h"], size.values.ravel())


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    mesh = SimplexMesh([[0, 0], [1, 0], [1, 1]], [[0, 1, 2]])
    grid = CartesianGrid([0, 0], 1.0, (3, 2))
    file = tmp_path / "a.vti"
    with pytest.raises(ValueError, match=r"obj must be a CartesianGrid for .vti, got Simplex"):
        write(file, mesh)
    with pytest.raises(ValueError, match=r"fields\['x'\] must have shape \(3, 2\), got \(6,\)"):
        write(file, grid, fields={"x": np.ones(6)})
    with pytest.raises(ValueError, match="field 'x' must hold numbers, got complex128"):
        write(file, grid, fields={"x": np.ones((3, 2), complex)})
    assert list(tmp_path.iterdir()) == []
